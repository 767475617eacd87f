"""From vertices and facets as read to a closed mesh, everything done to it said."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from planner.errors import MeshError
from planner.mesh.adjacency import CROWDED, OPEN, pair_half_edges
from planner.mesh.bodies import unite_bodies
from planner.mesh.facets import collapsed_mask
from planner.mesh.findings import Finding, counted, place_text
from planner.mesh.holes import close_holes
from planner.mesh.mesh import Floats, Ints, Mesh
from planner.mesh.selfcross import crossing_facets
from planner.mesh.slivers import flip_slivers
from planner.mesh.weld import unique_vertices
from planner.mesh.winding import agree_winding, turn_outward

WELD_FRACTION = 1e-6
"""Distance, as a fraction of the part's diagonal, at which vertices on open edges are one: 15 times the rounding of
32-bit coordinates, 0.05 micrometre on a part of 50 mm."""


def mended_mesh(vertices: Floats, facets: Ints) -> tuple[Mesh, list[Finding]]:
    """A closed, outward mesh of the same shape and what was wrong with what came in.

    vertices : (n, 3) float, mm;  facets : (m, 3) int64
    Raises MeshError, one line, for what cannot be mended without changing the shape: large holes, edges shared by
    three facets, one-sided surfaces, surfaces that pass through themselves, no volume.
    """
    welded, number = unique_vertices(vertices)
    mesh, findings = _without_collapsed(Mesh(welded, number[facets]), [])
    mesh, findings = _without_duplicates(mesh, findings)
    mesh, findings = _welded_near(mesh, findings)
    mesh, findings = _agreed(mesh, findings)
    _refuse_crowded(mesh)
    for step in (close_holes, turn_outward, flip_slivers, unite_bodies):
        mesh, found = step(mesh)
        findings += found
    _refuse_open(mesh)
    if mesh.volume <= 1e-12 * mesh.diagonal**3:
        raise MeshError(f"the mesh encloses no volume ({mesh.volume:.3g} mm³)", "export a solid, not a surface")
    findings += _self_crossings(mesh)
    return _compact(mesh), findings


def _compact(mesh: Mesh) -> Mesh:
    """The mesh without vertices that no facet uses."""
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[mesh.facets.ravel()] = True
    if used.all():
        return mesh
    return Mesh(mesh.vertices[used], (np.cumsum(used) - 1)[mesh.facets])


def _without_collapsed(mesh: Mesh, findings: list[Finding]) -> tuple[Mesh, list[Finding]]:
    """Remove facets that name a vertex twice."""
    facets = mesh.facets
    collapsed = collapsed_mask(facets)
    if not collapsed.any():
        return mesh, findings
    if collapsed.all():
        raise MeshError(f"all {len(facets)} facets are degenerate: no two corners apart", "export the model again")
    count, first = int(collapsed.sum()), int(np.flatnonzero(collapsed)[0])
    text = counted(count, "degenerate facet") + " (two equal corners) removed"
    found = Finding("degenerate_facets", count, mesh.centroids[first], True, 0.0, text)
    return Mesh(mesh.vertices, facets[~collapsed]), [*findings, found]


def _without_duplicates(mesh: Mesh, findings: list[Finding]) -> tuple[Mesh, list[Finding]]:
    """Remove facets over the same three vertices: all but one, or all where the surface is closed without them."""
    mate, state = pair_half_edges(mesh.facets, len(mesh.vertices))
    beside = (mate // 3).reshape(-1, 3)
    if not (state == CROWDED).any() and not (beside == beside[:, :1]).all(axis=1).any():
        return mesh, findings
    _, group, size = np.unique(np.sort(mesh.facets, axis=1), axis=0, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    doubled = size[group] > 1
    if not doubled.any():
        return mesh, findings
    keep = ~doubled
    vertex_count = len(mesh.vertices)
    low = np.minimum(mesh.facets, np.roll(mesh.facets, -1, axis=1))
    high = np.maximum(mesh.facets, np.roll(mesh.facets, -1, axis=1))
    keys = low * vertex_count + high
    others, uses = np.unique(keys[keep], return_counts=True)
    _, first = np.unique(group, return_index=True)
    for f in first[size > 1].tolist():
        at = np.searchsorted(others, keys[f])
        found = [
            int(uses[i]) if i < len(others) and others[i] == key else 0 for i, key in zip(at, keys[f], strict=True)
        ]
        keep[f] = any(count % 2 for count in found) or not any(found)
    removed = np.flatnonzero(~keep)
    result = Mesh(mesh.vertices, mesh.facets[keep])
    if not len(result.facets):
        raise MeshError("all facets come in pairs that cancel: the mesh encloses nothing", "export a solid")
    text = counted(len(removed), "duplicate facet") + " removed"
    finding = Finding("duplicate_facets", len(removed), mesh.centroids[removed[0]], True, 0.0, text)
    return result, [*findings, finding]


def _welded_near(mesh: Mesh, findings: list[Finding]) -> tuple[Mesh, list[Finding]]:
    """Make vertices on open edges one where they are nearer than WELD_FRACTION of the diagonal."""
    rows, slots = np.nonzero(mesh.edge_state == OPEN)
    if not len(rows):
        return mesh, findings
    rim = np.unique(np.concatenate([mesh.facets[rows, slots], mesh.facets[rows, (slots + 1) % 3]]))
    pairs = cKDTree(mesh.vertices[rim]).query_pairs(WELD_FRACTION * mesh.diagonal, output_type="ndarray")
    if not len(pairs):
        return mesh, findings
    links = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(rim), len(rim)))
    _, label = connected_components(links, directed=False)
    _, first = np.unique(label, return_index=True)
    number = np.arange(len(mesh.vertices))
    number[rim] = rim[first[label]]
    welded = Mesh(mesh.vertices, number[mesh.facets])
    count = len(rim) - len(first)
    text = f"{count} vertices on open edges within {WELD_FRACTION * mesh.diagonal:.2g} mm of another joined to it"
    finding = Finding(
        "near_duplicate_vertices", count, mesh.vertices[rim[pairs[0, 0]]], True, welded.volume - mesh.volume, text
    )
    welded, more = _without_collapsed(welded, [*findings, finding])
    return _without_duplicates(welded, more)


def _agreed(mesh: Mesh, findings: list[Finding]) -> tuple[Mesh, list[Finding]]:
    """Make neighbouring facets run the same way round."""
    agreed, turned = agree_winding(mesh)
    if not len(turned):
        return mesh, findings
    text = f"mixed winding: {counted(len(turned), 'facet')} ran against the facets beside, turned round"
    change = agreed.volume - mesh.volume
    return agreed, [*findings, Finding("mixed_winding", len(turned), mesh.centroids[turned[0]], True, change, text)]


def _refuse_crowded(mesh: Mesh) -> None:
    """Raise MeshError if three or more facets meet at an edge and cannot be told apart into closed surfaces."""
    rows, slots = np.nonzero(mesh.edge_state == CROWDED)
    if not len(rows):
        return
    ends = mesh.vertices[mesh.facets[rows[0], [slots[0], (slots[0] + 1) % 3]]]
    raise MeshError(
        f"three or more facets share one edge at {len(rows)} facet edges, first at {place_text(ends.mean(axis=0))}",
        "remove inner walls in the CAD system and export again",
    )


def _refuse_open(mesh: Mesh) -> None:
    """Raise MeshError if an edge is still open."""
    rows, slots = np.nonzero(mesh.adjacency < 0)
    if not len(rows):
        return
    ends = mesh.vertices[mesh.facets[rows[0], [slots[0], (slots[0] + 1) % 3]]]
    raise MeshError(
        f"not watertight: {len(rows)} open edges that could not be closed, first at {place_text(ends.mean(axis=0))}",
        "repair the model and export it again",
    )


def _self_crossings(mesh: Mesh) -> list[Finding]:
    """Raise MeshError where the surface passes through itself; a Finding if it is too large to look."""
    crossing, places, is_complete = crossing_facets(mesh)
    if len(crossing):
        raise MeshError(
            f"the surface passes through itself: {len(crossing)} pairs of facets cross, first facets "
            f"{crossing[0, 0]} and {crossing[0, 1]} at {place_text(places[0])}",
            "repair the model and export it again",
        )
    if not is_complete:
        text = (
            f"not checked completely for self-intersection: too many of the {len(mesh.facets)} facets lie side by side"
        )
        return [Finding("self_intersection_unchecked", 0, None, False, 0.0, text)]
    return []
