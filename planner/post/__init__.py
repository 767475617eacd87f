"""A Plan for one cell and one placement: program lines, line table and process schedule.

`posting` calls the stages: `sequence` lays operations on a `tape` (`reaching`: with which tool and poses, nothing hit; `linearise`,
`arcs`: the moves; `tracking`: levels by the actual speed), `assemble` or `tcp` makes text of it by dialect, a reader of its own reads
the text back against the Plan as posted. `selftest` is a program of its own, for a touch probe.

The functions load what they need when they are called: whoever only reads Programs does not wait for numba and scipy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from config.cell import Cell, Placement
    from planner.plan import Plan
    from planner.post.posting import PostReport
    from planner.program import Program

__all__ = ["post", "post_with_report"]


def post(plan: Plan, cell: Cell, placement: Placement | None = None, dialect: str = "grblhal") -> Program:
    """The Program of a Plan: see `planner.post.posting.post`."""
    return post_with_report(plan, cell, placement, dialect)[0]


def post_with_report(
    plan: Plan, cell: Cell, placement: Placement | None = None, dialect: str = "grblhal"
) -> tuple[Program, PostReport]:
    """As `post`, with what there is to say about it: see `planner.post.posting.post_with_report`."""
    from planner.post import posting

    return posting.post_with_report(plan, cell, placement, dialect)
