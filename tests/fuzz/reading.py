"""What must hold for every input of a reader: a sound mesh, or one line that says what is wrong."""

from __future__ import annotations

import numpy as np

from planner.errors import MeshError
from planner.mesh import load_bytes


def assert_mesh_or_one_line(data: bytes, suffix: str) -> bool:
    """Read a file; whether it gave a mesh. Any exception but MeshError passes; AssertionError if either is not sound."""
    try:
        mesh = load_bytes(data, suffix)
    except MeshError as error:
        assert error.message and "\n" not in str(error), repr(str(error))
        return False
    assert mesh.is_closed
    assert np.isfinite(mesh.vertices).all()
    assert mesh.volume > 0.0
    return True
