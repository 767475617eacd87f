"""The simulated devices besides the CNC: what they do with their set-points, in physics."""
