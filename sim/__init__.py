"""The far end of the wires: a whole cell in software."""
