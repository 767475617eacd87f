"""A Program of as many lines as one likes that a post could have written: one bead, run to and fro in short lines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import planner
from config.cell import Cell
from planner.post.reread import read
from planner.program import Program
from planner.recipe import Recipe
from planner.resume.stretch import lit_lines
from tests.unit.planner.small_parts import box

PIECES = 71  # of one way along the bead: lines of about 0.2 mm


def long_bead(cell: Cell, lines: int) -> Program:
    """A posted wall of one bead whose longest line is cut into pieces, run as often as it takes to have about `lines` lines."""
    seed = planner.post(planner.plan(box(14.0, 2.4, 0.8), Recipe(process="deposit")), cell)
    table = seed.table
    way = np.where(lit_lines(seed, read(seed)), table["arc_end_mm"] - table["arc_start_mm"], 0.0)
    at = int(np.argmax(way))
    turns = max((lines - len(table)) // PIECES, 1)
    count = (turns + (turns + 1) % 2) * PIECES  # an odd number of ways ends where the one way did
    rows = np.repeat(table[at : at + 1], count)
    along = np.arange(1, count + 1) / PIECES
    share = 1.0 - np.abs((along % 2.0) - 1.0)
    begin, end = table[at - 1], table[at]
    for name in ("tip_end", "joints_end"):
        rows[name] = begin[name] + share[:, None] * (end[name] - begin[name])
    rows["arc_start_mm"], rows["arc_end_mm"] = (along - 1.0 / PIECES) * way[at], along * way[at]
    span = float(end["time_end_s"] - end["time_start_s"])
    rows["time_start_s"] = end["time_start_s"] + (along - 1.0 / PIECES) * span
    rows["time_end_s"] = end["time_start_s"] + along * span
    whole = np.concatenate([table[:at], rows, table[at + 1 :]])
    whole["n"] = np.arange(1, len(whole) + 1)
    for name in ("time_start_s", "time_end_s"):
        whole[name][at + count :] += (count / PIECES - 1.0) * span
    xy = rows["joints_end"][:, :2] - seed.work_offset[:2]
    bare = [line.lstrip("N0123456789") for line in seed.lines]
    feed = "".join(bare[at].partition("F")[1:])
    pieces = [f"X{x:.3f}Y{y:.3f}" for x, y in xy.tolist()]
    pieces[0] = f"G1{pieces[0]}{feed}"
    texts = [*bare[:at], *pieces, *bare[at + 1 :]]
    schedule = seed.schedule.copy()
    schedule["n"][schedule["n"] > at + 1] += count - 1
    return replace(
        seed, lines=tuple(f"N{k}{text}" for k, text in enumerate(texts, 1)), table=whole, schedule=schedule,
        layer_starts=np.array([0, len(whole)], dtype=np.int64), duration_s=float(whole["time_end_s"][-1]),
    )  # fmt: skip
