"""Cubic patches over the facets of a mesh, and how far points lie from them."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.mesh.smooth import SmoothSurface, edge_curves

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_STEPS = 8  # of Newton; three are enough where the facet stands for a smooth surface
_SETTLED = 1e-14  # square of a step, as a share of the patch: its error is the square of that again
_BESIDE = 0.3  # share of the patch by which a foot may lie outside it: there the neighbour's patch is meant


def facet_patches(surface: SmoothSurface, facets: Ints) -> Floats:
    """Bézier triangles: (n, 10, 3) float, mm: three corners, two points per edge (0-1, 1-2, 2-0), the middle one.

    Their borders are the curves of `edge_curves`, so that neighbours join without a gap; the middle point is that of
    curved PN triangles. Source: Vlachos, Peters, Boyd, Mitchell, Curved PN triangles, I3D 2001.
    """
    edges = [edge_curves(surface, facets, np.full(len(facets), k, dtype=np.int64))[0] for k in range(3)]
    corners = np.stack([edge[:, 0] for edge in edges], axis=1)
    inner = np.concatenate([edge[:, 1:3] for edge in edges], axis=1)
    middle = 1.5 * inner.mean(axis=1) - 0.5 * corners.mean(axis=1)
    return np.concatenate([corners, inner, middle[:, None]], axis=1)


def distances_to_patches(surface: SmoothSurface, points: Floats, facets: Ints, directions: Floats) -> Floats:
    """How far along a direction each point lies from the patch over a facet: (n,) float, mm, not negative.

    points : (n, 3) float, mm   facets : (n,) int64   directions : (n, 3) float, unit.
    NaN where the line misses the patch by more than a third of it.
    """
    used, row = np.unique(facets, return_inverse=True)
    nets = facet_patches(surface, used)
    return np.abs(_offsets(nets, row.reshape(-1).astype(np.int64), points, directions))


@njit(cache=True, error_model="numpy", nogil=True)
def _offsets(nets: Floats, rows: Ints, points: Floats, directions: Floats) -> Floats:  # pragma: no cover
    """s with point + s · direction on the patch, by Newton on the two patch coordinates and s; NaN where it fails."""
    result = np.full(points.shape[0], np.nan)
    at, by_v, by_w, rest, cross = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(points.shape[0]):
        net, p, d = nets[rows[k]], points[k], directions[k]
        for i in range(3):
            at[i], by_v[i], by_w[i] = net[0, i], net[1, i] - net[0, i], net[2, i] - net[0, i]
        size2 = _dot(by_v, by_v) + _dot(by_w, by_w)
        v, w, s = 0.0, 0.0, 0.0
        for _ in range(_STEPS):
            for i in range(3):
                rest[i] = at[i] - p[i] - s * d[i]
                cross[i] = by_v[(i + 1) % 3] * by_w[(i + 2) % 3] - by_v[(i + 2) % 3] * by_w[(i + 1) % 3]
            a, b, c = _dot(by_v, by_v), _dot(by_v, by_w), _dot(by_w, by_w)
            area2, across = a * c - b * b, _dot(d, cross)
            if across == 0.0 or area2 <= 0.0:
                break
            step_s = _dot(rest, cross) / across
            for i in range(3):
                rest[i] -= step_s * d[i]
            e, f = -_dot(rest, by_v), -_dot(rest, by_w)
            step_v, step_w = (e * c - f * b) / area2, (a * f - b * e) / area2
            v, w, s = v + step_v, w + step_w, s + step_s
            if not (v > -1.0 and w > -1.0 and v + w < 2.0):
                break
            if step_s * step_s < _SETTLED * size2 and step_v * step_v + step_w * step_w < _SETTLED:
                if v > -_BESIDE and w > -_BESIDE and v + w < 1.0 + _BESIDE:
                    result[k] = s
                break
            _patch_at(net, v, w, at, by_v, by_w)
    return result


@njit(cache=True, error_model="numpy", nogil=True)
def _dot(a: Floats, b: Floats) -> float:  # pragma: no cover
    product: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


@njit(cache=True, error_model="numpy", nogil=True)
def _patch_at(net: Floats, v: float, w: float, at: Floats, by_v: Floats, by_w: Floats) -> None:  # pragma: no cover
    """Point of the cubic patch at barycentric (1 - v - w, v, w) and its derivatives by v and w, into the arrays."""
    u = 1.0 - v - w
    for i in range(3):
        c0, c1, c2 = net[0, i], net[1, i], net[2, i]
        p01, p10, p12, p21, p20, p02 = net[3, i], net[4, i], net[5, i], net[6, i], net[7, i], net[8, i]
        m = net[9, i]
        at[i] = (
            c0 * u**3 + c1 * v**3 + c2 * w**3
            + 3.0 * (p01 * u * u * v + p10 * u * v * v + p12 * v * v * w + p21 * v * w * w + p20 * w * w * u + p02 * w * u * u)
            + 6.0 * m * u * v * w
        )  # fmt: skip
        du = 3.0 * (c0 * u * u + 2.0 * p01 * u * v + p10 * v * v + p20 * w * w + 2.0 * p02 * w * u + 2.0 * m * v * w)
        dv = 3.0 * (c1 * v * v + p01 * u * u + 2.0 * p10 * u * v + 2.0 * p12 * v * w + p21 * w * w + 2.0 * m * u * w)
        dw = 3.0 * (c2 * w * w + p12 * v * v + 2.0 * p21 * v * w + 2.0 * p20 * w * u + p02 * u * u + 2.0 * m * u * v)
        by_v[i], by_w[i] = dv - du, dw - du
