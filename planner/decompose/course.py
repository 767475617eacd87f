"""The centroidal axis of a piece that does not branch: from its base to its end, with the plane of its end face."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from planner.decompose.centroidal import Cut, cuts_at, lengths_along, marched, resampled, squared, tangents_of
from planner.decompose.fronts import Fronts, fronts, ways_inside
from planner.decompose.occupancy import occupancy
from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]

_FACE_COS = float(np.cos(np.radians(60.0)))  # an end face leans less than this against the axis
_FACE_SHARE = 0.6  # of the last section: smaller flats are facets of a dome
_FACE_SPREAD = float(np.cos(np.radians(3.0)))  # of normals within one flat face, as scanned or remeshed
_FACE_ROUGH = 0.02  # of the radius, depth of one flat face
_SQUARE_COS = float(np.cos(np.radians(25.0)))  # a section stands square if its normal leads so nearly to the next centre
_FOOT = 0.25  # of the largest: what else lies in the base plane is a side that happens to touch it
_SECTIONS = 160  # of one piece at most
_BELOW = 4  # column of `Occupancy.links`: the cube on the side of the base
_STRAY = 1.6  # outer radii between the axis's end and the farthest front: more is another end
_SPACING = 0.15  # of the radius, between sections


@dataclass(frozen=True, eq=False)
class Course:
    """Axis of a piece.

    points, directions : (k, 3) float, mm and unit   evenly spaced, from the base plane to the end   radius_mm : (k,) float
    end_face : (6,) float   the flat end with its outward normal; None where the end is not flat
    """

    points: Floats
    directions: Floats
    radius_mm: Floats
    end_face: Floats | None


@dataclass(frozen=True, eq=False)
class Fork:
    """Where a piece branches.  place : (3,) float, mm"""

    place: Floats


@dataclass(frozen=True, eq=False)
class Lost:
    """Where sections square on the axis end although the piece goes on.  place, direction : (3,) float, mm and unit"""

    place: Floats
    direction: Floats


def course(mesh: Mesh, base: Floats) -> Course | Fork | Lost | None:
    """Axis of a closed piece that stands on its base plane (6,); None where the piece does not stand on it."""
    body = occupancy(mesh, base[3:])
    height = (body.centres - base[:3]) @ base[3:]
    standing = (np.abs(height) < 1.5 * body.cube_mm) & (body.links[:, _BELOW] < 0)
    if not standing.any():
        return None
    feet = fronts(body, np.zeros(len(height)), standing)
    size = np.append(np.bincount(feet.part[standing]), 0)
    ways = ways_inside(body, size[feet.part] > _FOOT * size.max())
    chain = main_chain(fronts(body, ways))
    if isinstance(chain, Fork):
        return chain
    return _measured(mesh, base, chain)


def main_chain(graph: Fronts) -> Floats | Fork:
    """(k, 3) float, mm   Centres of the fronts from the source to the farthest; a Fork where a limb as long as wide leaves."""
    below, _ = graph.neighbours()
    ends = np.flatnonzero(graph.band == graph.band.max())
    here = int(ends[np.argmax(graph.area_mm2[ends])])
    chain = [here]
    while below[here]:
        here = max(below[here], key=lambda piece: (graph.area_mm2[piece], -piece))
        chain.append(here)
    chain.reverse()
    fork = _first_fork(graph, chain)
    return Fork(fork) if fork is not None else graph.centre[chain]


def _first_fork(graph: Fronts, chain: list[int]) -> Floats | None:
    """Centre of the first front of the chain from which a limb leaves that reaches farther than the front is wide."""
    _, above = graph.neighbours()
    on_chain = set(chain)
    for k, piece in enumerate(chain):
        for side in above[piece]:
            if side in on_chain:
                continue
            frontier, seen, length = [side], {side}, 0.0
            while frontier:
                length += graph.step_mm
                following = sorted({up for member in frontier for up in above[member]} - seen)
                if any(up in on_chain for up in following):
                    length = 0.0  # closes round a hole
                    break
                seen.update(following)
                frontier = following
            if length > 0.8 * graph.width_mm(piece):
                return np.asarray(graph.centre[chain[k]])
    return None


def _measured(mesh: Mesh, base: Floats, chain: Floats) -> Course | Lost | None:
    """The axis by sections: square cuts where the chain is far from both ends, marched on to them, then straight."""
    first = cuts_at(mesh, _just_inside(mesh, base)[None, :])[0]
    if first is None:
        return None
    along, radius = lengths_along(chain), first.radius_mm
    outer = first.outer_mm
    seed = np.arange(min(0.6 * outer, 0.3 * along[-1]), max(along[-1] - 1.6 * outer, 0.55 * along[-1]), max(_SPACING * radius, along[-1] / _SECTIONS))
    if len(seed) < 4:
        return _upright(mesh, base, first, chain, outer)
    cuts, _ = squared(mesh, resampled(chain, seed), radius)
    points = _clear(cuts, base, radius)
    if len(points) < 4:
        return _upright(mesh, base, first, chain, outer)
    step = float(lengths_along(points)[-1] / (len(points) - 1))

    def reaches_base(cut: Cut) -> bool:
        return _reaches(cut, base, radius)

    points, _ = marched(mesh, points, radius, step, reaches_base)
    points = marched(mesh, points[::-1], radius, step, reaches_base)[0][::-1]
    tail = tangents_of(points, outer)[-1]
    area = cuts_at(mesh, np.concatenate([points[-1], tail])[None, :])[0]
    face = end_face(mesh, points[-1], tail, area or first)
    start = first.centre - base[3:] * ((first.centre - base[:3]) @ base[3:])
    end = run_out(mesh, points[-1], tail, face, outer)
    if np.linalg.norm(end - chain[-1]) > _STRAY * outer:
        return Lost(points[-1], tail)
    if np.linalg.norm(start - points[0]) > _STRAY * outer:
        return Lost(points[0], tangents_of(points, radius)[0])
    points = np.vstack([start, points, end])
    return _even(mesh, points, radius, face)


def _reaches(cut: Cut, base: Floats, radius_mm: float) -> bool:
    """Whether a section runs into the base plane."""
    return bool(((cut.outline - base[:3]) @ base[3:]).min() < 0.01 * radius_mm)


def _clear(cuts: list[Cut | None], base: Floats, radius_mm: float) -> Floats:
    """(k, 3) float, mm   Centroids of the longest run of sections that stay clear of the base and are alike."""
    area = np.array([cut.area_mm2 if cut else 0.0 for cut in cuts])
    usual = float(np.median(area[area > 0.0])) if (area > 0.0).any() else 0.0
    runs: list[list[Cut]] = [[]]
    for cut in cuts:
        if cut is None or not 0.3 * usual < cut.area_mm2 < 3.0 * usual or _reaches(cut, base, radius_mm):
            continue
        step = cut.centre - runs[-1][-1].centre if runs[-1] else cut.plane[3:]
        length = float(np.linalg.norm(step))
        if float(step @ cut.plane[3:]) >= _SQUARE_COS * length > 0.02 * radius_mm:
            runs[-1].append(cut)
        elif length > radius_mm:
            runs.append([cut])
    return np.array([cut.centre for cut in max(runs, key=len)]).reshape(-1, 3)


def _just_inside(mesh: Mesh, base: Floats) -> Floats:
    """The base plane, moved into the piece by what rounding and flattening may leave, with a point near its middle."""
    plane = base.copy()
    near = mesh.vertices[np.abs((mesh.vertices - base[:3]) @ base[3:]) <= 1e-3 * mesh.diagonal]
    if len(near):
        middle = near.mean(axis=0)
        plane[:3] = middle - base[3:] * ((middle - base[:3]) @ base[3:])
    plane[:3] += 1e-4 * mesh.diagonal * base[3:]
    return plane


def _upright(mesh: Mesh, base: Floats, first: Cut, chain: Floats, outer: float) -> Course | Lost:
    """A piece too short for square cuts: its axis goes straight to the farthest it reaches along the base's normal."""
    start = first.centre - base[3:] * ((first.centre - base[:3]) @ base[3:])
    face = end_face(mesh, start, base[3:], first)
    end = run_out(mesh, start, base[3:], face, outer)
    if np.linalg.norm(end - chain[-1]) > _STRAY * outer:
        away = chain - start
        aside = np.linalg.norm(away - (away @ base[3:])[:, None] * base[3:], axis=1)
        last = int(np.argmax(aside > 0.5 * outer)) if (aside > 0.5 * outer).any() else len(chain) - 1
        return Lost(chain[last], base[3:])
    return _even(mesh, np.vstack([start, end]), first.radius_mm, face)


