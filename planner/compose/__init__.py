"""The plan as a whole: each piece of a division made in its own frame, placed in the build frame, put in order, and kept clear of what stands.

assembly  the pieces one after the other, layers numbered through        straight  a piece that grows along one direction
standing  what stands when a piece is made, seen from its frame         setups    which pieces share a direction that points up
"""
