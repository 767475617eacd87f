"""A plan as a picture: the stack of layers from the side, and chosen layers from above with all their passes."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from planner.plan import Plan
from planner.show.strokes import COLOURS, Stroke, layer_strokes

_PANEL_INCH = 5.2
_DPI = 110
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
    """A PNG file.  layers : which ones are drawn from above; None: a first, middle and last one, milled where possible.

    Raises ValueError if there is no such layer.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    chosen = chosen_layers(plan) if layers is None else list(layers)
    for number in chosen:
        if not 0 <= number < len(plan.layers):
            raise ValueError(f"no layer {number}: the plan has 0 … {len(plan.layers) - 1}")
    figure = Figure(figsize=(_PANEL_INCH * (1 + len(chosen)), _PANEL_INCH + 1.1), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 1 + len(chosen), squeeze=False)[0]
    strokes = {number: layer_strokes(plan.layers[number]) for number in chosen}
    _draw_side(axes[0], plan, chosen)
    for panel, number in zip(axes[1:], chosen, strict=True):
        _draw_layer(panel, plan, number, strokes[number])
    _legend(figure, {stroke.kind for found in strokes.values() for stroke in found})
    size = plan.bounds[1] - plan.bounds[0]
    figure.suptitle(
        f"{plan.part_name} · {plan.process} of {plan.material} · {len(plan.layers)} layers · "
        f"{size[0]:.1f} × {size[1]:.1f} × {size[2]:.1f} mm",
        fontsize=13,
    )
    figure.subplots_adjust(left=0.045, right=0.99, bottom=0.16, top=0.87, wspace=0.16)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def chosen_layers(plan: Plan) -> list[int]:
    """Up to three layers that tell most: the first, the first with milled walls, the last."""
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
    """One layer from above: beads and cuts to scale of colour, contours of the finished part in black."""
    from matplotlib.collections import LineCollection

    layer = plan.layers[number]
    for kind in ("rapid", "link", "lead", "hatch", "contour", "overhang", "face", "side"):
        lines = [stroke.points[:, :2] for stroke in strokes if stroke.kind == kind]
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
    for contour in layer.contours:
        outline = contour.curve.evaluate(contour.curve.sample(0.02))
        panel.plot(outline[:, 0], outline[:, 1], color="#212529", lw=1.0, zorder=4)
    points = np.vstack([stroke.points[:, :2] for stroke in strokes]) if strokes else plan.bounds[:, :2]
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.04 * float((high - low).max()) + 0.5
    panel.set_xlim(low[0] - room, high[0] + room)
    panel.set_ylim(low[1] - room, high[1] + room)
    panel.set_aspect("equal", adjustable="box")
    panel.set_title(f"layer {layer.index}: z {layer.bottom[2]:.2f} … {layer.top[2]:.2f} mm (x, y)", fontsize=9.5)
    panel.tick_params(labelsize=8)


def _legend(figure: Any, kinds: set[str]) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=COLOURS[kind], lw=2.2, ls="--" if kind == "rapid" else "-", label=_WORDS[kind])
        for kind in COLOURS
        if kind in kinds
    ]
    handles.append(Line2D([], [], color="#212529", lw=1.2, label="finished contour"))
    figure.legend(handles=handles, loc="lower center", ncol=len(handles), fontsize=9, frameon=False)
