"""The plan in space: subcomponents in colours, their layers' contours, what overhangs and the skeleton; and areas by layer."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.plan import Plan
from planner.show.depth import DepthImage
from planner.show.solid import Solid

Floats = NDArray[np.float64]

PIECES = ("#74a9cf", "#f0b26b", "#8cc084", "#c79bd1", "#e58f8a", "#7fc7c2", "#c9b458", "#a3a3c2", "#d98cb3", "#a0a9b2")
"""Colours of the subcomponents, in turn."""
HANGING = "#c2255c"
SKELETON = "#212529"
_PIXELS = (620, 520)
_LIGHT = np.array([0.3, 0.5, 0.81]) / np.linalg.norm([0.3, 0.5, 0.81])


def piece_colour(number: int) -> str:
    """The colour of a subcomponent, by its number in the plan."""
    return PIECES[number % len(PIECES)]


def towards_eye(azimuth_deg: float, elevation_deg: float) -> Floats:
    """(3, 3) float: rows are the picture's right and up and the direction to the eye; z of the build frame stands upright."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    eye = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.array([right, np.cross(eye, right), eye])


def draw_space(panel: Any, plan: Plan, solid: Solid, azimuth_deg: float, elevation_deg: float) -> None:
    """Draw the plan into a matplotlib panel, seen from a direction."""
    turn = towards_eye(azimuth_deg, elevation_deg)
    image = _picture(plan, solid, turn)
    panel.imshow(image.image, extent=image.extent, origin="lower", interpolation="antialiased")
    _draw_skeleton(panel, plan, turn)
    left, right, bottom, top = image.extent
    panel.set_xlim(left, right)
    panel.set_ylim(bottom, top)
    panel.set_aspect("equal", adjustable="box")
    panel.set_axis_off()


def _picture(plan: Plan, solid: Solid, turn: Floats) -> DepthImage:
    """The coloured facets that face the eye, the contours on them, and the outlines of what overhangs."""
    from matplotlib.colors import to_rgb

    shown = plan.bounds if not len(solid.corners) else solid.corners.reshape(-1, 3)
    low, high = (shown @ turn.T).min(axis=0), (shown @ turn.T).max(axis=0)
    room = 0.03 * float((high - low).max()) + 1e-3
    image = DepthImage(*_PIXELS, low[:2] - room, high[:2] + room)
    seen = solid.normals @ turn[2] > 1e-6
    colours = np.array([to_rgb(piece_colour(k)) for k in range(int(solid.piece.max(initial=0)) + 1)])
    light = np.clip(solid.normals[seen] @ turn.T @ _LIGHT, 0.0, 1.0)[:, None]
    image.facets(solid.corners[seen] @ turn.T, colours[solid.piece[seen]] * (0.6 + 0.4 * light))
    rims = solid.rims[solid.rim_normals @ turn[2] > 1e-6] @ turn.T
    image.lines(rims, to_rgb("#495057"), 0.5, room)
    closed = [np.vstack([line, line[:1]]) @ turn.T for layer in plan.layers for line in layer.overhang]
    if closed:
        hanging = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in closed])
        image.lines(hanging, to_rgb(HANGING), 1.0, 1.5 * room)
    return image


def _draw_skeleton(panel: Any, plan: Plan, turn: Floats) -> None:
    from matplotlib.collections import LineCollection

    if plan.skeleton is None or not len(plan.skeleton.nodes):
        return
    places = (plan.skeleton.nodes @ turn.T)[:, :2]
    lines = [places[edge] for edge in plan.skeleton.edges]
    panel.add_collection(LineCollection(lines, colors="white", linewidths=3.0, alpha=0.8, zorder=4))
    panel.add_collection(LineCollection(lines, colors=SKELETON, linewidths=1.3, zorder=5))
    count = np.bincount(plan.skeleton.edges.ravel(), minlength=len(places))
    ends = places[count != 2]
    panel.plot(ends[:, 0], ends[:, 1], "o", ms=3.6, mfc="white", mec=SKELETON, mew=1.1, zorder=6)


def draw_areas(panel: Any, plan: Plan) -> None:
    """Overhang area of every layer as bars, its overlap area as a line on a scale of its own, pieces as bands of colour."""
    overlap = np.array([layer.overlap_mm2 for layer in plan.layers])
    overhang = np.array([layer.overhang_mm2 for layer in plan.layers])
    numbers = np.arange(len(overlap))
    for part, (first, past) in enumerate(item.layers for item in plan.subcomponents):
        panel.axvspan(first - 0.5, past - 0.5, color=piece_colour(part), alpha=0.25, lw=0)
    panel.bar(numbers, overhang, width=0.9, color=HANGING, zorder=3)
    panel.set_xlim(-0.5, max(len(overlap), 1) - 0.5)
    panel.set_ylim(0.0, 1.08 * max(float(overhang.max(initial=0.0)), 1e-3))
    panel.set_xlabel("layer", fontsize=9)
    panel.set_ylabel("overhang, mm²", fontsize=9, color=HANGING)
    beside = panel.twinx()
    beside.step(numbers, overlap, where="mid", color="#495057", lw=1.1)
    beside.set_ylim(0.0, 1.08 * max(float(overlap.max(initial=0.0)), 1e-3))
    beside.set_ylabel("overlap, mm²", fontsize=9, color="#495057")
    panel.set_zorder(beside.get_zorder() + 1)
    panel.patch.set_visible(False)
    for axis in (panel, beside):
        axis.tick_params(labelsize=8)
    if not overhang.any():
        panel.set_yticks([])
    panel.set_title("what each layer lays on metal, and beyond it", fontsize=9.5)


def piece_handles(plan: Plan) -> list[Any]:
    """Legend entries: every subcomponent with what it stands on, the skeleton, what overhangs."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    found: list[Any] = []
    for number, part in enumerate(plan.subcomponents):
        on = "plate" if part.parent < 0 else plan.subcomponents[part.parent].name
        found.append(Patch(color=piece_colour(number), label=f"{part.name} on {on}, set-up {part.setup + 1}"))
    if plan.skeleton is not None:
        found.append(Line2D([], [], color=SKELETON, lw=1.4, marker="o", mfc="white", ms=4, label="skeleton"))
    if any(layer.overhang for layer in plan.layers):
        found.append(Line2D([], [], color=HANGING, lw=1.4, label="outline of what overhangs"))
    return found
