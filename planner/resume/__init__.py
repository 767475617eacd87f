"""The rest of a Program as a Program of its own: `resume(program, cell, ResumePoint.at(line, fraction))`.

`point` says from where, `stretch` what is run again before the place where metal ended, `approach` how the machine comes there,
`head` writes that as lines, `rest` numbers the original's remaining lines anew, `resuming` calls the stages.

What is heavy is loaded when it is called.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from planner.resume.point import ResumePoint

if TYPE_CHECKING:
    from config.cell import Cell, Placement
    from planner.plan import Plan
    from planner.program import Program

__all__ = ["ResumePoint", "resume"]


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
    """What is left of a Program from a point on: see `planner.resume.resuming.resume`."""
    from planner.resume import resuming

    return resuming.resume(
        program, cell, point, overlap_mm=overlap_mm, lead_in_mm=lead_in_mm, clearance_mm=clearance_mm, plan=plan,
        placement=placement, program_sha256=program_sha256,
    )  # fmt: skip
