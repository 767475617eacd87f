"""Solids made of facets: reading an STL, a tree of boxes over the facets, and the signed distance of a point."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from config import ConfigError

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LEAF = 4  # facets in a leaf of the tree
DEPTH = 64  # of the walk's stack
CONVEX_SHARE = 1e-4  # of its volume that a body's hull may add for the body to count as convex


class Shell(NamedTuple):
    """One closed body. Facet f has the corners 3f, 3f + 1 and 3f + 2.

    corners : (3 m, 3) mm   normals : (m, 7, 3)   of the facet, its edges 01, 12, 20 and its corners (not of unit length)
    boxes : (k, 6) mm, low and high corner of each node   nodes : (k, 2) int   first child (the second is next) and 0, or first facet and their number
    hull : (h, 3) mm   Corners of the convex hull.   is_convex : the body is its hull
    """

    corners: Array
    normals: Array
    boxes: Array
    nodes: Index
    hull: Array
    is_convex: bool


def shell_of(vertices: Array, facets: Index, hull: Array, is_convex: bool) -> Shell:
    """vertices : (n, 3) float, mm   facets : (m, 3) int, turned outwards, closed. -> Shell with its tree of boxes and its normals."""
    order, boxes, nodes = _tree(vertices[facets])
    facets = facets[order]
    corners = vertices[facets]
    edges = np.roll(corners, -1, axis=1) - corners
    face = np.cross(edges[:, 0], edges[:, 1])
    face /= np.linalg.norm(face, axis=1)[:, None]
    unit = edges / np.linalg.norm(edges, axis=2)[:, :, None]
    angle = np.arccos(np.clip(-np.einsum("mij,mij->mi", unit, np.roll(unit, 1, axis=1)), -1.0, 1.0))
    at_vertex = np.zeros((len(vertices), 3))
    at_edge: dict[tuple[int, int], Array] = {}
    for f, (a, b, c) in enumerate(facets.tolist()):
        for n, corner in enumerate((a, b, c)):
            at_vertex[corner] += angle[f, n] * face[f]
        for pair in ((a, b), (b, c), (c, a)):
            key = (min(pair), max(pair))
            at_edge[key] = at_edge.get(key, np.zeros(3)) + face[f]
    normals = np.empty((len(facets), 7, 3))
    normals[:, 0] = face
    for f, (a, b, c) in enumerate(facets.tolist()):
        for n, pair in enumerate(((a, b), (b, c), (c, a))):
            normals[f, 1 + n] = at_edge[min(pair), max(pair)]
    normals[:, 4:] = at_vertex[facets]
    return Shell(np.ascontiguousarray(corners.reshape(-1, 3)), normals, boxes, nodes, hull, is_convex)


def _tree(corners: Array) -> tuple[Index, Array, Index]:
    """Order of the facets, boxes and nodes of a tree that halves them along the longest side. corners : (m, 3, 3) mm"""
    middle = corners.mean(axis=1)
    order = np.arange(len(corners))
    boxes: list[Array] = [np.zeros(6)]
    nodes: list[tuple[int, int]] = [(0, 0)]
    waiting = [(0, 0, len(order))]
    while waiting:
        node, first, last = waiting.pop()
        mine = order[first:last]
        boxes[node] = np.concatenate((corners[mine].min(axis=(0, 1)), corners[mine].max(axis=(0, 1))))
        if last - first <= LEAF:
            nodes[node] = (first, last - first)
            continue
        along = middle[mine][:, int(np.argmax(np.ptp(middle[mine], axis=0)))]
        order[first:last] = mine[np.argsort(along, kind="stable")]
        half = (first + last) // 2
        nodes[node] = (len(nodes), 0)
        waiting += [(len(nodes), first, half), (len(nodes) + 1, half, last)]
        nodes += [(0, 0), (0, 0)]
        boxes += [np.zeros(6), np.zeros(6)]
    return order.astype(np.int64), np.array(boxes), np.array(nodes, dtype=np.int64)


def hull_shell(points: Array) -> Shell:
    """Shell of the convex hull of points (n, 3), mm."""
    import trimesh

    return _convex_shell(trimesh.Trimesh(points, [[0, 1, 2]], process=False).convex_hull)


def _convex_shell(hull: Any) -> Shell:
    vertices = np.asarray(hull.vertices, dtype=np.float64)
    return shell_of(vertices, np.asarray(hull.faces, dtype=np.int64), vertices, True)


def read_shells(file: str, name: str) -> list[Shell]:
    """The closed bodies of an STL in mm; convex ones as their hulls. Raises ConfigError."""
    import trimesh

    if not Path(file).is_file():
        raise ConfigError(f"machine.solids {name}: no file {file}", "name an STL beside the cell's file or by its whole path")
    try:
        mesh = trimesh.load_mesh(file, file_type="stl")
    except (ValueError, OSError) as error:
        raise ConfigError(f"machine.solids {name}: {file} is no STL: {error}", "export the body as STL in mm") from None
    shells = []
    for body in mesh.split(only_watertight=False):
        if not body.is_watertight:
            raise ConfigError(f"machine.solids {name}: {file} is not closed", "close its holes: a solid has an inside and an outside")
        if body.volume < 0.0:
            body.invert()
        hull = body.convex_hull
        if hull.volume - body.volume <= CONVEX_SHARE * hull.volume:
            shells.append(_convex_shell(hull))
        else:
            vertices, faces = np.asarray(body.vertices, dtype=np.float64), np.asarray(body.faces, dtype=np.int64)
            shells.append(shell_of(vertices, faces, np.asarray(hull.vertices, dtype=np.float64), False))
    if not shells:
        raise ConfigError(f"machine.solids {name}: {file} holds no body", "export the body as STL in mm")
    return shells


@njit(cache=True, nogil=True)
def box_gap2(box: Array, x: float, y: float, z: float) -> float:
    """Squared distance, mm2, of a point from a box (low and high corner); 0 inside."""
    dx = max(0.0, max(box[0] - x, x - box[3]))
    dy = max(0.0, max(box[1] - y, y - box[4]))
    dz = max(0.0, max(box[2] - z, z - box[5]))
    return float(dx * dx + dy * dy + dz * dz)


@njit(cache=True, nogil=True)
def _on_way(corners: Array, i: int, j: int, p: Array, k: int) -> float:
    """The way from corner i to j times the way from corner k to p."""
    total = 0.0
    for d in range(3):
        total += (corners[j, d] - corners[i, d]) * (p[d] - corners[k, d])
    return total


@njit(cache=True, nogil=True)
def _nearest_on_facet(corners: Array, i: int, p: Array, out: Array) -> int:
    """Point of the facet of corners i, i + 1, i + 2 nearest to p, into out; returns where: 0 face, 1 to 3 edge, 4 to 6 corner (Ericson 5.1.5)."""
    d1, d2 = _on_way(corners, i, i + 1, p, i), _on_way(corners, i, i + 2, p, i)
    d3, d4 = _on_way(corners, i, i + 1, p, i + 1), _on_way(corners, i, i + 2, p, i + 1)
    d5, d6 = _on_way(corners, i, i + 1, p, i + 2), _on_way(corners, i, i + 2, p, i + 2)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    v, w, where = 0.0, 0.0, 0
    if d1 <= 0.0 and d2 <= 0.0:
        where = 4
    elif d3 >= 0.0 and d4 <= d3:
        v, where = 1.0, 5
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v, where = d1 / (d1 - d3), 1
    elif d6 >= 0.0 and d5 <= d6:
        w, where = 1.0, 6
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w, where = d2 / (d2 - d6), 3
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w, where = (d4 - d3) / ((d4 - d3) + (d5 - d6)), 2
        v = 1.0 - w
    else:
        v, w = vb / (va + vb + vc), vc / (va + vb + vc)
    for d in range(3):
        out[d] = corners[i, d] + v * (corners[i + 1, d] - corners[i, d]) + w * (corners[i + 2, d] - corners[i, d])
    return where


@njit(cache=True, nogil=True)
def facets_distance(
    corners: Array, normals: Array, boxes: Array, nodes: Index, x: float, y: float, z: float
) -> float:
    """Signed distance, mm, of a point from a closed body: that of the nearest facet, with the sign of its (pseudo-)normal.

    Source: Baerentzen and Aanaes, Signed distance computation using the angle weighted pseudonormal, 2005.
    """
    p = np.array([x, y, z])
    on, best, at = np.empty(3), np.inf, np.zeros(3)
    facet, where = 0, 0
    stack = np.empty(DEPTH, np.int64)
    stack[0], depth = 0, 1
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if box_gap2(boxes[node], x, y, z) >= best:
            continue
        if nodes[node, 1] == 0:
            near, far = nodes[node, 0], nodes[node, 0] + 1
            if box_gap2(boxes[near], x, y, z) > box_gap2(boxes[far], x, y, z):
                near, far = far, near
            stack[depth], stack[depth + 1] = far, near
            depth += 2
            continue
        for f in range(nodes[node, 0], nodes[node, 0] + nodes[node, 1]):
            region = _nearest_on_facet(corners, 3 * f, p, on)
            gap2 = (x - on[0]) ** 2 + (y - on[1]) ** 2 + (z - on[2]) ** 2
            if gap2 < best:
                best, facet, where = gap2, f, region
                at[:] = on
    normal = normals[facet, where]
    side = (x - at[0]) * normal[0] + (y - at[1]) * normal[1] + (z - at[2]) * normal[2]
    return float(np.sqrt(best) if side >= 0.0 else -np.sqrt(best))
