"""All moves of an operation as they stand on the tape, looked at once more: nothing may be hit, and what came nearest is kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from config.cell import Tool
from planner.collide.clearance import Clearance
from planner.collide.guard import Guard
from planner.errors import ReachError
from planner.plan import Operation
from planner.post.tape import Move

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_SAGITTA_MM = 0.1  # between an arc and the chords that are looked at
NEAR_MM = 2.0
"""Up to here clearances are told."""


def watch_moves(guard: Guard, items: NDArray[np.void], start: Floats, operation: Operation) -> None:
    """Look at all moves of an operation, with the tool that is in when they are run.

    items : ITEM_DTYPE, from where the machine stood at joints (5,) `start`   operation : as the guard has begun it
    Raises ReachError: what meets what, by how much, where, in which pass.
    """
    moves = items[items["move"] != Move.NONE]
    if not guard.is_watching or not len(moves):
        return
    joints, source = spread(np.vstack([start, moves["joints"]]), moves["bulge"])
    passes = moves["pass_"].astype(np.int64)
    links = np.array([item.rapid for item in operation.passes], dtype=np.bool_)
    is_rapid = (passes < 0) | links[np.maximum(passes, 0)]
    done = np.maximum.accumulate(passes)  # a way to a pass stands among what those before it have left
    for tool in guard.cell.tools:
        for cuts in (False, True):
            chosen = (moves["tool"] == tool.number) & (is_rapid != cuts)
            if not chosen.any():
                continue
            found, move = _along(guard, tool, joints, source, chosen, done, cuts=cuts)
            guard.note(found)
            is_hit = guard.hits(found)
            if is_hit.any():
                row = int(np.argmin(np.where(is_hit, found.mm, np.inf)))
                raise ReachError(
                    f"{found.why(row)}, {_place(operation, moves[move[row]])}",
                    "turn or move the part on the table, choose another build direction, or add a longer or thinner tool to the cell file",
                )


def _along(
    guard: Guard, tool: Tool, joints: Floats, source: Ints, chosen: Bools, done: Ints, *, cuts: bool
) -> tuple[Clearance, Ints]:
    """Clearance of chosen moves, each run of them with the row that it begins at, and the move that each row is of.

    joints : (m + 1, 5)   source : (m,) the move that comes to each row but the first   chosen, done : (n,) of the moves
    """
    at = np.flatnonzero(chosen[source])
    is_new = np.append(True, np.diff(at) > 1)
    order = np.argsort(np.concatenate([at + 1.0, at[is_new] + 0.5]), kind="stable")
    row = np.concatenate([at + 1, at[is_new]])[order]
    move = source[np.concatenate([at, at[is_new]])[order]]
    joined = np.concatenate([np.ones(len(at), dtype=np.bool_), np.zeros(int(is_new.sum()), dtype=np.bool_)])[order]
    found = guard.clearance(tool, joints[row], cuts=cuts, limit_mm=NEAR_MM, joined=joined, passes=done[move])
    return found, move


def spread(joints: Floats, bulge: Floats) -> tuple[Floats, Ints]:
    """Rows (m + 1, 5) with arcs as chords, and the move (m,) that each but the first belongs to."""
    if not bulge.any():
        return joints, np.arange(len(bulge))
    found, source = [joints[:1]], []
    for k, value in enumerate(bulge.tolist()):
        begin, end = joints[k], joints[k + 1]
        if value == 0.0:
            found.append(end[None, :])
            source.append(k)
            continue
        chord = end[:2] - begin[:2]
        half_sweep = 2.0 * np.arctan(value)
        radius = 0.5 * float(np.hypot(*chord)) / abs(np.sin(half_sweep))
        step = 2.0 * np.arccos(max(1.0 - _SAGITTA_MM / radius, 0.0)) if radius > _SAGITTA_MM else np.pi
        parts = max(int(np.ceil(2.0 * abs(half_sweep) / step)), 1)
        normal = np.array([-chord[1], chord[0]])
        centre = begin[:2] + 0.5 * chord + normal * 0.5 / np.tan(half_sweep)
        turn = 2.0 * half_sweep * np.arange(1, parts + 1) / parts
        arm = begin[:2] - centre
        rows = np.repeat(end[None, :], parts, axis=0)
        rows[:, 0] = centre[0] + arm[0] * np.cos(turn) - arm[1] * np.sin(turn)
        rows[:, 1] = centre[1] + arm[0] * np.sin(turn) + arm[1] * np.cos(turn)
        found.append(rows)
        source += [k] * parts
    return np.vstack(found), np.array(source, dtype=np.int64)


def _place(operation: Operation, move: np.void) -> str:
    """Which pass a move belongs to."""
    number = int(move["pass_"])
    what = f"pass {number}" if number >= 0 else "on the way to the next pass"
    return f"{what} of operation {int(move['operation'])} ({operation.process}), layer {operation.layer}"
