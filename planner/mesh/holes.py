"""Small holes in a mesh: their rims, and flat patches that close them."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.errors import MeshError
from planner.mesh.adjacency import OPEN
from planner.mesh.findings import Finding, counted, place_text
from planner.mesh.mesh import Floats, Ints, Mesh

MAX_HOLE_FRACTION = 0.15
"""Widest hole that is closed, as a fraction of the part's diagonal: over it a flat patch leaves a round surface by
up to 0.15²/8 = 0.3 % of the diagonal, still a dent and not another shape; a missing face of a box is wider."""
MAX_HOLE_EDGES = 256
"""Longest rim that is closed: the patch is found in time growing with its cube (0.1 s at this length)."""
MAX_HOLES = 1000
"""Most holes that are closed (a few seconds): a mesh with more is a heap of facets."""
MAX_PATCH_FRACTION = 0.10
"""Largest share of the surface that patches may make up: beyond it the mesh is a ruin and its shape a guess."""
SLIT_FRACTION = 1e-6
"""Mean height of a patch, as a fraction of the part's diagonal, up to which a hole is a slit: 32-bit rounding."""
FLAT_COS = 1.0 - 5e-7
"""A patch within 0.001 rad of a facet beside it lies in that facet's face: above the tilt that 32-bit rounding gives a
facet, far below that of the neighbours on a curved surface."""
_CREASE_COS = 0.766
"""Facets that leave a patch by more than 40 degrees lie beyond an edge of the part and say nothing of its bulge."""


def close_holes(mesh: Mesh) -> tuple[Mesh, list[Finding]]:
    """Close every hole with a patch of least area over its rim.

    Returns the closed mesh and one Finding (none if there was no hole). Its volume change is that of the flat patches
    against the surface that the facets around them suggest (half of Phong tessellation, exact for circular arcs).
    Raises MeshError, with count, size and place, for holes beyond the limits of this module.
    """
    rims = rim_loops(mesh)
    if not rims:
        return mesh, []
    if len(rims) > MAX_HOLES:
        raise MeshError(
            f"not watertight: {counted(len(rims), 'hole')}, first at {place_text(mesh.vertices[rims[0]].mean(axis=0))}",
            f"at most {MAX_HOLES} are closed: repair the model and export it again",
        )
    _refuse_long(mesh, rims)
    known = _edge_keys(mesh.facets, len(mesh.vertices))
    added_keys = np.empty(0, dtype=np.int64)
    patches: list[Ints] = []
    for rim in rims:
        patch = _patch(mesh.vertices, rim, known, added_keys)
        patches.append(patch)
        added_keys = np.union1d(added_keys, _edge_keys(patch, len(mesh.vertices)))
    _refuse_wide(mesh, rims, patches)
    added = np.vstack(patches)
    closed = Mesh(mesh.vertices, np.vstack([mesh.facets, added]))
    surface_mm2 = float(closed.areas.sum())
    if surface_mm2 <= 0.0:
        raise MeshError(f"all {len(mesh.facets)} facets are degenerate: none has an area", "export a solid")
    share = float(closed.areas[len(mesh.facets) :].sum()) / surface_mm2
    place = mesh.vertices[rims[0]].mean(axis=0)
    if share > MAX_PATCH_FRACTION:
        raise MeshError(
            f"{counted(len(rims), 'hole')} make up {100 * share:.1f} % of the surface, first at {place_text(place)}",
            f"at most {100 * MAX_PATCH_FRACTION:g} % is closed: repair the model and export it again",
        )
    edges = sum(len(rim) for rim in rims)
    change = -_bulge_volume(mesh, added)
    percent = 100.0 * abs(change) / max(abs(closed.volume), 1e-300)
    text = (
        f"not watertight: {edges} open edges around {counted(len(rims), 'hole')}, "
        f"closed with {counted(len(added), 'facet')} ({percent:.2g} % of the volume)"
    )
    return closed, [Finding("open_edges", edges, place, True, change, text)]


