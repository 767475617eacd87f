"""Toolpaths: contours, hatch, faces, walls, and the links between them."""
