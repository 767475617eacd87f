"""What of a body cannot stay up while it grows along a direction, facet by facet: fast enough for a search."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.decompose.corners import seeds_of, shares_beyond, spans
from planner.decompose.overhang import LEVEL_DEG, tilted_limit_deg
from planner.mesh.facets import pieces_of
from planner.mesh.mesh import Mesh
from planner.process import Settings

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

_ON_BASE_MM = 0.05  # facets within this of the base plane lie on it
_CLOSED = 0.7  # of a patch with carried metal around it, as at the pole of a dome, at most this share has no carried corner


@dataclass(frozen=True)
class Limits:
    """What holds while it grows: by itself up to `upright_deg` of lean, with the head tilted up to `tilted_deg`.

    reach_mm : how far an underside may reach beyond what carries it   patch_mm2 : smaller hanging patches close from their rims
    foot_mm : up to this height over the plate, times the sine of its lean, a wall that leans over the plate is out of reach
    """

    upright_deg: float
    tilted_deg: float
    reach_mm: float
    patch_mm2: float
    foot_mm: float

    @classmethod
    def of(cls, settings: Settings) -> Limits:
        """The material's, and the cutter's width."""
        facts = settings.material.deposition
        tilted = tilted_limit_deg(facts) if settings.recipe.overhang == "tilt" else facts.max_overhang_deg
        width = settings.bead_for(settings.layer_min_mm).width_mm
        foot = settings.cutter_diameter_mm if settings.is_milled else width
        return cls(facts.max_overhang_deg, tilted, facts.max_unsupported_mm, np.pi * width**2, foot)


@dataclass(frozen=True, eq=False)
class Hanging:
    """What hangs of a body, projected areas in mm².

    weights : (m,) float, mm²   of each facet, what no tilt of the head carries
    total_mm2 : their sum   tilted_mm2 : what holds with the head tilted only
    foot_mm2 : of that, what leans so low over the plate that no cutter comes to it   base_mm2 : area on which it stands
    """

    weights: Floats
    total_mm2: float
    tilted_mm2: float
    foot_mm2: float
    base_mm2: float


def hanging(mesh: Mesh, base: Floats, cap: Flags | None, limits: Limits, spared: Flags | None = None) -> Hanging:
    """What hangs of a body that grows from its base along the base's direction.

    base : (6,) float, point (mm) and unit direction   cap : (m,) bool, facets that stand on metal; None: all that lie in the base
    plane do, as on a plate   spared : (m,) bool, facets that are not looked at (bores that are cut afterwards)

    Metal is carried from the base upwards along the surface: over edges that rise by more than 90° - `LEVEL_DEG` as far
    as they go, over level ones as far as an underside may reach. A facet that looks down and has corners that nothing
    carries hangs; so does an underside between carried corners that is wider than twice the reach.
    """
    direction = base[3:]
    height = (mesh.vertices - base[:3]) @ direction
    facing = mesh.normals @ direction
    bottom, top = spans(height, mesh.facets)
    stands = (bottom >= -_ON_BASE_MM) & (top <= _ON_BASE_MM) & (facing < -0.99) if cap is None else cap
    looks = (facing < -np.sin(np.radians(limits.upright_deg)) - 1e-6) & ~stands
    if spared is not None:
        looks &= ~spared
    weights = np.zeros(len(mesh.facets))
    area = mesh.areas * -facing
    base_mm2 = float(area[stands].sum())
    if not looks.any():
        return Hanging(weights, 0.0, 0.0, 0.0, base_mm2)
    seeds = seeds_of(mesh.facets, facing > 0.0, stands, len(mesh.vertices))
    run = _runs(mesh.vertices, mesh.facets, direction, height, seeds, np.tan(np.radians(90.0 - LEVEL_DEG)), limits.reach_mm)
    free = shares_beyond(run, mesh.facets, limits.reach_mm)
    level = looks & (facing < -np.sin(np.radians(limits.tilted_deg)) - 1e-9)
    weights[looks] = (area * free)[looks]
    hangs = looks & (level | (free > 0.0))
    if hangs.any():
        weights = _patches(mesh, np.where(level, area, weights), hangs, level, free, limits)
    tilted = np.where(looks, area, 0.0) - weights
    foot = looks & (top < limits.foot_mm * -facing) if cap is None else np.zeros(len(looks), dtype=np.bool_)
    return Hanging(weights, float(weights.sum()), float(tilted.sum()), float(tilted[foot].sum()), base_mm2)


def _patches(mesh: Mesh, weights: Floats, hangs: Flags, level: Flags, free: Floats, limits: Limits) -> Floats:
    """Weights without those of connected patches that are small, or level, carried and narrow."""
    rows = np.flatnonzero(hangs)
    mate = mesh.across.reshape(-1, 3)[rows].astype(np.int64)
    local = np.full(len(hangs), -1)
    local[rows] = np.arange(len(rows))
    joined = (mate >= 0) & hangs[np.maximum(mate, 0) // 3]
    across = np.where(joined, 3 * local[np.maximum(mate, 0) // 3] + mate % 3, -1)
    patch, count = pieces_of(across.ravel().astype(np.int32))
    own, corners = weights[rows], mesh.corners[rows]
    area = np.bincount(patch, weights=own, minlength=count)
    edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    rim = np.bincount(patch, weights=np.where(joined, 0.0, edges).sum(axis=1), minlength=count)
    only_level = np.bincount(patch, weights=(~level[rows]).astype(np.float64), minlength=count) == 0
    loose = np.bincount(patch, weights=own * free[rows], minlength=count) > _CLOSED * area
    fine = ((area < limits.patch_mm2) & ~loose) | (only_level & (area < limits.reach_mm * rim))
    kept = np.zeros(len(hangs))
    kept[rows] = np.where(fine[patch], 0.0, own)
    return kept


@njit(cache=True)
def _runs(
    vertices: Floats, facets: Ints, direction: Floats, height: Floats, seeds: Flags, rise: float, reach: float
) -> Floats:  # pragma: no cover
    """How far, mm, level, each vertex is from where it is carried: (n,), inf where nothing leads up to it.

    Dijkstra's shortest paths over the mesh's edges: an edge that climbs more than `rise` per mm of level run costs
    nothing, one that falls by more is no way, any other costs its run. No way leads on from beyond the reach.
    """
    count = vertices.shape[0]
    first = np.zeros(count + 1, np.int64)
    for f in range(facets.shape[0]):
        for k in range(3):
            first[facets[f, k] + 1] += 2
    for v in range(count):
        first[v + 1] += first[v]
    fill = first[:-1].copy()
    others = np.empty(first[count], np.int64)
    for f in range(facets.shape[0]):
        for k in range(3):
            a = facets[f, k]
            for b in (facets[f, (k + 1) % 3], facets[f, (k + 2) % 3]):
                others[fill[a]] = b
                fill[a] += 1
    run = np.full(count, np.inf)
    queue = [(0.0, -1)]
    for v in range(count):
        if seeds[v]:
            run[v] = 0.0
    for v in range(count):
        if seeds[v]:
            for slot in range(first[v], first[v + 1]):
                if not seeds[others[slot]]:
                    queue.append((0.0, v))
                    break
    heapq.heapify(queue)
    while len(queue) > 0:
        at, v = heapq.heappop(queue)
        if v < 0 or at > run[v] or at > reach:
            continue
        for slot in range(first[v], first[v + 1]):
            w = others[slot]
            climb = height[w] - height[v]
            square = -climb * climb
            for axis in range(3):
                square += (vertices[w, axis] - vertices[v, axis]) ** 2
            level = np.sqrt(max(square, 0.0))
            if climb < -rise * level - 1e-9:
                continue
            then = 0.0 if climb > rise * level else at + level
            if then < run[w]:
                run[w] = then
                heapq.heappush(queue, (then, w))
    return run