def rim_loops(mesh: Mesh) -> list[Ints]:
    """Rims of all holes, each (k,) int64 vertex numbers in the direction in which a patch runs; no vertex twice."""
    mate = mesh.half_edge_mates
    is_open = (mesh.edge_state == OPEN).ravel()
    tail, rims = mesh.facets.ravel(), []
    seen: set[int] = set()
    for first in np.flatnonzero(is_open).tolist():
        if first in seen:
            continue
        walk, h = [], first
        while h not in seen:
            seen.add(h)
            walk.append(int(tail[h]))
            h = _next_in_facet(h)
            while not is_open[h]:
                h = _next_in_facet(int(mate[h]))
        rims += _simple_loops(walk)
    return [np.array(rim[::-1], dtype=np.int64) for rim in rims]


def _next_in_facet(h: int) -> int:
    return h - 2 if h % 3 == 2 else h + 1


def _simple_loops(walk: list[int]) -> list[list[int]]:
    """Split a closed walk where it comes back to a vertex."""
    loops: list[list[int]] = []
    stack: list[int] = []
    for vertex in walk:
        if vertex in stack:
            at = stack.index(vertex)
            loops.append(stack[at:])
            del stack[at:]
        stack.append(vertex)
    return [loop for loop in [*loops, stack] if len(loop) >= 3]


def _refuse_long(mesh: Mesh, rims: list[Ints]) -> None:
    """Raise MeshError if a rim is longer than what is closed."""
    longest = max(rims, key=len)
    if len(longest) > MAX_HOLE_EDGES:
        _refuse_hole(mesh, rims, longest)


def _refuse_wide(mesh: Mesh, rims: list[Ints], patches: list[Ints]) -> None:
    """Raise MeshError if a hole is wider than what is closed.

    Slits (vertices on a neighbour's edge) and holes in a flat face have no width: there the patch is the shape.
    """
    rows, slots = np.nonzero(mesh.edge_state == OPEN)
    ends = zip(mesh.facets[rows, slots].tolist(), mesh.facets[rows, (slots + 1) % 3].tolist(), strict=True)
    beside = dict(zip(ends, rows.tolist(), strict=True))
    widths = []
    for rim, patch in zip(rims, patches, strict=True):
        corners = mesh.vertices[patch]
        vectors = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(vectors, axis=1)
        extent = float(np.linalg.norm(np.ptp(mesh.vertices[rim], axis=0)))
        is_slit = areas.sum() <= SLIT_FRACTION * mesh.diagonal * extent
        around = [beside[int(b), int(a)] for a, b in zip(rim, np.roll(rim, -1), strict=True)]
        in_plane = vectors @ mesh.normals[around].T >= FLAT_COS * areas[:, None]
        widths.append(0.0 if is_slit or in_plane.all(axis=0).any() else extent)
    widest = int(np.argmax(widths))
    if widths[widest] > MAX_HOLE_FRACTION * mesh.diagonal:
        _refuse_hole(mesh, rims, rims[widest])


def _refuse_hole(mesh: Mesh, rims: list[Ints], rim: Ints) -> None:
    """Raise MeshError about this hole."""
    extent = float(np.linalg.norm(np.ptp(mesh.vertices[rim], axis=0)))
    raise MeshError(
        f"not watertight: {counted(len(rims), 'hole')}, the largest {extent:.4g} mm wide with {len(rim)} open edges "
        f"around {place_text(mesh.vertices[rim].mean(axis=0))}",
        f"only holes up to {MAX_HOLE_FRACTION * mesh.diagonal:.3g} mm and {MAX_HOLE_EDGES} edges are closed: "
        "repair the model and export it again",
    )


def _edge_keys(facets: Ints, vertex_count: int) -> Ints:
    """Sorted numbers low * vertex_count + high of all edges."""
    low = np.minimum(facets, np.roll(facets, -1, axis=1))
    high = np.maximum(facets, np.roll(facets, -1, axis=1))
    return np.unique(low * vertex_count + high)


