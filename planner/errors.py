"""What can go wrong between a mesh and a program; every message is one line for a person: what, where, what to do.

PlannerError
├── InputError            the file or the recipe that came in is at fault
│   ├── MeshError         the mesh cannot be used as it is
│   ├── RecipeError       the recipe asks for something that does not exist or does not fit
│   ├── FileFormatError   a plan or program file is damaged or of another version
│   └── ResumeError       a program cannot be resumed from this point
├── FitError              a curve cannot be drawn through these points
├── PlanningError         the part cannot be made as asked
└── PostError             the plan cannot be run on this cell
    ├── TravelLimitError  an axis would leave its travel
    └── ReachError        no pose of the machine gives this tip and axis
"""

from __future__ import annotations


class PlannerError(Exception):
    """Base of all planner errors.

    message : one line: what is wrong, and where
    hint    : one line: what to do about it (may be empty)
    """

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


class InputError(PlannerError):
    """The file or the recipe that came in is at fault."""


class MeshError(InputError):
    """The mesh cannot be used as it is."""


class RecipeError(InputError):
    """The recipe asks for something that does not exist or does not fit."""


class FileFormatError(InputError):
    """A plan or program file is damaged or of another version."""


class ResumeError(InputError):
    """A program cannot be resumed from this point."""


class FitError(PlannerError):
    """A curve cannot be drawn through these points."""


class PlanningError(PlannerError):
    """The part cannot be made as asked."""


class PostError(PlannerError):
    """The plan cannot be run on this cell."""


class TravelLimitError(PostError):
    """An axis would leave its travel."""


class ReachError(PostError):
    """No pose of the machine gives this tip and axis."""
