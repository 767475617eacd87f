"""Parts of which something hangs in every way, with figures known beforehand. All stand on z = 0."""

from __future__ import annotations

import trimesh

from planner.mesh.mesh import Mesh


def _body(*low_high: tuple[tuple[float, float, float], tuple[float, float, float]]) -> Mesh:
    boxes = [trimesh.creation.box(bounds=pair) for pair in low_high]
    return Mesh.from_trimesh(trimesh.boolean.union(boxes))


def bridge() -> Mesh:
    """A lintel of 30 x 10 x 5 mm on two piers of 6 x 10 x 16 mm: 18 x 10 mm of it hang."""
    return _body(
        ((-15.0, -5.0, 0.0), (-9.0, 5.0, 16.0)),
        ((9.0, -5.0, 0.0), (15.0, 5.0, 16.0)),
        ((-15.0, -5.0, 16.0), (15.0, 5.0, 21.0)),
    )


def mushroom() -> Mesh:
    """A cap of radius 14 mm, 5 mm thick, on a stem of radius 4 mm, 15 mm high."""
    stem = trimesh.creation.cylinder(4.0, 15.0, sections=48)
    stem.apply_translation([0.0, 0.0, 7.5])
    cap = trimesh.creation.cylinder(14.0, 5.0, sections=48)
    cap.apply_translation([0.0, 0.0, 17.5])
    return Mesh.from_trimesh(trimesh.boolean.union([stem, cap]))


def shelf() -> Mesh:
    """A wall of 6 x 12 x 24 mm with a shelf of 12 x 12 x 4 mm that hangs 10 mm over the plate."""
    return _body(((0.0, -6.0, 0.0), (6.0, 6.0, 24.0)), ((6.0, -6.0, 10.0), (18.0, 6.0, 14.0)))


def hollow() -> Mesh:
    """A closed box of 30 x 30 x 25 mm with a void of 20 x 20 x 15 mm."""
    outer = trimesh.creation.box(bounds=((-15.0, -15.0, 0.0), (15.0, 15.0, 25.0)))
    inner = trimesh.creation.box(bounds=((-10.0, -10.0, 5.0), (10.0, 10.0, 20.0)))
    inner.invert()
    return Mesh.from_trimesh(trimesh.util.concatenate([outer, inner]))


def high_bridge() -> Mesh:
    """A lintel of 30 x 8 x 5 mm on two piers of 6 x 8 x 32 mm: 18 x 8 mm of it hang, high enough for a level cutter."""
    return _body(
        ((-15.0, -4.0, 0.0), (-9.0, 4.0, 32.0)), ((9.0, -4.0, 0.0), (15.0, 4.0, 32.0)), ((-15.0, -4.0, 32.0), (15.0, 4.0, 37.0))
    )