def end_face(mesh: Mesh, point: Floats, direction: Floats, section: Cut) -> Floats | None:
    """The flat face (6,) with its outward normal that ends a piece ahead of a point on its axis; None where it is not flat.

    Flat: facets within 3 degrees and 0.02 of the radius of one plane make up most of the last section's area, and the
    piece does not reach beyond them there.
    """
    ahead = (mesh.centroids - point) @ direction
    aside = np.linalg.norm(mesh.centroids - point - ahead[:, None] * direction, axis=1)
    facing = mesh.normals @ direction
    radius_mm, outer_mm = section.radius_mm, section.outer_mm
    near = (facing > _FACE_COS) & (ahead > -0.1 * radius_mm) & (ahead < 4.0 * outer_mm) & (aside < 1.1 * outer_mm)
    if not near.any():
        return None
    rows = np.flatnonzero(near)
    areas = mesh.areas[rows]
    seeds = rows[np.concatenate([np.argsort(-areas, kind="stable")[:12], np.argsort(-ahead[rows], kind="stable")[:4]])]
    best, most = None, 0.0
    for seed in seeds.tolist():
        normal, place = mesh.normals[seed], mesh.centroids[seed]
        for _ in range(3):
            flat = (mesh.normals[rows] @ normal > _FACE_SPREAD) & (
                np.abs((mesh.centroids[rows] - place) @ normal) < _FACE_ROUGH * radius_mm
            )
            if not flat.any():
                break
            vector = mesh.area_vectors[rows[flat]].sum(axis=0)
            normal = vector / np.linalg.norm(vector)
            place = (areas[flat, None] * mesh.centroids[rows[flat]]).sum(axis=0) / areas[flat].sum()
        total = float(areas[flat].sum())
        if total > 1.001 * most:
            best, most = np.concatenate([place, normal]), total
    return best if best is not None and most > _FACE_SHARE * section.area_mm2 else None


