"""The states of a job as one table, from submitted to its end; what is not in it raises and changes nothing."""

from __future__ import annotations

from enum import StrEnum


class JobState(StrEnum):
    """Where a job is in its life (design.md, "The life of a part")."""

    SUBMITTED = "submitted"
    PLANNING = "planning"
    PLANNED = "planned"
    POSTING = "posting"
    PROVING = "proving"
    PROVEN = "proven"
    WAITING_FOR_APPROVAL = "waiting_for_approval"
    QUEUED = "queued"
    RUNNING = "running"
    HELD = "held"
    INTERRUPTED = "interrupted"
    COMPLETED = "completed"
    FAILED = "failed"
    ABORTED = "aborted"
    CANCELLED = "cancelled"


class WrongJobStateError(Exception):
    """A step that a job in this state cannot take. Nothing was changed."""

    def __init__(self, state: JobState, target: JobState) -> None:
        super().__init__(f"a job that is {state.value} cannot become {target.value}")
        self.state = state
        self.target = target


J = JobState
ENDED = frozenset({J.COMPLETED, J.FAILED, J.ABORTED, J.CANCELLED, J.INTERRUPTED})
ON_CELL = frozenset({J.RUNNING, J.HELD})
_BEFORE_CELL = (J.SUBMITTED, J.PLANNING, J.PLANNED, J.POSTING, J.PROVING, J.PROVEN, J.WAITING_FOR_APPROVAL, J.QUEUED)
_WORKED_ON = (J.PLANNING, J.POSTING, J.PROVING)

STEPS: frozenset[tuple[JobState, JobState]] = frozenset(
    {
        (J.SUBMITTED, J.PLANNING),
        (J.PLANNING, J.PLANNED),
        (J.PLANNED, J.POSTING),
        (J.POSTING, J.PROVING),
        (J.PROVING, J.PROVEN),
        (J.PROVING, J.WAITING_FOR_APPROVAL),
        (J.PROVEN, J.WAITING_FOR_APPROVAL),
        (J.WAITING_FOR_APPROVAL, J.QUEUED),
        (J.QUEUED, J.RUNNING),
        (J.RUNNING, J.HELD),
        (J.HELD, J.RUNNING),
        *((J.RUNNING, end) for end in (J.COMPLETED, J.FAILED, J.ABORTED, J.INTERRUPTED)),
        *((J.HELD, end) for end in (J.FAILED, J.ABORTED, J.INTERRUPTED)),
        *((state, J.CANCELLED) for state in _BEFORE_CELL),
        *((state, J.FAILED) for state in (*_WORKED_ON, J.SUBMITTED, J.PLANNED, J.PROVEN, J.QUEUED)),
        # A worker or the service that died in the middle starts that step again.
        *((state, J.SUBMITTED) for state in _WORKED_ON),
    }
)


def step(state: JobState, target: JobState) -> JobState:
    """The target, if a job may go there from here. Raises WrongJobStateError otherwise."""
    if (state, target) not in STEPS:
        raise WrongJobStateError(state, target)
    return target


def mermaid() -> str:
    """The table as a mermaid state diagram."""
    order = {state: index for index, state in enumerate(JobState)}
    arrows = sorted(STEPS, key=lambda pair: (order[pair[0]], order[pair[1]]))
    return "\n".join(["stateDiagram-v2", "    [*] --> submitted", *(f"    {a.value} --> {b.value}" for a, b in arrows)])


if __name__ == "__main__":
    print(mermaid())
