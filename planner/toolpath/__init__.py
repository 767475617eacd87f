"""Toolpaths of one layer, band or piece, with their set-points, independent of any machine.

Deposition: `deposit` (contours, `fill`, `spiral`, `rings`, middle lines of thin parts, overhang), chosen by `pattern`, its metal told
by `balance`. Milling: `face`, `side` (flank), `scallop` and `ball` (rows of a ball cutter), `roughing`, `bore`, `clear`. `order` puts
operations in sequence, `links` joins their passes.
"""
