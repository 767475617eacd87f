"""Which way round the facets run: neighbours made to agree, bodies turned right side out."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.errors import MeshError
from planner.mesh.adjacency import SAME_DIRECTION
from planner.mesh.facets import pieces_of
from planner.mesh.findings import Finding, place_text
from planner.mesh.mesh import Floats, Ints, Mesh

_WINDING_BLOCK = 200_000
"""Facets for which the solid angle is computed at once: bounds the memory to some tens of MB."""


@njit(cache=True)
def spread_parity(mate: Ints, state: NDArray[np.int8], same: int) -> tuple[NDArray[np.bool_], Ints, int]:
    """Walk over shared edges and note which facets run against the first facet of their piece.

    mate, state : (3m,) as from `pair_half_edges`;  same : the state that means that both run in one direction
    Returns turned : (m,) bool, piece : (m,) int64, and a facet at which the walk contradicts itself (-1 if none).
    """
    count = mate.shape[0] // 3
    turned = np.zeros(count, np.bool_)
    piece = np.full(count, -1, np.int64)
    stack = np.empty(count, np.int64)
    pieces = 0
    for first in range(count):
        if piece[first] >= 0:
            continue
        piece[first] = pieces
        stack[0] = first
        top = 1
        while top > 0:
            top -= 1
            f = stack[top]
            for h in range(3 * f, 3 * f + 3):
                if mate[h] < 0:
                    continue
                g = mate[h] // 3
                against = turned[f] != (state[h] == same)
                if piece[g] < 0:
                    piece[g] = pieces
                    turned[g] = against
                    stack[top] = g
                    top += 1
                elif turned[g] != against:
                    return turned, piece, g
        pieces += 1
    return turned, piece, -1


def agree_winding(mesh: Mesh) -> tuple[Mesh, Ints]:
    """Turn facets so that neighbours run in opposite directions over their edge; the larger part of a piece stays.

    Returns the mesh and the facets turned, (k,) int64.  Raises MeshError for a one-sided (Moebius) surface.
    """
    if not (mesh.edge_state == SAME_DIRECTION).any():
        return mesh, np.empty(0, dtype=np.int64)
    turned, piece, twisted = spread_parity(mesh.half_edge_mates, mesh.edge_state.ravel(), SAME_DIRECTION)
    if twisted >= 0:
        raise MeshError(
            f"the surface has only one side, found at facet {twisted} at {place_text(mesh.centroids[twisted])}",
            "repair the model and export it again",
        )
    size = np.bincount(piece)
    many = np.bincount(piece, weights=turned) * 2 > size
    turned ^= many[piece]
    return Mesh(mesh.vertices, _turn(mesh.facets, turned)), np.flatnonzero(turned)


def _turn(facets: Ints, which: NDArray[np.bool_]) -> Ints:
    """Facets with those of the mask run backwards."""
    result = facets.copy()
    result[which] = result[which][:, ::-1]
    return result


def body_of_facet(mesh: Mesh) -> Ints:
    """(m,) int64: number of the connected closed surface that each facet belongs to, in order of first facet."""
    return pieces_of(mesh.across)[0]


def solid_angle_turns(corners: Floats, point: Floats) -> float:
    """How often a closed surface, corners (m, 3, 3) mm, winds around a point (3,): 1 inside, 0 outside, -1 inverted.

    Source: Van Oosterom and Strackee, The solid angle of a plane triangle (1983).
    """
    total = 0.0
    for begin in range(0, len(corners), _WINDING_BLOCK):
        a, b, c = np.moveaxis(corners[begin : begin + _WINDING_BLOCK] - point, 1, 0)
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        top = np.einsum("ij,ij->i", a, np.cross(b, c))
        ab, bc, ca = (np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a)))
        total += float(2.0 * np.arctan2(top, la * lb * lc + ab * lc + bc * la + ca * lb).sum())
    return total / (4.0 * np.pi)


def containing_bodies(mesh: Mesh, body: Ints, count: int) -> list[list[int]]:
    """For every closed body the bodies that lie around it.

    body : (m,) int64, as from `body_of_facet`
    """
    if count == 1:
        return [[]]
    members = [np.flatnonzero(body == number) for number in range(count)]
    boxes = [(mesh.corners[m].min(axis=(0, 1)), mesh.corners[m].max(axis=(0, 1))) for m in members]
    around: list[list[int]] = []
    for inner in range(count):
        largest = members[inner][int(np.argmax(mesh.areas[members[inner]]))]
        around.append(
            [
                outer
                for outer in range(count)
                if outer != inner
                and bool((boxes[outer][0] <= boxes[inner][0]).all() and (boxes[outer][1] >= boxes[inner][1]).all())
                and abs(solid_angle_turns(mesh.corners[members[outer]], mesh.centroids[largest])) > 0.75
            ]
        )
    return around


def turn_outward(mesh: Mesh) -> tuple[Mesh, list[Finding]]:
    """Turn closed bodies that are inside out; what lies in a turned body (its voids) turns with it.

    Returns the mesh and a Finding per call (none if nothing was inverted).
    """
    body = body_of_facet(mesh)
    count = int(body.max()) + 1
    moments = np.einsum("ij,ij->i", mesh.centroids - mesh.bounds.mean(axis=0), mesh.area_vectors) / 3.0
    volume = np.bincount(body, weights=moments, minlength=count)
    around = containing_bodies(mesh, body, count)
    outermost = [min(outer, key=lambda o: (len(around[o]), o)) if outer else n for n, outer in enumerate(around)]
    inverted = [volume[outermost[number]] < 0.0 for number in range(count)]
    if not any(inverted):
        return mesh, []
    mask = np.array(inverted)[body]
    turned = Mesh(mesh.vertices, _turn(mesh.facets, mask))
    first = int(np.flatnonzero(mask)[0])
    bodies = sum(inverted)
    text = f"inverted: {bodies} of {count} bodies inside out ({int(mask.sum())} facets), turned round"
    change = turned.volume - mesh.volume
    return turned, [Finding("inverted", int(mask.sum()), mesh.centroids[first], True, change, text)]
