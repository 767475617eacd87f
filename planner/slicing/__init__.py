"""Planes through meshes and the heights of layers."""

from planner.slicing.section import Loop, Section, plane_frame
from planner.slicing.slicer import slice_mesh

__all__ = ["Loop", "Section", "plane_frame", "slice_mesh"]
