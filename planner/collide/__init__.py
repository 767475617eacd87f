"""What hits what: the bodies of a cell against each other and against the part as it stands at a step, and cutters against what must stand.

`guard.Guard` answers for posting: machine, tools, plate, clamps (convex bodies on carriers, GJK) and the part as points under ball
trees, along the motion between poses. `reach.reach` answers for planning, before there is a machine. `gouge.gouge` measures how deep
a swept cutter comes into a mesh.
"""
