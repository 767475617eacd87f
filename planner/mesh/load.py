"""Loading a part: read, check, mend, and say what was done."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from planner.errors import MeshError
from planner.mesh.findings import Finding
from planner.mesh.mend import mended_mesh
from planner.mesh.mesh import Mesh
from planner.mesh.read import MAX_FILE_BYTES, read_geometry


@dataclass(frozen=True, eq=False)
class LoadedMesh:
    """A closed mesh and how it came about.

    mesh          : Mesh             mm
    findings      : list of Finding  empty for a mesh that needed nothing and has nothing odd about it
    units         : str              what the file's numbers were said to be, "mm" or "inch"
    source_sha256 : str              hex digest of the file's bytes
    """

    mesh: Mesh
    findings: list[Finding]
    units: str
    source_sha256: str

    @property
    def summary(self) -> str:
        """One line that shows the unit taken and the bounding box: if it looks wrong, the unit was."""
        low, high = self.mesh.bounds
        size = " x ".join(f"{value:.6g}" for value in self.mesh.size)
        box = ", ".join(f"{a:.6g} ... {b:.6g}" for a, b in zip(low, high, strict=True))
        return f"{size} mm (file in {self.units}; x, y, z = {box} mm), {len(self.mesh.facets)} facets"


def load(path: str | Path, units: str = "mm") -> Mesh:
    """The closed mesh in a file (.stl, .3mf, .obj, .ply), in mm; what was mended is told by `load_checked`.

    units : "mm" or "inch", what the file's numbers mean.  Raises MeshError, one line, if it cannot be used.
    """
    return load_checked(path, units).mesh


def load_checked(path: str | Path, units: str = "mm") -> LoadedMesh:
    """As `load`, with the findings.  Raises MeshError, naming the file, if it cannot be read or used."""
    file = Path(path)
    try:
        if file.stat().st_size > MAX_FILE_BYTES:
            raise MeshError(f"the file has more than {MAX_FILE_BYTES / 1e6:.0f} MB", "export with a coarser tolerance")
        return inspect_bytes(file.read_bytes(), file.suffix, units)
    except OSError as error:
        raise MeshError(f"{file}: cannot be read: {error.strerror or error}", "check the path") from error
    except MeshError as error:
        raise MeshError(f"{file.name}: {error.message}", error.hint) from error


def load_bytes(data: bytes, suffix: str, units: str = "mm") -> Mesh:
    """As `load`, from the file's bytes and its suffix.  Raises MeshError."""
    return inspect_bytes(data, suffix, units).mesh


def inspect_bytes(data: bytes, suffix: str, units: str = "mm") -> LoadedMesh:
    """As `load_checked`, from the file's bytes and its suffix (".stl", ".3mf", ".obj" or ".ply").  Raises MeshError."""
    vertices, facets = read_geometry(data, suffix, units)
    mesh, findings = mended_mesh(vertices, facets)
    return LoadedMesh(mesh, findings, units, hashlib.sha256(data).hexdigest())
