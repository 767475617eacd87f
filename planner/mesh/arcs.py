"""Normals where the curvature of a surface jumps: its edges as arcs, which leave their chord equally at both ends."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

_SWEEPS = 4  # the far end of an edge may itself lie at a jump
_LEAST_RAD = 0.01  # edges that leave their chords at less say nothing
_AT_ODDS = 0.16  # square of the share of the far angles by which the near ones must differ from them
_BETTER = 0.12  # share of the sum of those squared differences that may remain with the new normal
_HOLD = 1e-3  # weight of the old normal beside all edges


def with_arc_ends(mesh: Mesh, left_out: Flags, fans: Ints, normals: Floats) -> Floats:
    """Normals corrected at vertices whose edges can all be arcs but are not: (m, 3, 3) float, unit.

    left_out : (m, 3) bool   edges that say nothing (creases, diagonals of plane faces)
    fans, normals : as in `SmoothSurface`
    An edge over a circular arc or a straight line leaves its chord by the same angle at both ends. A mean of facet
    normals breaks that where the curvature jumps, as between a fillet and the long strips beside it: the mean leans to
    the short facets, and the curves over long ones would bulge by many times their sagitta. There the normal is the
    one, by least squares weighted with 1 / length², with which each edge leaves this vertex as it arrives at its other
    end; it is taken only where it explains the edges much better.
    """
    number, flat = fans.ravel(), normals.reshape(-1, 3)
    size = int(fans.max(initial=-1)) + 1
    first = np.zeros(size, dtype=np.int64)
    first[number[::-1]] = np.arange(len(number))[::-1]
    own = flat[first]
    is_shared = np.ones(size, dtype=bool)
    is_shared[number[(flat != own[number]).any(axis=1)]] = False
    current = flat
    for _ in range(_SWEEPS):
        sums = _gathered(mesh.vertices, mesh.facets, left_out, fans, flat, current, size)
        turned, rows = _turned(sums, own, is_shared)
        if not len(rows):
            return normals
        normal = own.copy()
        normal[rows] = turned
        current = np.where(is_shared[number, None], normal[number], flat)
    return np.asarray(current.reshape(-1, 3, 3))


def _turned(sums: Floats, own: Floats, is_shared: Flags) -> tuple[Floats, Ints]:
    """The new normals (k, 3) and the fans that take them (k,).  sums : from `_gathered`  own : (n, 3) float, unit."""
    total, before, angle = sums[:, 0], sums[:, 1], sums[:, 2]
    rows = np.flatnonzero(is_shared & (angle > _LEAST_RAD**2 * total) & (before > _AT_ODDS * angle))
    axis, pull = own[rows], sums[rows, 3:6]
    matrix = sums[rows][:, [6, 7, 8, 7, 9, 10, 8, 10, 11]].reshape(-1, 3, 3)
    hold = total[rows, None, None] * (_HOLD * np.eye(3) + axis[:, :, None] * axis[:, None, :])
    lean = np.linalg.solve(matrix + hold, -pull[:, :, None])[:, :, 0]
    left = before[rows] + 2.0 * np.einsum("ni,ni->n", lean, pull) + np.einsum("ni,nij,nj->n", lean, matrix, lean)
    taken = left < _BETTER * before[rows]
    turned = axis[taken] + lean[taken]
    return turned / np.linalg.norm(turned, axis=1)[:, None], rows[taken]


@njit(cache=True, error_model="numpy", nogil=True)
def _gathered(
    vertices: Floats, facets: Ints, left_out: Flags, fans: Ints, origin: Floats, current: Floats, size: int
) -> Floats:  # pragma: no cover
    """Sums over the edges of each fan, both ways: (size, 12) float.

    With weight w = 1 / length², unit vector u along the edge from the fan, near = origin · u, far = current · u of the
    other end: w, w (near + far)², w far², w (near + far) u, and w u uᵀ (xx, xy, xz, yy, yz, zz).
    origin, current : (3m, 3) float   normal of each corner
    """
    sums = np.zeros((size, 12))
    u = np.empty(3)
    for f in range(facets.shape[0]):
        for k in range(3):
            if left_out[f, k]:
                continue
            following = (k + 1) % 3
            length2 = 0.0
            for i in range(3):
                u[i] = vertices[facets[f, following], i] - vertices[facets[f, k], i]
                length2 += u[i] * u[i]
            if length2 == 0.0:
                continue
            length, w = np.sqrt(length2), 1.0 / length2
            for i in range(3):
                u[i] /= length
            for here, there in ((k, following), (following, k)):
                row, near, far = fans[f, here], 0.0, 0.0
                for i in range(3):
                    near += origin[3 * f + here, i] * u[i]
                    far += current[3 * f + there, i] * u[i]
                odds = near + far
                sums[row, 0] += w
                sums[row, 1] += w * odds * odds
                sums[row, 2] += w * far * far
                place = 6
                for i in range(3):
                    sums[row, 3 + i] += w * odds * u[i]
                    for j in range(i, 3):
                        sums[row, place] += w * u[i] * u[j]
                        place += 1
                for i in range(3):
                    u[i] = -u[i]
    return sums
