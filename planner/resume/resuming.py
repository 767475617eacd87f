"""From a Program and a point to the Program of the rest: the stages, one call each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from config import ConfigError
from config.cell import Cell, Placement
from config.material import Material, load_material
from planner.errors import PostError, ResumeError
from planner.files.program_file import program_sha256 as sha256_of
from planner.kinematics.chain import Chain
from planner.plan import Plan
from planner.post.dialect import JOINT_DIALECTS, joint_dialect
from planner.post.read_blocks import Reading
from planner.program import Channel, Continues, Program
from planner.resume.approach import approach_to, guard_at
from planner.resume.head import Head, HeadWriter, Setting
from planner.resume.point import ResumePoint
from planner.resume.reentry import Reentry, Source, reentry_at
from planner.resume.rest import Modal, rest_of, rest_of_schedule, rest_of_table
from planner.resume.stretch import Wanted, lit_lines

RAMP_STEPS = 3
"""Lines that the overlap is cut into, each with its own level of the laser: at usual speeds each lasts longer than a write of the level."""
_SAME_TIP_MM = 0.02  # between the table and the chain: more is another placement
_SAME_JOINT = 1e-6


def resume(
    program: Program,
    cell: Cell,
    point: ResumePoint,
    *,
    overlap_mm: float | None = None,
    lead_in_mm: float | None = None,
    clearance_mm: float | None = None,
    plan: Plan | None = None,
    placement: Placement | None = None,
    program_sha256: str | None = None,
) -> Program:
    """A Program of its own that makes what is left of another one. The same arguments give the same Program.

    In the middle of a pass it comes down before the place where metal ended, runs lead_in_mm with the laser off and powder steady, then
    overlap_mm with the laser rising, and goes on as programmed; a cutter runs overlap_mm along what it has cut. Between passes it goes on
    with the next one. Waits between layers that lie behind the point are kept.

    point : where metal ended, or a layer or operation to begin with
    overlap_mm : default: one bead's width; of a cutter its radius   lead_in_mm : default: the material's
    clearance_mm : above the pass, along the tool's axis, down to where rapids go; default: the cell's rapid_clearance_mm
    plan : that the program was posted from; with it the way back is looked at for collisions (the twin's proof looks in any case)
    placement : that the program was posted for (default: the cell file's); its measured pivots count
    program_sha256 : of program.json if it is known, else it is computed
    Raises ResumeError: no such point, nothing left, tool missing, another cell or dialect; ReachError, TravelLimitError, PostError.
    """
    line, fraction = point.found_in(program)
    if program.dialect not in JOINT_DIALECTS:
        raise ResumeError(
            f"a {program.dialect} program is resumed at its control", f"here: {', '.join(JOINT_DIALECTS)}"
        )
    if program.cell_sha256 != cell.sha256:
        raise ResumeError(
            f"the program was posted for another state of cell {program.cell_name}",
            "give the cell file as it was, or post again",
        )
    language = joint_dialect(program.dialect)
    fitted = language.fitted(cell)
    chain = Chain.from_cell(fitted, placement)
    reading = language.read(program)
    material = _material(program)
    wanted = _wanted(material, overlap_mm, lead_in_mm)
    reentry = reentry_at(Source(program, fitted, reading, material), (line, fraction), wanted)
    _check_placement(program, reentry, chain)
    row = program.table[reentry.place]
    standing = (
        None if plan is None else guard_at(plan, program, fitted, chain, int(row["operation"]), int(row["pass_"]))
    )
    approach = approach_to(
        reentry.target, reentry.tool, fitted, chain, clearance_mm or cell.rapid_clearance_mm, reentry.stretch is not None, standing,
        int(row["pass_"]),
    )  # fmt: skip
    setting = Setting(program, fitted, chain, language, material.deposition.ramp_power if material else 1.0)
    sha256 = sha256_of(program) if program_sha256 is None else program_sha256
    head = HeadWriter(setting, reentry, approach).written(_about(program, reentry, sha256))
    resumed = _joined(program, reading, head, reentry, sha256, fitted)
    _check(resumed, program, reentry, reading, language.read(resumed))
    return resumed


def _material(program: Program) -> Material | None:
    """What the material takes; None where nothing is deposited. Raises ResumeError if it cannot be read."""
    if program.process == "mill":
        return None
    try:
        return load_material(program.material)
    except ConfigError as error:
        raise ResumeError(f"{program.material}: {error.message}", error.hint) from None


def _wanted(material: Material | None, overlap_mm: float | None, lead_in_mm: float | None) -> Wanted:
    for name, value in (("overlap_mm", overlap_mm), ("lead_in_mm", lead_in_mm)):
        if value is not None and not 0.0 <= value < np.inf:
            raise ResumeError(f"{name} {value:g}: 0 or more is possible", "leave it out for the usual one")
    lead = (material.deposition.lead_in_mm if material else 0.0) if lead_in_mm is None else lead_in_mm
    return Wanted(overlap_mm, lead, RAMP_STEPS)


def _check_placement(program: Program, reentry: Reentry, chain: Chain) -> None:
    """Raise ResumeError if the chain does not bring the tip to where the table says it is."""
    row = program.table[reentry.place]
    tip, _ = chain.forward(row["joints_end"][None, :], np.array(reentry.tool.tip_mm))
    there = row["tip_end"] @ program.machine_from_build[:3, :3].T + program.machine_from_build[:3, 3]
    off = float(np.linalg.norm(tip[0] - there))
    if off > _SAME_TIP_MM:
        raise ResumeError(
            f"the tip would be {off:.2f} mm off: the program was posted with other pivots or tools",
            "give its placement",
        )


def _about(program: Program, reentry: Reentry, sha256: str) -> list[str]:
    row = program.table[reentry.place]
    what = f"layer {row['layer']} op {row['operation']} pass {row['pass_']}"
    told = [
        f"resumes {program.part_name}, program {sha256[:12]}",
        f"which ended in line N{reentry.line + 1}, {reentry.fraction:.3f} of it",
    ]
    if reentry.stretch is None:
        told.append(f"on from the begin of {what}")
    else:
        done = reentry.stretch.arc_mm[0, 0] + reentry.stretch.lead_in_mm + reentry.stretch.overlap_mm
        told.append(f"on in {what}, at {done:.2f} mm along it")
    kind = "bead" if reentry.is_deposit else "cut"
    if reentry.stretch is not None:
        told.append(
            f"overlap {reentry.stretch.overlap_mm:.2f} mm of {kind}, lead-in {reentry.stretch.lead_in_mm:.2f} mm"
        )
    if reentry.is_deposit:
        told.append("planned for cold metal, on a hot part the joint is a little wider")
    return told


def _joined(program: Program, reading: Reading, head: Head, reentry: Reentry, sha256: str, cell: Cell) -> Program:
    count, first = len(head.lines), reentry.rest
    before = Modal()
    for text in head.lines:
        before = before.after(text)
    lines = head.lines + rest_of(program, first, before, count, cell.cnc.line_length_max)
    table = rest_of_table(program, first, head.table)
    used = {reentry.tool.number, *np.unique(reading.tool[first:]).tolist()}
    layer = np.maximum.accumulate(table["layer"])
    starts = np.searchsorted(layer, np.arange(len(program.layer_starts) - 1))
    row, stretch = program.table[reentry.place], reentry.stretch
    continues = Continues(
        sha256, reentry.line, reentry.fraction, int(row["layer"]), int(row["operation"]), int(row["pass_"]),
        float(row["arc_start_mm"]) if stretch is None else float(stretch.arc_mm[0, 0]), first, count,
        0.0 if stretch is None else stretch.overlap_mm, 0.0 if stretch is None else stretch.lead_in_mm,
    )  # fmt: skip
    return replace(
        program,
        lines=lines,
        table=table,
        schedule=rest_of_schedule(program, first, head.schedule, count),
        layer_starts=np.append(starts, len(table)).astype(np.int64),
        tools=tuple(number for number in program.tools if number in used),
        duration_s=float(table["time_end_s"][-1]),
        continues=continues,
    )


def _check(resumed: Program, program: Program, reentry: Reentry, before: Reading, after: Reading) -> None:
    """Raise PostError if the text, read back, does not do from the place of re-entry on what the original does."""
    first, count = reentry.rest, len(resumed.lines) - (len(program.lines) - reentry.rest)
    joints = np.abs(after.joints[count:] - before.joints[first:]).max()
    same: Mapping[str, bool] = {
        "way": bool(joints < _SAME_JOINT),
        "feed": bool(np.allclose(after.time_s[count:], before.time_s[first:], rtol=1e-3, atol=1e-9)),
        "motion": bool(np.array_equal(after.is_rapid[count:], before.is_rapid[first:])),
        "gate": bool(np.array_equal(after.gate[count:], before.gate[first:])),
        "tool": bool(np.array_equal(after.tool[count:], before.tool[first:])),
        "spindle": bool(np.array_equal(after.spindle_rpm[count:], before.spindle_rpm[first:])),
        "levels": _levels_agree(resumed, program, count, first, lit_lines(program, before)[first:]),
    }
    wrong = [name for name, agrees in same.items() if not agrees]
    if wrong:
        raise PostError(f"the resumed program differs from the original in {', '.join(wrong)}", "report this program")


def _levels_agree(resumed: Program, program: Program, count: int, first: int, lit: NDArray[np.bool_]) -> bool:
    """Whether mode and permit are the same on all remaining lines, and all levels on those (k,) that are lit."""
    for channel in Channel:
        values = []
        for one, begin in ((resumed, count), (program, first)):
            entries = one.schedule[one.schedule["channel"] == channel]
            place = np.searchsorted(entries["n"], np.arange(begin + 1, len(one.lines) + 1), side="right")
            values.append(np.append(0.0, entries["value"])[place])
        rows = slice(None) if channel in (Channel.MODE, Channel.EMISSION) else lit
        if not np.allclose(values[0][rows], values[1][rows]):
            return False
    return True
