"""Small sound files of every format, from which damaged ones are made."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import trimesh

CONTENT_TYPES = (
    '<?xml version="1.0"?><Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
)
MODEL = "3D/3dmodel.model"


def tetrahedron() -> trimesh.Trimesh:
    """A corner of a cube of 10 mm."""
    corners = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10]], dtype=float)
    return trimesh.Trimesh(corners, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], process=False)


def model_3mf(unit: str = "millimeter", build: str = '<item objectid="1"/>', extra: str = "") -> str:
    """The model part of a 3MF file that holds the tetrahedron as object 1."""
    shape = tetrahedron()
    vertices = "".join(f'<vertex x="{x:g}" y="{y:g}" z="{z:g}"/>' for x, y, z in shape.vertices.tolist())
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in shape.faces.tolist())
    return (
        f'<?xml version="1.0"?><model unit="{unit}" xml:lang="en-US" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
        f'<object id="1" type="model"><mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>'
        f"</object>{extra}</resources><build>{build}</build></model>"
    )


def archive(model: bytes, name: str = MODEL) -> bytes:
    """A 3MF file around a model part."""
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as folder:
        folder.writestr("[Content_Types].xml", CONTENT_TYPES)
        folder.writestr(name, model)
    return target.getvalue()


def as_bytes(exported: object) -> bytes:
    """What trimesh exports, text or bytes, as bytes."""
    return exported.encode() if isinstance(exported, str) else bytes(exported)  # type: ignore[call-overload, no-any-return]


def seeds(suffix: str) -> list[bytes]:
    """Sound files of one format (".stl", ".obj", ".ply" or ".3mf")."""
    if suffix == ".3mf":
        return [archive(model_3mf().encode())]
    kinds = {".stl": ("stl", "stl_ascii"), ".obj": ("obj",), ".ply": ("ply",)}[suffix]
    files = [as_bytes(tetrahedron().export(file_type=kind)) for kind in kinds]
    if suffix == ".ply":
        files.append(as_bytes(trimesh.exchange.ply.export_ply(tetrahedron(), encoding="ascii")))
    return files
