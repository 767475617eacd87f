"""How deep two convex bodies are in each other: a polytope inside their difference grows until its nearest face is the difference's own.

Source: van den Bergen, Collision Detection in Interactive 3D Environments (2003), 4.3.8, expanding polytope algorithm.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.collide.convex import difference

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_CORNERS = 96
_FACES = 256
_CLOSE_MM = 2e-3  # between the face and the difference's boundary behind it
_SAME_MM = 1e-7
_FLAT_MM2 = 1e-10


@njit(cache=True)
def depth(
    kinds: tuple[int, int], sizes: tuple[Floats, Floats], points: tuple[Floats, Floats], pose: Floats,
    corners: Floats, on_a: Floats, count: int, at: Floats,
) -> float:  # fmt: skip
    """The least way (mm) that parts bodies A and B; to 2e-3, never more than it is.

    pose : (3, 4) float, A's frame from B's   corners, on_a : (4, 3), the first `count` of them a simplex that holds the origin
    at : (3,), gets A's deepest point, A's frame
    """
    w, a = np.empty((_CORNERS, 3)), np.empty((_CORNERS, 3))
    w[:4], a[:4] = corners, on_a
    at[:] = a[0]
    if not _filled(kinds, sizes, points, pose, w, a, count):
        return 0.0
    inner = (w[0] + w[1] + w[2] + w[3]) / 4.0
    face, plane = np.empty((_FACES, 3), dtype=np.int64), np.empty((_FACES, 4))
    faces = 0
    for i, j, k in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)):
        faces = _add(face, plane, faces, w, i, j, k, inner)
    size = 4
    edges = np.empty((_FACES, 2), dtype=np.int64)
    best = 0
    while True:
        best = int(np.argmin(plane[:faces, 3]))
        if size == _CORNERS or faces > _FACES - 40:
            break
        difference(kinds, sizes, points, pose, plane[best, :3], w[size], a[size])
        if float(np.dot(w[size], plane[best, :3])) - plane[best, 3] < _CLOSE_MM:
            break
        faces = _opened(face, plane, faces, edges, w[size])
        rim = edges[0, 0]
        if rim == 0:
            break
        for k in range(1, rim + 1):
            faces = _add(face, plane, faces, w, edges[k, 0], edges[k, 1], size, inner)
        size += 1
    _on_face(w, a, face[best], plane[best], at)
    return float(max(plane[best, 3], 0.0))


@njit(cache=True)
def _filled(
    kinds: tuple[int, int], sizes: tuple[Floats, Floats], points: tuple[Floats, Floats], pose: Floats, w: Floats, a: Floats, count: int
) -> bool:
    """Make a simplex of `count` corners a tetrahedron; False where the difference is flat there."""
    d = np.zeros(3)
    while count < 4:
        found = False
        for trial in range(6):
            d[:] = 0.0
            d[trial % 3] = 1.0
            if count == 2:
                d = np.cross(d, w[1] - w[0])
            elif count == 3:
                d = np.cross(w[1] - w[0], w[2] - w[0])
            if trial >= 3:
                d = -d
            if np.dot(d, d) == 0.0:
                continue
            difference(kinds, sizes, points, pose, d, w[count], a[count])
            if _widens(w, count):
                found = True
                break
        if not found:
            return False
        count += 1
    return True


@njit(cache=True)
def _widens(w: Floats, count: int) -> bool:
    """Whether corner `count` lies off the point, line or plane of those before it."""
    new = w[count] - w[0]
    if count == 1:
        return bool(np.dot(new, new) > _SAME_MM)
    if count == 2:
        across = np.cross(w[1] - w[0], new)
        return bool(np.dot(across, across) > _SAME_MM)
    return bool(abs(np.dot(np.cross(w[1] - w[0], w[2] - w[0]), new)) > _SAME_MM)


@njit(cache=True)
def _add(face: Ints, plane: Floats, faces: int, w: Floats, i: int, j: int, k: int, inner: Floats) -> int:
    """Add a face with its outward plane; how many there are then. A face without area is left out: its neighbours close over it."""
    normal = np.cross(w[j] - w[i], w[k] - w[i])
    square = np.dot(normal, normal)
    if square < _FLAT_MM2 * _FLAT_MM2:
        normal = w[k] - inner
        square = np.dot(normal, normal)
        level = np.inf
    else:
        level = 0.0
    normal = normal / np.sqrt(square)
    away = np.dot(normal, w[i])
    if away < np.dot(normal, inner):
        normal, away = -normal, -away
    face[faces, 0], face[faces, 1], face[faces, 2] = i, j, k
    plane[faces, :3] = normal
    plane[faces, 3] = max(away, level)
    return faces + 1


@njit(cache=True)
def _opened(face: Ints, plane: Floats, faces: int, edges: Ints, new: Floats) -> int:
    """Take out the faces that a new corner sees; how many are left. edges : row 0 gets the number of edges of the hole, the rest are they."""
    rim = 0
    kept = 0
    for f in range(faces):
        is_seen = plane[f, 3] < np.inf and plane[f, 0] * new[0] + plane[f, 1] * new[1] + plane[f, 2] * new[2] > plane[f, 3] + _SAME_MM
        if not is_seen:
            face[kept], plane[kept] = face[f], plane[f]
            kept += 1
            continue
        for i in range(3):
            begin, end = min(face[f, i], face[f, (i + 1) % 3]), max(face[f, i], face[f, (i + 1) % 3])
            double = 0
            for k in range(1, rim + 1):
                if edges[k, 0] == begin and edges[k, 1] == end:
                    double = k
            if double:
                edges[double] = edges[rim]
                rim -= 1
            else:
                rim += 1
                edges[rim, 0], edges[rim, 1] = begin, end
    edges[0, 0] = rim
    return kept


@njit(cache=True)
def _on_face(w: Floats, a: Floats, face: Ints, plane: Floats, at: Floats) -> None:
    """A's point (3,) behind the point of a face that is nearest to the origin."""
    base = w[face[0]]
    first, second = w[face[1]] - base, w[face[2]] - base
    foot = plane[:3] * plane[3] - base
    g00, g01, g11 = np.dot(first, first), np.dot(first, second), np.dot(second, second)
    determinant = g00 * g11 - g01 * g01
    s, t = 0.0, 0.0
    if determinant > 0.0:
        r0, r1 = np.dot(foot, first), np.dot(foot, second)
        s, t = (r0 * g11 - r1 * g01) / determinant, (g00 * r1 - g01 * r0) / determinant
    for i in range(3):
        at[i] = (1.0 - s - t) * a[face[0], i] + s * a[face[1], i] + t * a[face[2], i]
