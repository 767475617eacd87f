"""A plan as a picture: the part in space, the stack of layers from the side, and chosen layers with all their passes."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from planner.plan import Plan
from planner.show.places import flat, is_level, where
from planner.show.solid import solid_of
from planner.show.space import HANGING, draw_areas, draw_space, piece_handles
from planner.show.strokes import COLOURS, Stroke, layer_strokes

_PANEL_INCH = 5.2
_DPI = 110
_EYES_DEG = ((-58.0, 24.0), (122.0, 30.0))
_MOST_PIECES = 6
_WORDS = {
    "contour": "deposit contour",
    "hatch": "deposit hatch",
    "overhang": "deposit overhang",
    "lead": "lead-in, lead-out (laser off)",
    "face": "mill top",
    "side": "mill wall",
    "link": "link at feed",
    "rapid": "rapid link",
}


def png(plan: Plan, layers: Sequence[int] | None = None) -> bytes:
    """A PNG file.  layers : which ones are drawn by themselves; None: a first, middle and last one, milled where possible, or
    of every subcomponent the one that overhangs most.

    A plan that says how the part is divided, or what overhangs, has a row above with the part in space and the areas by layer.
    Raises ValueError if there is no such layer.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    chosen = chosen_layers(plan) if layers is None else list(layers)
    for number in chosen:
        if not 0 <= number < len(plan.layers):
            raise ValueError(f"no layer {number}: the plan has 0 … {len(plan.layers) - 1}")
    level = all(is_level(layer) for layer in plan.layers)
    count = max(len(chosen) + level, 3 if (tall := _has_space(plan)) else 1)
    height = 2.0 * _PANEL_INCH + 1.4 if tall else _PANEL_INCH + 1.1
    figure = Figure(figsize=(_PANEL_INCH * count, height), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    low, high = (0.09, 0.46) if tall else (0.16, 0.87)
    grid = figure.add_gridspec(1, len(chosen) + level, left=0.045, right=0.99, bottom=low, top=high, wspace=0.16)
    panels = [figure.add_subplot(grid[0, k]) for k in range(len(chosen) + level)]
    strokes = {number: layer_strokes(plan.layers[number]) for number in chosen}
    if level:
        _draw_side(panels[0], plan, chosen)
    for panel, number in zip(panels[int(level) :], chosen, strict=True):
        _draw_layer(panel, plan, number, strokes[number])
    if tall:
        _draw_above(figure, plan)
    hangs = any(plan.layers[number].overhang for number in chosen)
    _legend(figure, {stroke.kind for found in strokes.values() for stroke in found}, hangs)
    size = plan.bounds[1] - plan.bounds[0]
    figure.suptitle(
        f"{plan.part_name} · {plan.process} of {plan.material} · {len(plan.layers)} layers · "
        f"{size[0]:.1f} × {size[1]:.1f} × {size[2]:.1f} mm",
        fontsize=13,
    )
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def _has_space(plan: Plan) -> bool:
    """Whether there is more to see than a stack of level layers."""
    return bool(plan.subcomponents) or any(layer.overhang or not is_level(layer) for layer in plan.layers)


def _draw_above(figure: Any, plan: Plan) -> None:
    """The upper row: the part in space from two sides, and the areas by layer."""
    grid = figure.add_gridspec(1, 3, left=0.02, right=0.965, bottom=0.59, top=0.93, wspace=0.1, width_ratios=(1, 1, 0.9))
    solid = solid_of(plan)
    for column, (azimuth, elevation) in enumerate(_EYES_DEG):
        panel = figure.add_subplot(grid[0, column])
        draw_space(panel, plan, solid, azimuth, elevation)
        panel.set_title(f"seen from {_side(azimuth)} and above", fontsize=9.5)
    draw_areas(figure.add_subplot(grid[0, 2]), plan)
    handles = piece_handles(plan)
    figure.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.555), ncol=max(min(len(handles), 7), 1), fontsize=9,
        frameon=False,
    )  # fmt: skip


def _side(azimuth_deg: float) -> str:
    """Which way is towards the eye, as signs of x and y."""
    x, y = np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg))
    return f"{'+' if x > 0.0 else '-'}x {'+' if y > 0.0 else '-'}y"


