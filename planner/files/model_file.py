"""A model as a file: STL, glTF (.glb) or STEP."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import trimesh
from trimesh.visual import material as materials

from planner.errors import FileFormatError, InputError
from planner.mesh.mesh import Mesh

if TYPE_CHECKING:
    from planner.model import Approximation

SUFFIXES = (".stl", ".glb", ".step", ".stp")
"""What `write_model` writes."""
_MODEL_COLOUR = (70, 130, 180, 255)
_MESH_COLOUR = (160, 160, 160, 70)


def write_model(model: Approximation, path: str | Path, *, with_original: bool = False) -> None:
    """Write a model; the suffix says how.  with_original : .glb only, the mesh as a second, transparent node.

    Raises InputError for another suffix; FileFormatError, one line, if the file cannot be written or OpenCascade is missing.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    checked_suffix(target)
    if suffix == ".stl":
        data = stl_bytes(model.triangles())
    elif suffix == ".glb":
        data = glb_bytes(model.triangles(), model.mesh if with_original else None)
    else:
        from planner.files.step_file import step_bytes

        data = step_bytes(model, target.stem)
    beside = target.with_name(target.name + ".part")
    try:
        beside.write_bytes(data)
        os.replace(beside, target)
    except OSError as error:
        raise FileFormatError(f"{target}: cannot be written: {error.strerror}", "name a writable place") from None


def checked_suffix(path: Path) -> Path:
    """The path, if a model can be written to it.  Raises InputError."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(
            f"{path}: a model is no {path.suffix or 'file without suffix'}", f"end in {', '.join(SUFFIXES)}"
        )
    return path


def stl_bytes(mesh: Mesh) -> bytes:
    """Binary STL, mm."""
    body: Any = mesh.to_trimesh()
    return bytes(body.export(file_type="stl"))


def glb_bytes(model: Mesh, original: Mesh | None = None) -> bytes:
    """Binary glTF in metres, as glTF has it, with the nodes "model" and, if given, "original" (transparent)."""
    scene: Any = trimesh.Scene()
    visual: Any = trimesh.visual
    kinds: Any = materials
    for name, mesh, colour in (("model", model, _MODEL_COLOUR), ("original", original, _MESH_COLOUR)):
        if mesh is None:
            continue
        body: Any = mesh.to_trimesh()
        body.apply_scale(1e-3)
        opaque = "OPAQUE" if colour[3] == 255 else "BLEND"
        surface = kinds.PBRMaterial(
            name=name, baseColorFactor=colour, metallicFactor=0.1, roughnessFactor=0.6, alphaMode=opaque
        )
        body.visual = visual.TextureVisuals(material=surface)
        scene.add_geometry(body, node_name=name, geom_name=name)
    return bytes(scene.export(file_type="glb"))
