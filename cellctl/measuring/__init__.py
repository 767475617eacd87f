"""Touch-off: what was touched at the machine, and the placement that follows from it."""
