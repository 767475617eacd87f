"""Joints to tip and axis and back, for any cell of three linear and two rotary joints; the way of the rotary ones, speed and time.

`chain` and `inverse`: exact, both branches. `shortest`: branches, turns and leans of a whole operation as one shortest path.
`pole`: round the singular pose. `feed`: the tip's speed under velocity, acceleration and jerk of all axes. `timing`: the time that a
grbl-like firmware takes.
"""
