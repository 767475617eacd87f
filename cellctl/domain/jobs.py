"""The states and events of a job as one table, from submitted to its end; what is not in it raises and changes nothing."""

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


class JobEvent(StrEnum):
    """What happened to a job (past tense), or what somebody decided about it."""

    PLAN_BEGUN = "plan begun"
    PLAN_MADE = "plan made"
    POST_BEGUN = "post begun"
    PROOF_BEGUN = "proof begun"
    PROOF_PASSED = "proof passed"
    PROOF_WANTING = "proof has findings"
    LAID_BEFORE = "laid before a person"
    APPROVED = "approved"
    STARTED = "started"
    HELD = "held"
    RESUMED = "resumed"
    COMPLETED = "every line executed"
    ABORTED = "aborted"
    INTERRUPTED = "interrupted"
    FAILED = "failed"
    CANCELLED = "cancelled"
    WORKER_LOST = "worker lost"
    MEASURED_ANEW = "to be posted again"


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

E = JobEvent
TRANSITIONS: dict[tuple[JobState, JobEvent], JobState] = {
    (J.SUBMITTED, E.PLAN_BEGUN): J.PLANNING,
    (J.PLANNING, E.PLAN_MADE): J.PLANNED,
    (J.PLANNED, E.POST_BEGUN): J.POSTING,
    (J.SUBMITTED, E.POST_BEGUN): J.POSTING,  # the rest of an interrupted job: its plan is there
    (J.POSTING, E.PROOF_BEGUN): J.PROVING,
    (J.PROVING, E.PROOF_PASSED): J.PROVEN,
    (J.PROVING, E.PROOF_WANTING): J.WAITING_FOR_APPROVAL,
    (J.PROVEN, E.LAID_BEFORE): J.WAITING_FOR_APPROVAL,
    (J.WAITING_FOR_APPROVAL, E.APPROVED): J.QUEUED,
    (J.QUEUED, E.STARTED): J.RUNNING,
    (J.RUNNING, E.HELD): J.HELD,
    (J.HELD, E.RESUMED): J.RUNNING,
    (J.RUNNING, E.COMPLETED): J.COMPLETED,
    **{(state, E.FAILED): J.FAILED for state in (J.RUNNING, J.HELD)},
    **{(state, E.ABORTED): J.ABORTED for state in (J.RUNNING, J.HELD)},
    **{(state, E.INTERRUPTED): J.INTERRUPTED for state in (J.RUNNING, J.HELD)},
    **{(state, E.CANCELLED): J.CANCELLED for state in _BEFORE_CELL},
    **{(state, E.FAILED): J.FAILED for state in (*_WORKED_ON, J.SUBMITTED, J.PLANNED, J.PROVEN, J.QUEUED)},
    # A worker or the service that died in the middle starts that step again.
    **{(state, E.WORKER_LOST): J.SUBMITTED for state in _WORKED_ON},
    # The machine was measured anew: posted, proven and approved again.
    **{(state, E.MEASURED_ANEW): J.SUBMITTED for state in (J.WAITING_FOR_APPROVAL, J.QUEUED)},
}

STEPS: frozenset[tuple[JobState, JobState]] = frozenset((state, target) for (state, _), target in TRANSITIONS.items())
"""From which state a job may go to which, whatever the event."""

STEP_WORDS: dict[tuple[JobState, JobState], str] = {
    (J.SUBMITTED, J.PLANNING): "a planner worker took it",
    **{(state, J.SUBMITTED): "the machine was measured anew: it is posted and proven again" for state in (J.WAITING_FOR_APPROVAL, J.QUEUED)},
    (J.PLANNING, J.PLANNED): "its plan is made",
    (J.PLANNED, J.POSTING): "its program is written for the cell",
    (J.SUBMITTED, J.POSTING): "the rest of its program is written for the part as it stands",
    (J.POSTING, J.PROVING): "its program is written; the twin runs it",
    (J.PROVING, J.PROVEN): "the proof passed",
    (J.PROVING, J.WAITING_FOR_APPROVAL): "the proof has findings: an engineer may override it with a reason",
    (J.PROVEN, J.WAITING_FOR_APPROVAL): "a person has to approve it",
    (J.WAITING_FOR_APPROVAL, J.QUEUED): "a person approved it",
    (J.QUEUED, J.RUNNING): "the cell started it",
    (J.RUNNING, J.HELD): "the cell holds it",
    (J.HELD, J.RUNNING): "it was resumed",
    (J.RUNNING, J.COMPLETED): "every line was executed",
    **{(state, J.FAILED): "it failed" for state, event in TRANSITIONS if event is E.FAILED},
    **{(state, J.ABORTED): "a person aborted it" for state in (J.RUNNING, J.HELD)},
    **{(state, J.INTERRUPTED): "the cell lost it in the middle" for state in (J.RUNNING, J.HELD)},
    **{(state, J.CANCELLED): "a person cancelled it" for state in _BEFORE_CELL},
    **{(state, J.SUBMITTED): "its worker was lost; this step starts again" for state in _WORKED_ON},
}
"""What every step of the table is told as where nothing more exact is known."""


def after(state: JobState, event: JobEvent) -> JobState:
    """The state that follows. Raises KeyError for what is not in the table."""
    return TRANSITIONS[state, event]


def step(state: JobState, target: JobState) -> JobState:
    """The target, if a job may go there from here. Raises WrongJobStateError otherwise."""
    if (state, target) not in STEPS:
        raise WrongJobStateError(state, target)
    return target


def mermaid() -> str:
    """The table as a mermaid state diagram; what may end nearly every state is drawn once, from `any before the cell`."""
    lines = ["stateDiagram-v2", "    [*] --> submitted"]
    for (state, event), target in TRANSITIONS.items():
        if event is not E.CANCELLED and not (event is E.FAILED and state not in ON_CELL):
            lines.append(f"    {state.value} --> {target.value}: {event.value}")
    lines += [f"    before_the_cell --> {J.CANCELLED.value}: {E.CANCELLED.value}", f"    before_the_cell --> {J.FAILED.value}: {E.FAILED.value}"]
    lines += [f"    {state.value} --> [*]" for state in JobState if state in ENDED]
    return "\n".join(lines)
