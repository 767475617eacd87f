"""The simulated CNC: firmware, G-code, look-ahead motion and kinematics of its own."""