def chosen_layers(plan: Plan) -> list[int]:
    """Layers that tell most: the first, the first with milled walls, the last; of several subcomponents, one of each.

    Of a subcomponent it is the layer that overhangs most, or its middle one; of very many the first few are shown.
    """
    parts = [range(*part.layers) for part in plan.subcomponents if part.layers[1] > part.layers[0]]
    if len(parts) > 1:
        most = [max(part, key=lambda k: (plan.layers[k].overhang_mm2, -abs(k - part[len(part) // 2]))) for part in parts]
        return sorted(most[:_MOST_PIECES])
    last = len(plan.layers) - 1
    milled = [k for k, layer in enumerate(plan.layers) if any(not op.process.is_deposit for op in layer.operations)]
    middle = milled[0] if milled else last // 2
    return sorted({0, middle, last})


def _draw_side(panel: Any, plan: Plan, chosen: list[int]) -> None:
    """All layers seen along y: what is deposited and cut, links faint."""
    from matplotlib.collections import LineCollection
    from matplotlib.patches import Rectangle

    low, high = plan.bounds
    for number in chosen:
        bottom, top = plan.layers[number].bottom[2], plan.layers[number].top[2]
        panel.add_patch(Rectangle((low[0] - 1e3, bottom), 2e3, top - bottom, color="#fff3bf", lw=0))
    by_kind: dict[str, list[Any]] = {}
    for layer in plan.layers:
        for stroke in layer_strokes(layer):
            by_kind.setdefault(stroke.kind, []).append(stroke.points[:, [0, 2]])
    for kind in ("rapid", "lead", "hatch", "contour", "overhang", "face", "side"):
        if kind in by_kind:
            style = {"rapid": (0.4, 0.25), "lead": (0.3, 0.3)}.get(kind, (0.9, 0.9))
            panel.add_collection(
                LineCollection(by_kind[kind], colors=COLOURS[kind], linewidths=style[0], alpha=style[1], zorder=2)
            )
    panel.add_patch(
        Rectangle((low[0], low[2]), high[0] - low[0], high[2] - low[2], fill=False, ec="#212529", lw=0.8, ls=":", zorder=3)
    )
    panel.axhline(0.0, color="#495057", lw=2.0, zorder=1)
    room = 0.25 * max(high[0] - low[0], high[2] - low[2])
    panel.set_xlim(low[0] - room, high[0] + room)
    panel.set_ylim(-0.5 * room, high[2] + room)
    panel.set_aspect("equal", adjustable="box")
    panel.set_title("all layers from the side (x, z; build frame, mm)", fontsize=9.5)
    panel.tick_params(labelsize=8)


def _draw_layer(panel: Any, plan: Plan, number: int, strokes: list[Stroke]) -> None:
    """One layer against its normal: beads and cuts to scale of colour, contours of the finished part in black."""
    from matplotlib.collections import LineCollection
    from matplotlib.patches import PathPatch

    layer = plan.layers[number]
    for kind in ("rapid", "link", "lead", "hatch", "contour", "overhang", "face", "side"):
        lines = [flat(layer, stroke.points) for stroke in strokes if stroke.kind == kind]
        if lines:
            thin = kind in ("rapid", "link", "lead")
            panel.add_collection(
                LineCollection(
                    lines,
                    colors=COLOURS[kind],
                    linewidths=0.6 if thin else 1.5,
                    linestyles=(0, (3, 3)) if kind == "rapid" else "solid",
                    zorder=2 if thin else 3,
                )
            )
    outlines = [flat(layer, contour.curve.evaluate(contour.curve.sample(0.02))) for contour in layer.contours]
    for outline in outlines:
        panel.plot(outline[:, 0], outline[:, 1], color="#212529", lw=1.0, zorder=4)
    if layer.overhang:
        area = _area([flat(layer, outline) for outline in layer.overhang])
        panel.add_patch(PathPatch(area, fill=False, hatch="////", ec=HANGING, lw=0.8, zorder=5))
    drawn = [*outlines, *(flat(layer, stroke.points) for stroke in strokes)]
    points = np.vstack(drawn) if drawn else flat(layer, plan.bounds)
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.04 * float((high - low).max()) + 0.5
    panel.set_xlim(low[0] - room, high[0] + room)
    panel.set_ylim(low[1] - room, high[1] + room)
    panel.set_aspect("equal", adjustable="box")
    piece = f", piece {plan.subcomponents[layer.subcomponent].name}" if len(plan.subcomponents) > 1 else ""
    title = f"{where(layer)} (x, y)" if is_level(layer) else f"in its own plane,\n{where(layer)}"
    panel.set_title(f"layer {layer.index}{piece}: {title}", fontsize=9.5)
    panel.tick_params(labelsize=8)


def _area(outlines: list[Any]) -> Any:
    """Closed outlines as one path; holes run the other way."""
    from matplotlib.path import Path

    return Path.make_compound_path(*(Path(np.vstack([outline, outline[:1]]), closed=True) for outline in outlines))


def _legend(figure: Any, kinds: set[str], hangs: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Line2D([], [], color=COLOURS[kind], lw=2.2, ls="--" if kind == "rapid" else "-", label=_WORDS[kind])
        for kind in COLOURS
        if kind in kinds
    ]
    handles.append(Line2D([], [], color="#212529", lw=1.2, label="finished contour"))
    if hangs:
        handles.append(Patch(fill=False, hatch="////", ec=HANGING, label="rests on nothing"))
    figure.legend(handles=handles, loc="lower center", ncol=len(handles), fontsize=9, frameon=False)
