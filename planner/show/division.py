"""How a plan divides its part, in words and as figures: subcomponents, set-ups, candidates, overhang by layer."""

from __future__ import annotations

from typing import Any

import numpy as np

from planner.plan import Candidate, Plan, Setup, Skeleton, Subcomponent
from planner.show.places import thickness

_BARS = "▁▂▃▄▅▆▇█"
_MOST_BARS = 80
_MOST_CANDIDATES = 12


def division_figures(plan: Plan) -> dict[str, Any]:
    """Subcomponents, set-ups, candidates and skeleton as plain values for JSON; mm, mm², mm³, s."""
    return {
        "subcomponents": [_piece_figures(plan, number) for number in range(len(plan.subcomponents))],
        "setups": [_setup_figures(setup) for setup in plan.setups],
        "candidates": [_candidate_figures(item) for item in plan.candidates],
        "skeleton": None if plan.skeleton is None else _skeleton_figures(plan.skeleton),
    }


def _piece_figures(plan: Plan, number: int) -> dict[str, Any]:
    part = plan.subcomponents[number]
    least, greatest = piece_thickness(plan, part)
    return {
        "name": part.name,
        "parent": part.parent,
        "setup": part.setup,
        "layers": list(part.layers),
        "base": _rounded(part.base),
        "end_direction": _rounded(part.end_direction),
        "axis_mm": _rounded(part.axis),
        "thickness_mm": [round(least, 4), round(greatest, 4)],
        "volume_mm3": round(part.volume_mm3, 3),
        "joint_mm2": round(part.joint_mm2, 3),
        "overhang_mm2": round(part.overhang_mm2, 4),
        "unsupported_mm": round(part.unsupported_mm, 4),
        "support_mm3": round(part.support_mm3, 3),
        "why": list(part.why),
    }


def _setup_figures(setup: Setup) -> dict[str, Any]:
    return {
        "direction": _rounded(setup.direction),
        "turn": setup.turn,
        "subcomponents": list(setup.subcomponents),
    }


def _candidate_figures(item: Candidate) -> dict[str, Any]:
    return {
        "name": item.name,
        "subcomponents": item.subcomponents,
        "setups": item.setups,
        "overhang_mm2": _figure(item.overhang_mm2),
        "joint_mm2": _figure(item.joint_mm2),
        "time_s": _figure(item.time_s),
        "score": _figure(item.score),
        "buildable": _figure(item.buildable),
        "chosen": item.chosen,
        "note": item.note,
    }


def _skeleton_figures(skeleton: Skeleton) -> dict[str, Any]:
    return {
        "nodes_mm": _rounded(skeleton.nodes),
        "radii_mm": _rounded(skeleton.radii),
        "edges": skeleton.edges.tolist(),
    }


def _rounded(values: Any) -> list[Any]:
    found: list[Any] = (np.round(np.asarray(values, dtype=np.float64), 6) + 0.0).tolist()
    return found


def _figure(value: float) -> float | None:
    """A number for JSON, which knows none that is not finite: those are null."""
    return round(value, 6) if np.isfinite(value) else None


def piece_thickness(plan: Plan, part: Subcomponent) -> tuple[float, float]:
    """Least and greatest thickness of a subcomponent's layers, mm; 0, 0 where it has none."""
    pairs = [thickness(layer) for layer in plan.layers[part.layers[0] : part.layers[1]]]
    return (min(low for low, _ in pairs), max(high for _, high in pairs)) if pairs else (0.0, 0.0)


def division_lines(plan: Plan) -> list[str]:
    """Lines of text: nothing for a plan that says nothing about it."""
    lines: list[str] = []
    if plan.subcomponents:
        lines.append(
            "piece           on  set-up      layers    thickness mm  volume mm³  joint mm²  overhang mm²  longest mm"
            "  support mm³  grows along"
        )
        for part in plan.subcomponents:
            lines.append(_piece_line(plan, part))
            lines += [f"      {reason}" for reason in part.why]
    for number, setup in enumerate(plan.setups, 1):
        names = ", ".join(plan.subcomponents[k].name for k in setup.subcomponents)
        lines.append(f"set-up {number}: {setup.turn}, {_direction(setup.direction)} up; pieces {names}")
    lines += _candidate_lines(plan.candidates)
    if bars := overhang_bars(plan):
        lines.append(bars)
    return lines


def _piece_line(plan: Plan, part: Subcomponent) -> str:
    on = "the plate" if part.parent < 0 else plan.subcomponents[part.parent].name
    first, past = part.layers
    numbers = f"{first} to {past - 1}" if past > first else "none"
    least, greatest = piece_thickness(plan, part)
    thick = f"{least:.3f}" if greatest - least < 5e-4 else f"{least:.3f} … {greatest:.3f}"
    start, end = _direction(part.base[3:]), _direction(part.end_direction)
    return (
        f"{part.name:<8} {on:>9} {part.setup + 1:7d} {numbers:>11} {thick:>15} {part.volume_mm3:11.1f} {part.joint_mm2:10.1f} "
        f"{part.overhang_mm2:13.1f} {part.unsupported_mm:11.2f} {part.support_mm3:12.1f}  "
        f"{start if start == end else f'{start} to {end}'}"
    )


def _candidate_lines(candidates: tuple[Candidate, ...]) -> list[str]:
    if not candidates:
        return []
    lines = ["ways to build it     score  buildable  pieces  set-ups  overhang left mm²  joints mm²    time"]
    shown = [item for k, item in enumerate(candidates) if item.chosen or k < _MOST_CANDIDATES]
    for item in shown:
        lines.append(
            f"{'  chosen:' if item.chosen else '  weighed:':<16} {item.score:9.3g} {100.0 * item.buildable:8.1f} % "
            f"{item.subcomponents:7d} {item.setups:8d} {item.overhang_mm2:18.1f} {item.joint_mm2:11.1f} "
            f"{item.time_s / 60.0:6.0f} min  {item.name}{f': {item.note}' if item.note else ''}"
        )
    if len(shown) < len(candidates):
        lines.append(f"  and {len(candidates) - len(shown)} more (--json lists all)")
    return lines


def _direction(vector: Any) -> str:
    """A direction in short: +z, or three figures."""
    values = np.asarray(vector, dtype=np.float64)
    along = int(np.argmax(np.abs(values)))
    if abs(abs(values[along]) - 1.0) < 1e-6:
        return ("+" if values[along] > 0.0 else "-") + "xyz"[along]
    return "(" + ", ".join(f"{value + 0.0:.2f}" for value in values) + ")"


def overhang_bars(plan: Plan) -> str:
    """One line that draws the overhang area of the layers, first to last; empty where nothing hangs."""
    areas = np.array([layer.overhang_mm2 for layer in plan.layers])
    if not len(areas) or areas.max() <= 0.0:
        return ""
    groups = np.array_split(areas, min(len(areas), _MOST_BARS))
    bars = "".join(
        " " if group.max() <= 0.0 else _BARS[min(int(8.0 * group.max() / areas.max()), 7)] for group in groups
    )
    each = "a layer each" if len(areas) <= _MOST_BARS else f"the most of {-(-len(areas) // _MOST_BARS)} layers each"
    return f"overhang by layer, up to {areas.max():.1f} mm² ({each}): |{bars}|"
