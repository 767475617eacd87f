"""The CNC: grbl 1.1 and grblHAL over a serial line."""
