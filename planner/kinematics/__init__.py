"""Joints to tip and axis and back, for any cell of three linear and two rotary joints."""
