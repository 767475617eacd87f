"""Several bodies in one file: counted, and united where they overlap."""

from __future__ import annotations

import manifold3d  # type: ignore[import-not-found,unused-ignore]
import numpy as np

from planner.errors import MeshError
from planner.mesh.findings import Finding, place_text
from planner.mesh.mesh import Floats, Ints, Mesh
from planner.mesh.weld import unique_vertices
from planner.mesh.winding import body_of_facet, containing_bodies

OVERLAP_FRACTION = 1e-9
"""Volume or area, as a fraction of the sum, by which the union must differ for bodies to count as overlapping:
rounding of the sums is near 1e-13."""


def unite_bodies(mesh: Mesh) -> tuple[Mesh, list[Finding]]:
    """Unite bodies that overlap or contain each other; report how many solid bodies there are.

    mesh : closed, every solid body right side out, voids inside out
    Returns the mesh (the same one if nothing overlaps) and the findings.
    Raises MeshError if overlapping bodies cannot be united.
    """
    body = body_of_facet(mesh)
    count = int(body.max()) + 1
    if count == 1:
        return mesh, []
    findings: list[Finding] = []
    solids = _solids(mesh, body, count)
    if len(solids) > 1 and _boxes_meet(mesh, body, solids):
        united = _union(mesh, body, solids)
        change = united.volume - mesh.volume
        inner_walls = float(mesh.areas.sum() - united.areas.sum())
        if abs(change) > OVERLAP_FRACTION * mesh.volume or inner_walls > OVERLAP_FRACTION * mesh.areas.sum():
            text = f"{len(solids)} bodies overlap or share walls and were united; the shape is that of all together"
            place = mesh.centroids[np.flatnonzero(body == solids[1][0])[0]]
            findings.append(Finding("overlapping_bodies", len(solids), place, True, change, text))
            mesh = united
            body = body_of_facet(mesh)
            solids = _solids(mesh, body, int(body.max()) + 1)
    if len(solids) > 1:
        middles = [mesh.centroids[body == group[0]].mean(axis=0) for group in solids]
        text = f"{len(solids)} separate bodies, around " + ", ".join(place_text(m) for m in middles[:4])
        text += " …" if len(solids) > 4 else ""
        findings.append(Finding("several_bodies", len(solids), middles[0], False, 0.0, text))
    return mesh, findings


def _solids(mesh: Mesh, body: Ints, count: int) -> list[list[int]]:
    """Solid bodies, each with the voids (inverted surfaces) that lie directly in it."""
    if count == 1:
        return [[0]]
    moments = np.einsum("ij,ij->i", mesh.centroids - mesh.bounds.mean(axis=0), mesh.area_vectors) / 3.0
    volume = np.bincount(body, weights=moments, minlength=count)
    around = containing_bodies(mesh, body, count)
    groups = {number: [number] for number in range(count) if volume[number] > 0.0}
    for number in range(count):
        holders = [outer for outer in around[number] if outer in groups]
        if number not in groups and holders:
            groups[min(holders, key=lambda outer: volume[outer])].append(number)
    return list(groups.values())


def _boxes_meet(mesh: Mesh, body: Ints, solids: list[list[int]]) -> bool:
    """Whether the boxes of any two solid bodies meet."""
    low = np.array([mesh.corners[body == group[0]].min(axis=(0, 1)) for group in solids])
    high = np.array([mesh.corners[body == group[0]].max(axis=(0, 1)) for group in solids])
    meet = (low[:, None] <= high[None]).all(axis=2) & (low[None] <= high[:, None]).all(axis=2)
    return bool(np.triu(meet, k=1).any())


def _union(mesh: Mesh, body: Ints, solids: list[list[int]]) -> Mesh:
    """Boolean union of the solid bodies (each with its voids)."""
    parts = []
    for group in solids:
        facets = mesh.facets[np.isin(body, group)]
        used, local = np.unique(facets, return_inverse=True)
        part = manifold3d.Manifold(
            manifold3d.Mesh64(np.ascontiguousarray(mesh.vertices[used]), local.reshape(-1, 3).astype(np.uint64))
        )
        if part.status() != manifold3d.Error.NoError:
            place = place_text(mesh.centroids[np.flatnonzero(body == group[0])[0]])
            raise MeshError(
                f"bodies overlap near {place} and cannot be united ({part.status().name})",
                "unite them in the CAD system",
            )
        parts.append(part)
    result = manifold3d.Manifold.batch_boolean(parts, manifold3d.OpType.Add).to_mesh64()
    vertices: Floats = np.asarray(result.vert_properties, dtype=np.float64)[:, :3]
    welded, number = unique_vertices(vertices)
    return Mesh(welded, number[np.asarray(result.tri_verts, dtype=np.int64)])
