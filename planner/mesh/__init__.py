"""The part as a closed triangle mesh in millimetres: loading, checking, mending."""

from planner.mesh.findings import Finding
from planner.mesh.load import LoadedMesh, inspect_bytes, load, load_bytes, load_checked
from planner.mesh.mesh import Mesh

__all__ = ["Finding", "LoadedMesh", "Mesh", "inspect_bytes", "load", "load_bytes", "load_checked"]
