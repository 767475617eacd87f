"""Facets without area: removed by giving their longest edge's neighbour the vertex on it, so that nothing opens."""

from __future__ import annotations

import numpy as np

from planner.mesh.facets import flat_mask
from planner.mesh.findings import Finding, counted
from planner.mesh.mesh import Floats, Ints, Mesh

FLAT_FRACTION = 1e-9
"""Height of a facet, as a fraction of the part's diagonal, below which it has no area: below the rounding of 32-bit
coordinates (6e-8), so that only facets whose corners lie on one line are meant."""
_MAX_ROUNDS = 8
"""Flips that one flat facet may need in turn, where several lie on one line."""


def flat_facets(vertices: Floats, facets: Ints, diagonal: float) -> Ints:
    """Numbers of the facets whose height over their longest edge is below FLAT_FRACTION of the diagonal (mm)."""
    return np.flatnonzero(flat_mask(vertices, facets, FLAT_FRACTION * diagonal))


def flip_slivers(mesh: Mesh) -> tuple[Mesh, list[Finding]]:
    """Remove the facets without area from a closed mesh; it stays closed and keeps its shape.

    Returns the mesh and a Finding for those removed and one for those that had to stay (none if there are none).
    """
    flat = flat_facets(mesh.vertices, mesh.facets, mesh.diagonal)
    if not len(flat):
        return mesh, []
    before, place, start = len(flat), mesh.centroids[flat[0]], mesh
    for _ in range(_MAX_ROUNDS):
        flipped = _flip_round(mesh, flat)
        if np.array_equal(flipped, mesh.facets):
            break
        mesh = Mesh(mesh.vertices, flipped)
        flat = flat_facets(mesh.vertices, mesh.facets, mesh.diagonal)
        if not len(flat):
            break
    findings = []
    if before > len(flat):
        change = mesh.volume - start.volume
        text = (
            counted(before - len(flat), "degenerate facet")
            + " (corners on one line) replaced by dividing facets beside"
        )
        findings.append(Finding("degenerate_facets", before - len(flat), place, True, change, text))
    if len(flat):
        text = (
            counted(len(flat), "degenerate facet")
            + " (corners on one line) could not be removed; slicing is not harmed"
        )
        findings.append(Finding("degenerate_facets", len(flat), mesh.centroids[flat[0]], False, 0.0, text))
    return mesh, findings


def _vertices_beside(mesh: Mesh, vertices: Ints) -> dict[int, set[int]]:
    """For each of the vertices all that share a facet with it."""
    wanted = np.zeros(len(mesh.vertices), dtype=bool)
    wanted[vertices] = True
    beside: dict[int, set[int]] = {int(v): set() for v in vertices}
    for corners in mesh.facets[wanted[mesh.facets].any(axis=1)].tolist():
        for v in corners:
            if v in beside:
                beside[v].update(corners)
    return beside


def _flip_round(mesh: Mesh, flat: Ints) -> Ints:
    """Facets after flipping the longest edge of every flat facet whose neighbourhood no other flip has touched."""
    facets = mesh.facets.copy()
    touched: set[int] = set()
    beside = _vertices_beside(mesh, np.unique(mesh.facets[flat]))
    for f in flat.tolist():
        corners = mesh.vertices[mesh.facets[f]]
        j = int(np.argmax(np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)))
        g = int(mesh.adjacency[f, j])
        ring = {f, g, *mesh.adjacency[f].tolist(), *mesh.adjacency[g].tolist()}
        if g < 0 or ring & touched:
            continue
        p, q, r = (int(mesh.facets[f, (j + i) % 3]) for i in range(3))
        s = next(int(v) for v in mesh.facets[g] if v not in (p, q))
        if s == r or s in beside[r]:
            continue
        facets[f] = (p, s, r)
        facets[g] = (s, q, r)
        touched |= ring
    return facets
