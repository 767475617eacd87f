"""One part from mesh to proof in a process of its own: figures as a line of JSON after every stage, pictures into a folder."""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

import planner
from config import load_cell
from config.cell import Cell
from planner.errors import PlannerError
from planner.mesh import load
from planner.mesh.mesh import Mesh
from planner.plan import Layer, Plan
from planner.recipe import Recipe, load_recipe
from tests.parts import PARTS
from tests.parts.catalogue import SEGMENTS

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = ROOT / "config" / "parts"
CELL = "trunnion_tcp"
GRID_MM = 0.25
UPRIGHT = {"overhang": "upright", "axis_layers": "never"}
"""What a fixed vertical head is: recipe fields."""

LIMIT_CPU_S = 420
"""For a part from mesh to proof; the system ends the process then."""
Figures = dict[str, Any]


def names() -> list[str]:
    """The paper's four, then the parts that are made here."""
    return [*sorted(path.stem for path in SHIPPED.glob("*.stl")), *PARTS]


def part_of(name: str, segments: int = SEGMENTS, changes: dict[str, Any] | None = None) -> tuple[Mesh, Recipe]:
    """Mesh and recipe of a part.  segments : to a full circle, for parts made here   changes : fields of the recipe to replace"""
    if name in PARTS:
        mesh, recipe = PARTS[name].mesh(segments), PARTS[name].recipe
    else:
        mesh, recipe = load(SHIPPED / f"{name}.stl", "mm"), load_recipe(SHIPPED / f"{name}.toml")
    return mesh, Recipe(**{**recipe.model_dump(), **(changes or {})})


def planned(mesh: Mesh, recipe: Recipe, name: str) -> tuple[Plan, Figures]:
    """The Plan and what it took; the times are wall clock, kernels compiled."""
    handed: dict[int, float] = {}
    start, start_cpu = time.perf_counter(), time.process_time()

    def on_layer(layer: Layer) -> None:
        handed[layer.index] = time.perf_counter() - start

    plan = planner.plan(mesh, recipe, part_name=name, on_layer=on_layer)
    seconds, cpu = time.perf_counter() - start, time.process_time() - start_cpu
    first = [handed[k] for k in range(*plan.subcomponents[0].layers) if k in handed] if plan.subcomponents else []
    thick = np.array([layer.thickness_mm for layer in plan.layers])
    chosen = [item for item in plan.candidates if item.chosen]
    return plan, {
        "facets": len(mesh.facets),
        "process": plan.process,
        "subcomponents": len(plan.subcomponents),
        "setups": len(plan.setups),
        "layers": len(plan.layers),
        "thinnest_mm": float(thick[:, 0].min()),
        "thickest_mm": float(thick[:, 1].max()),
        "overhang_mm2": float(sum(layer.overhang_mm2 for layer in plan.layers)),
        "left_mm2": chosen[0].overhang_mm2 if chosen else float("nan"),
        "unsupported_mm": max((piece.unsupported_mm for piece in plan.subcomponents), default=float("nan")),
        "support_mm3": plan.volumes_mm3.get("support", 0.0),
        "plan_s": seconds,
        "plan_cpu_s": cpu,
        "first_s": max(first) if first else seconds,
        "notes": list(plan.findings),
        "pieces": [
            f"{piece.name} on {piece.parent + 1}, towards ({', '.join(f'{v:.2f}' for v in piece.base[3:])}): {'; '.join(piece.why)}"
            for piece in plan.subcomponents
        ],
        "turns": [setup.turn for setup in plan.setups],
    }


def proven(plan: Plan, mesh: Mesh, cell: Cell, picture: Path) -> Figures:
    """Posted and proven: figures of the as-built part; its picture is written."""
    from sim import prove

    start = time.perf_counter()
    program = planner.post(plan, cell)
    posted = time.perf_counter()
    proof = prove(program, cell, mesh, cell_mm=GRID_MM)
    picture.write_bytes(proof.picture)
    seen = proof.deviation
    return {
        "lines": proof.lines,
        "post_s": posted - start,
        "proof_s": time.perf_counter() - posted,
        "build_min": proof.duration_s / 60.0,
        "p99_mm": seen.p99_mm,
        "milled_p99_mm": proof.milled.p99_mm if proof.milled is not None else float("nan"),
        "missing_share": seen.missing_mm3 / seen.part_mm3,
        "excess_mm3": seen.excess_mm3,
        "lost_powder_mm3": proof.lost_powder_mm3,
        "passed": proof.passed,
        "reasons": list(proof.reasons),
        "findings": [f"{found.kind} x{found.count}" for found in proof.findings],
    }


def warm(cell: Cell) -> None:
    """Load the kernels: a small block, planned and proven."""
    from sim import prove

    block = trimesh.creation.box((8.0, 8.0, 1.6))
    chip = Mesh(np.asarray(block.vertices), np.asarray(block.faces))
    prove(planner.post(planner.plan(chip, Recipe(layer_height_mm=0.8, decompose="never")), cell), cell, chip, cell_mm=0.5)


def main(name: str, folder: Path, segments: int, changes: dict[str, Any], stages: str) -> None:
    """Print the figures so far after planning, again after the proof, with `failed` where a stage refused or broke.

    changes : recipe fields to replace; a suffix for the pictures comes with them as `_name`   stages : "plan" or "proof"
    """
    resource.setrlimit(resource.RLIMIT_CPU, (LIMIT_CPU_S, LIMIT_CPU_S + 10))
    suffix = changes.pop("_name", "")
    figures: Figures = {"stage": "plan"}
    try:
        cell = load_cell(CELL)
        warm(cell)
        mesh, recipe = part_of(name, segments, changes)
        plan, made = planned(mesh, recipe, name)
        figures |= made
        if stages == "proof":
            figures["stage"] = "picture"
            from planner.show.picture import png

            (folder / f"{name}{suffix}_plan.png").write_bytes(png(plan))
            print(json.dumps(figures), flush=True)
            figures["stage"] = "post and proof"
            figures |= proven(plan, mesh, cell, folder / f"{name}{suffix}_as_built.png")
        figures["stage"] = "done"
    except PlannerError as error:
        figures["failed"] = f"{figures['stage']}: {error}"
    except Exception as error:  # noqa: BLE001  one part that breaks is a row of the table, with the place where it broke
        figures["failed"] = f"{figures['stage']} broke: {type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}{_place(error)}"
    print(json.dumps(figures), flush=True)


def _place(error: BaseException) -> str:
    """File and line where it was raised."""
    last = error.__traceback__
    while last is not None and last.tb_next is not None:
        last = last.tb_next
    return "" if last is None else f" ({Path(last.tb_frame.f_code.co_filename).name}:{last.tb_lineno})"


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), json.loads(sys.argv[4]), sys.argv[5])