def run_out(mesh: Mesh, point: Floats, direction: Floats, face: Floats | None, outer_mm: float) -> Floats:
    """Where the axis, carried on straight, meets the end face or the farthest that the piece reaches near it."""
    if face is not None:
        slope = float(direction @ face[3:])
        return np.asarray(point + direction * max(float((face[:3] - point) @ face[3:]) / slope, 0.0))
    away = mesh.vertices - point
    ahead = away @ direction
    aside = np.linalg.norm(away - ahead[:, None] * direction, axis=1)
    cone = (ahead > 0.0) & (aside < 1.1 * outer_mm + 0.3 * ahead)
    return np.asarray(point + direction * (float(ahead[cone].max()) if cone.any() else 0.0))


def _even(mesh: Mesh, points: Floats, radius_mm: float, face: Floats | None) -> Course:
    """The axis at even spacing, smooth, with the area of its square sections carried to its ends."""
    along = lengths_along(points)
    count = int(np.clip(np.ceil(along[-1] / (_SPACING * radius_mm)), 4, 240))
    even = _smooth(along, points, np.linspace(0.0, along[-1], count + 1))
    directions = np.gradient(even, axis=0)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return Course(even, directions, np.full(count + 1, radius_mm), face)


def _smooth(along: Floats, points: Floats, at: Floats) -> Floats:
    """(m, 3) float, mm   Monotone cubic through the points at their lengths, read at others."""
    keep = np.concatenate([[True], np.diff(along) > 1e-9])
    return np.asarray(PchipInterpolator(along[keep], points[keep], axis=0)(at))
