"""A plan in words and as JSON."""

from __future__ import annotations

import json
import math
from typing import Any

from planner.plan import Layer, Operation, Plan
from planner.show.books import books_line
from planner.show.division import division_figures, division_lines
from planner.show.places import is_level, thickness, tilt_deg

_MOST_FINDINGS = 20


def as_json(plan: Plan) -> str:
    """The plan's figures, layer by layer, without its curves; keys sorted, the same text for the same plan."""
    return json.dumps(_figures(plan), sort_keys=True, ensure_ascii=False, indent=1) + "\n"


def _figures(plan: Plan) -> dict[str, Any]:
    return {
        "part": plan.part_name,
        "mesh_sha256": plan.mesh_sha256,
        "material": plan.material,
        "process": plan.process,
        "tolerance_mm": plan.tolerance_mm,
        "bounds_mm": plan.bounds.tolist(),
        "build_from_part": plan.build_from_part.tolist(),
        "volumes_mm3": {name: round(value, 3) for name, value in plan.volumes_mm3.items()},
        "findings": list(plan.findings),
        "books": dict(plan.books),
        "schema": plan.schema,
        **division_figures(plan),
        "layers": [_layer_figures(layer) for layer in plan.layers],
    }


def _layer_figures(layer: Layer) -> dict[str, Any]:
    least, greatest = thickness(layer)
    return {
        "index": layer.index,
        "z_bottom_mm": round(float(layer.bottom[2]), 6),
        "z_top_mm": round(float(layer.top[2]), 6),
        "bottom": [round(value, 6) for value in (layer.bottom + 0.0).tolist()],
        "top": [round(value, 6) for value in (layer.top + 0.0).tolist()],
        "tilt_deg": round(tilt_deg(layer), 4),
        "thickness_mm": [round(least, 6), round(greatest, 6)],
        "subcomponent": layer.subcomponent,
        "contours": len(layer.contours),
        "walls": len(layer.walls),
        "twist_deg": round(math.degrees(max((wall.twist_rad for wall in layer.walls), default=0.0)), 4),
        "deviation_mm": round(max((contour.deviation_mm for contour in layer.contours), default=0.0), 6),
        "smooth_deviation_mm": smooth_deviation(layer),
        "overlap_mm2": round(layer.overlap_mm2, 4),
        "overhang_mm2": round(layer.overhang_mm2, 4),
        "overhang_outlines": len(layer.overhang),
        "operations": [_operation_figures(operation) for operation in layer.operations],
    }


def smooth_deviation(layer: Layer) -> float | None:
    """Largest measured distance of a layer's contours from the smooth surface, mm; None where they follow facets."""
    known = [contour.smooth_deviation_mm for contour in layer.contours if not math.isnan(contour.smooth_deviation_mm)]
    return round(max(known), 9) if known else None


def _operation_figures(operation: Operation) -> dict[str, Any]:
    work = [step for step in operation.passes if not step.is_link]
    first = work[0].setpoints[0] if work else [0.0] * 5
    return {
        "process": operation.process.value,
        "note": operation.note,
        "passes": len(work),
        "length_mm": round(sum(step.tip.length for step in work), 3),
        "link_mm": round(sum(step.tip.length for step in operation.passes if step.is_link), 3),
        "feed_mm_s": round(float(first[1]), 4),
        "laser_w": round(max((float(step.setpoints[:, 2].max()) for step in work), default=0.0), 3),
        "powder_g_min": round(float(first[3]), 4),
        "bead_width_mm": round(operation.bead_width_mm, 4),
        "bead_height_mm": round(operation.bead_height_mm, 4),
        "cutter_diameter_mm": operation.cutter_diameter_mm,
        "spindle_rpm": operation.spindle_rpm,
        "interpass_s": operation.interpass_s,
    }


def text(plan: Plan) -> str:
    """The plan on a page of text: what it is, findings, one line per layer."""
    size = plan.bounds[1] - plan.bounds[0]
    up = plan.build_from_part[2, :3] + 0.0
    volumes = ", ".join(f"{name} {value:.0f} mm³" for name, value in sorted(plan.volumes_mm3.items()))
    lines = [
        f"{plan.part_name}: {plan.process} of {plan.material}, {size[0]:.2f} x {size[1]:.2f} x {size[2]:.2f} mm as built, "
        f"part direction ({up[0]:.3g}, {up[1]:.3g}, {up[2]:.3g}) up, tolerance {plan.tolerance_mm:g} mm",
        f"{len(plan.layers)} layers, {len(plan.operations)} operations; {volumes}",
    ]
    lines += [f"! {finding}" for finding in plan.findings[:_MOST_FINDINGS]]
    if len(plan.findings) > _MOST_FINDINGS:
        lines.append(f"! and {len(plan.findings) - _MOST_FINDINGS} more findings (--json lists all)")
    lines += books_line(plan)
    lines += division_lines(plan)
    hangs = any(layer.overhang_mm2 > 0.0 for layer in plan.layers)
    if not all(is_level(layer) for layer in plan.layers):
        lines.append("layers that are not level: tilt of the bottom plane, least … greatest thickness in mm")
    area = "  overhang" if hangs else ""
    lines.append(f"layer   z from      to  height  contours  off facets  off surface{area}  operations (passes, length)")
    starts = {part.layers[0]: part.name for part in plan.subcomponents} if len(plan.subcomponents) > 1 else {}
    for number, layer in enumerate(plan.layers):
        lines += [f"piece {starts[number]}"] if number in starts else []
        lines.append(_layer_line(layer, hangs))
    return "\n".join(lines) + "\n"


def _layer_line(layer: Layer, hangs: bool) -> str:
    parts = []
    for operation in layer.operations:
        work = [step for step in operation.passes if not step.is_link]
        name = operation.process.value.replace("_", " ")
        parts.append(f"{name} {len(work)}, {sum(step.tip.length for step in work):.0f} mm")
    facets = max((contour.deviation_mm for contour in layer.contours), default=0.0)
    surface = smooth_deviation(layer)
    off = f"{facets:11.5f} {'-' if surface is None else format(surface, '.2e'):>12}"
    area = f" {layer.overhang_mm2:9.2f}" if hangs else ""
    return f"{layer.index:5d} {_extent(layer)} {len(layer.contours):9d} {off}{area}  {'; '.join(parts)}"


def _extent(layer: Layer) -> str:
    """Heights of a level layer, tilt and thickness of another one, equally wide."""
    if is_level(layer):
        low, high = float(layer.bottom[2]), float(layer.top[2])
        return f"{low:8.3f} {high:7.3f} {high - low:7.3f}"
    least, greatest = thickness(layer)
    thick = f"{least:.3f} … {greatest:.3f}" if greatest - least >= 5e-4 else f"{least:.3f}"
    return f"{tilt_deg(layer):7.1f}° {thick:>15}"
