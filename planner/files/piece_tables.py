"""How a Plan divides the part, as flat tables of numbers and words, and back: subcomponents, set-ups, skeleton, candidates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.plan import Candidate, Plan, Setup, Skeleton, Subcomponent

Table = NDArray[Any]

UNITS = {
    "subcomponents/base": "mm, 1",
    "subcomponents/end_direction": "1",
    "subcomponents/numbers": "volume mm^3, joint mm^2, overhang mm^2, unsupported mm, support mm^3",
    "subcomponents/axis": "mm",
    "setups/direction": "1",
    "skeleton/nodes": "mm",
    "skeleton/radii": "mm",
    "candidates/numbers": "overhang mm^2, joint mm^2, time s, score 1, buildable 1",
}


def offsets(counts: Sequence[int]) -> Table:
    """(n + 1,) int64: where each of n runs of rows begins, and where the last ends."""
    return np.concatenate([[0], np.cumsum(np.array(counts, dtype=np.int64))]).astype("<i8")


def stacked(arrays: Sequence[Any], shape: tuple[int, ...]) -> Table:
    """All rows one after the other, float64 little-endian.  shape : of one row."""
    return np.concatenate([np.asarray(a, dtype="<f8") for a in arrays]) if arrays else np.empty((0, *shape), dtype="<f8")


def _rows(values: Any, dtype: str, shape: tuple[int, ...] = ()) -> Table:
    return np.array(values, dtype=dtype).reshape(-1, *shape)


def piece_tables(plan: Plan) -> dict[str, Table]:
    """Named arrays, little-endian, of all that divides the plan's part but its words (`piece_words`)."""
    parts, setups, candidates = plan.subcomponents, plan.setups, plan.candidates
    skeleton = plan.skeleton or Skeleton(np.empty((0, 3)), np.empty(0), np.empty((0, 2), dtype=np.int64))
    return {
        "subcomponents/parent": _rows([part.parent for part in parts], "<i4"),
        "subcomponents/setup": _rows([part.setup for part in parts], "<i4"),
        "subcomponents/layers": _rows([part.layers for part in parts], "<i4", (2,)),
        "subcomponents/base": _rows([part.base for part in parts], "<f8", (6,)),
        "subcomponents/end_direction": _rows([part.end_direction for part in parts], "<f8", (3,)),
        "subcomponents/numbers": _rows([_part_numbers(part) for part in parts], "<f8", (5,)),
        "subcomponents/axis_offset": offsets([len(part.axis) for part in parts]),
        "subcomponents/axis": stacked([part.axis for part in parts], (3,)),
        "setups/direction": _rows([setup.direction for setup in setups], "<f8", (3,)),
        "setups/subcomponent_offset": offsets([len(setup.subcomponents) for setup in setups]),
        "setups/subcomponents": _rows([number for setup in setups for number in setup.subcomponents], "<i4"),
        "skeleton/nodes": _rows(skeleton.nodes, "<f8", (3,)),
        "skeleton/radii": _rows(skeleton.radii, "<f8"),
        "skeleton/edges": _rows(skeleton.edges, "<i8", (2,)),
        "candidates/counts": _rows([(item.subcomponents, item.setups) for item in candidates], "<i4", (2,)),
        "candidates/numbers": _rows([_candidate_numbers(item) for item in candidates], "<f8", (5,)),
        "candidates/chosen": _rows([item.chosen for item in candidates], "u1"),
    }


def piece_words(plan: Plan) -> dict[str, Any]:
    """The names, reasons and notes that belong to `piece_tables`."""
    return {
        "subcomponents": [{"name": part.name, "why": list(part.why)} for part in plan.subcomponents],
        "turns": [setup.turn for setup in plan.setups],
        "candidates": [{"name": item.name, "note": item.note} for item in plan.candidates],
        "has_skeleton": plan.skeleton is not None,
    }


def _part_numbers(part: Subcomponent) -> tuple[float, ...]:
    return part.volume_mm3, part.joint_mm2, part.overhang_mm2, part.unsupported_mm, part.support_mm3


def _candidate_numbers(item: Candidate) -> tuple[float, ...]:
    return item.overhang_mm2, item.joint_mm2, item.time_s, item.score, item.buildable


def subcomponents_from(tables: Mapping[str, Table], words: Mapping[str, Any]) -> tuple[Subcomponent, ...]:
    """The subcomponents of tables and words.  Raises KeyError, ValueError or IndexError if they do not fit."""
    at = tables["subcomponents/axis_offset"]
    found = []
    for k, said in enumerate(words["subcomponents"]):
        volume, joint, overhang, unsupported, support = (float(v) for v in tables["subcomponents/numbers"][k])
        first, last = (int(v) for v in tables["subcomponents/layers"][k])
        found.append(
            Subcomponent(
                name=said["name"],
                parent=int(tables["subcomponents/parent"][k]),
                setup=int(tables["subcomponents/setup"][k]),
                layers=(first, last),
                base=np.array(tables["subcomponents/base"][k]),
                end_direction=np.array(tables["subcomponents/end_direction"][k]),
                axis=np.array(tables["subcomponents/axis"][int(at[k]) : int(at[k + 1])]),
                volume_mm3=volume,
                joint_mm2=joint,
                overhang_mm2=overhang,
                unsupported_mm=unsupported,
                support_mm3=support,
                why=tuple(said["why"]),
            )
        )
    return tuple(found)


def setups_from(tables: Mapping[str, Table], words: Mapping[str, Any]) -> tuple[Setup, ...]:
    """The set-ups of tables and words.  Raises as `subcomponents_from`."""
    at, numbers = tables["setups/subcomponent_offset"], tables["setups/subcomponents"]
    return tuple(
        Setup(np.array(tables["setups/direction"][k]), turn, tuple(int(v) for v in numbers[int(at[k]) : int(at[k + 1])]))
        for k, turn in enumerate(words["turns"])
    )


def skeleton_from(tables: Mapping[str, Table], words: Mapping[str, Any]) -> Skeleton | None:
    """The skeleton of tables, None where the plan has none.  Raises as `subcomponents_from`."""
    if not words["has_skeleton"]:
        return None
    return Skeleton(*(np.array(tables[f"skeleton/{name}"]) for name in ("nodes", "radii", "edges")))


def candidates_from(tables: Mapping[str, Table], words: Mapping[str, Any]) -> tuple[Candidate, ...]:
    """The candidates of tables and words.  Raises as `subcomponents_from`."""
    found = []
    for k, said in enumerate(words["candidates"]):
        parts, setups = (int(v) for v in tables["candidates/counts"][k])
        overhang, joint, time, score, buildable = (float(v) for v in tables["candidates/numbers"][k])
        chosen = bool(tables["candidates/chosen"][k])
        found.append(
            Candidate(said["name"], parts, setups, overhang, joint, time, score, buildable, chosen, said["note"])
        )
    return tuple(found)
