"""The mesh: loading, checking, mending."""

from planner.mesh.mesh import Mesh

__all__ = ["Mesh"]