def _holds(keys: Ints, wanted: Ints) -> NDArray[np.bool_]:
    """Which of the wanted numbers are among the sorted keys."""
    at = np.searchsorted(keys, wanted)
    found = at < len(keys)
    found[found] = keys[at[found]] == wanted[found]
    return found


def _patch(vertices: Floats, rim: Ints, known: Ints, added_keys: Ints) -> Ints:
    """Facets (k - 2, 3) over a rim of k vertices, least area, using no edge that the mesh or a patch has already."""
    count = len(rim)
    low, high = np.minimum.outer(rim, rim), np.maximum.outer(rim, rim)
    keys = low * len(vertices) + high
    taken = _holds(known, keys) | _holds(added_keys, keys)
    near = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    taken[(near <= 1) | (near == count - 1)] = False
    cost, apex = least_area_fan(vertices[rim], taken)
    if not np.isfinite(cost):
        raise MeshError(
            f"a hole with {count} open edges around {place_text(vertices[rim].mean(axis=0))} cannot be closed "
            "without crossing the facets beside it",
            "repair the model and export it again",
        )
    facets, chords = [], [(0, count - 1)]
    while chords:
        i, k = chords.pop()
        if k - i >= 2:
            j = int(apex[i, k])
            facets.append((rim[i], rim[j], rim[k]))
            chords += [(i, j), (j, k)]
    return np.array(facets, dtype=np.int64)


@njit(cache=True)
def least_area_fan(points: Floats, taken: NDArray[np.bool_]) -> tuple[float, Ints]:
    """Triangulation of least area of a closed polygon in space, by dynamic programming over its chords.

    points : (k, 3) float mm;  taken : (k, k) bool, chords that must not be used
    Returns the area (inf if there is none) and apex : (k, k) int64, the third corner over chord i < j.
    Source: Barequet and Sharir, Filling gaps in the boundary of a polyhedron, CAGD 12 (1995).
    """
    count = points.shape[0]
    cost = np.zeros((count, count), np.float64)
    apex = np.full((count, count), -1, np.int64)
    for gap in range(2, count):
        for i in range(count - gap):
            k = i + gap
            cost[i, k] = np.inf
            if taken[i, k]:
                continue
            for j in range(i + 1, k):
                a = points[j] - points[i]
                b = points[k] - points[i]
                x = a[1] * b[2] - a[2] * b[1]
                y = a[2] * b[0] - a[0] * b[2]
                z = a[0] * b[1] - a[1] * b[0]
                total = cost[i, j] + cost[j, k] + 0.5 * np.sqrt(x * x + y * y + z * z)
                if total < cost[i, k]:
                    cost[i, k] = total
                    apex[i, k] = j
    return cost[0, count - 1], apex


def _bulge_volume(mesh: Mesh, patch: Ints) -> float:
    """Volume (mm³) between flat facets, patch (k, 3), and the round surface that the facets around suggest.

    Source: Boubekeur and Alexa, Phong tessellation (2008), with factor 1/2; the integral of two barycentric
    coordinates over a triangle of area A is A/12.
    """
    corners = mesh.vertices[patch]
    flat = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    around = np.flatnonzero(np.isin(mesh.facets, patch).any(axis=1))
    total = 0.0
    for facet, points, area_vector in zip(patch, corners, flat, strict=True):
        area = float(np.linalg.norm(area_vector))
        if area == 0.0:
            continue
        smooth = around[mesh.normals[around] @ (area_vector / area) > _CREASE_COS]
        normals = np.zeros((3, 3))
        for i, vertex in enumerate(facet):
            summed = mesh.area_vectors[smooth[(mesh.facets[smooth] == vertex).any(axis=1)]].sum(axis=0)
            length = float(np.linalg.norm(summed))
            normals[i] = summed / length if length > 0.0 else area_vector / area
        for i, j in ((0, 1), (1, 2), (2, 0)):
            along = points[j] - points[i]
            shift = -(along @ normals[i]) * normals[i] + (along @ normals[j]) * normals[j]
            total += 0.5 * float(area_vector @ shift) / 12.0
    return total
