"""The states of the cell as one table; what is not in it raises and changes nothing. diagrams.py draws it."""

from __future__ import annotations

from enum import StrEnum


class State(StrEnum):
    """What the cell is doing. Adjectives rest, words in -ing pass."""

    OFFLINE = "OFFLINE"  # a wire or a device is missing
    UNHOMED = "UNHOMED"  # the CNC is in alarm: its position is not known, or it is locked
    IDLE = "IDLE"
    HOMING = "HOMING"
    JOGGING = "JOGGING"
    PURGING = "PURGING"  # powder or gas flows for a while, by hand; laser locked out, nothing moves
    PREPARING = "PREPARING"  # at a barrier: everything before is executed, a set-up is made and verified
    RUNNING = "RUNNING"
    HOLDING = "HOLDING"  # on the way to standstill
    HELD = "HELD"
    RESUMING = "RESUMING"
    ABORTING = "ABORTING"
    FAULT = "FAULT"  # latched; leaves by reset only
    STOPPED = "STOPPED"  # latched by stop; leaves by reset only
    RESETTING = "RESETTING"


class Trigger(StrEnum):
    """What changes the state: commands name an end state, the rest is what happened (past tense)."""

    HOME = "home"
    UNLOCK = "unlock"
    JOG = "jog"
    PURGE = "purge"
    START = "start"
    HOLD = "hold"
    RESUME = "resume"
    ABORT = "abort"
    STOP = "stop"
    RESET = "reset"
    CONNECTED = "connected"
    CONNECTED_LOCKED = "connected locked"
    CONNECTION_LOST = "connection lost"
    LOCKED = "machine locked"
    HOMED = "homed"
    JOGGED = "jogged"
    PURGED = "purged"
    BARRIER_REACHED = "barrier reached"
    PREPARED = "prepared"
    HELD_AT_MACHINE = "held at the machine"
    STOOD_STILL = "stood still"
    MOVED = "moved"
    COMPLETED = "completed"
    ABORTED = "aborted"
    FAULTED = "faulted"
    RESET_DONE = "reset done"
    RESET_HELD = "reset done, job held"
    RESET_LOCKED = "reset done, locked"
    RESET_OFFLINE = "reset done, offline"


class WrongStateError(Exception):
    """A trigger that the table does not have for this state. Nothing was changed."""

    def __init__(self, state: State, trigger: Trigger) -> None:
        super().__init__(f"{trigger.value} is not possible while the cell is {state.value}")
        self.state = state
        self.trigger = trigger


S, T = State, Trigger
ACTIVE = frozenset({S.PREPARING, S.RUNNING, S.HOLDING, S.RESUMING})
"""States in which a lost interlock latches a fault."""
IN_JOB = frozenset({*ACTIVE, S.HELD, S.ABORTING})
LATCHED = frozenset({S.FAULT, S.STOPPED})

TRANSITIONS: dict[tuple[State, Trigger], State] = {
    (S.OFFLINE, T.CONNECTED): S.IDLE,
    (S.OFFLINE, T.CONNECTED_LOCKED): S.UNHOMED,
    (S.IDLE, T.HOME): S.HOMING,
    (S.IDLE, T.JOG): S.JOGGING,
    (S.IDLE, T.PURGE): S.PURGING,
    (S.IDLE, T.START): S.PREPARING,
    (S.UNHOMED, T.HOME): S.HOMING,
    (S.UNHOMED, T.UNLOCK): S.IDLE,
    (S.HOMING, T.HOMED): S.IDLE,
    (S.JOGGING, T.JOGGED): S.IDLE,
    (S.JOGGING, T.HOLD): S.JOGGING,
    (S.PURGING, T.PURGED): S.IDLE,
    (S.PURGING, T.HOLD): S.PURGING,
    (S.PREPARING, T.PREPARED): S.RUNNING,
    (S.PREPARING, T.HOLD): S.HELD,
    (S.PREPARING, T.ABORT): S.ABORTING,
    (S.PREPARING, T.COMPLETED): S.IDLE,
    (S.RUNNING, T.BARRIER_REACHED): S.PREPARING,
    (S.RUNNING, T.HOLD): S.HOLDING,
    (S.RUNNING, T.HELD_AT_MACHINE): S.HOLDING,
    (S.RUNNING, T.ABORT): S.ABORTING,
    (S.RUNNING, T.COMPLETED): S.IDLE,
    (S.HOLDING, T.STOOD_STILL): S.HELD,
    (S.HOLDING, T.ABORT): S.ABORTING,
    (S.HELD, T.RESUME): S.RESUMING,
    (S.HELD, T.ABORT): S.ABORTING,
    (S.RESUMING, T.MOVED): S.RUNNING,
    (S.RESUMING, T.BARRIER_REACHED): S.PREPARING,
    (S.RESUMING, T.HOLD): S.HOLDING,
    (S.RESUMING, T.HELD_AT_MACHINE): S.HOLDING,
    (S.RESUMING, T.ABORT): S.ABORTING,
    (S.ABORTING, T.ABORTED): S.IDLE,
    (S.FAULT, T.RESET): S.RESETTING,
    (S.STOPPED, T.RESET): S.RESETTING,
    (S.IDLE, T.RESET): S.RESETTING,
    (S.UNHOMED, T.RESET): S.RESETTING,
    (S.RESETTING, T.RESET_DONE): S.IDLE,
    (S.RESETTING, T.RESET_HELD): S.HELD,
    (S.RESETTING, T.RESET_LOCKED): S.UNHOMED,
    (S.RESETTING, T.RESET_OFFLINE): S.OFFLINE,
    # The machine locks itself: outside a job its position is suspect and that is all.
    **{(s, T.LOCKED): S.UNHOMED for s in (S.IDLE, S.HOMING, S.JOGGING, S.PURGING, S.UNHOMED)},
    **{(s, T.CONNECTION_LOST): S.OFFLINE for s in (S.IDLE, S.UNHOMED)},
    # A fault latches wherever something goes on or could; a second one adds its alarm.
    **{(s, T.FAULTED): S.FAULT for s in State if s is not S.STOPPED},
    (S.STOPPED, T.FAULTED): S.STOPPED,
    # A stop is always possible.
    **{(s, T.STOP): S.STOPPED for s in State},
}

REST_OF: dict[Trigger, frozenset[State]] = {
    T.HOLD: frozenset({S.HOLDING, S.HELD}),
    T.RESUME: frozenset({S.RESUMING, S.RUNNING, S.PREPARING}),
    T.ABORT: frozenset({S.ABORTING}),
    T.STOP: frozenset({S.STOPPED}),
    T.HOME: frozenset({S.HOMING}),
    T.UNLOCK: frozenset({S.IDLE}),
    T.RESET: frozenset({S.RESETTING}),
}
"""States in which a command finds its end state reached or under way: it is answered and changes nothing."""

HINTS: dict[Trigger, str] = {
    T.START: "a job starts when the cell is IDLE",
    T.HOLD: "only a job, a jog or a purge that runs can be held",
    T.RESUME: "only a HELD job can be resumed",
    T.ABORT: "there is no job to abort",
    T.RESET: "there is nothing latched to reset",
    T.HOME: "the cell homes when it is IDLE or UNHOMED",
    T.UNLOCK: "only an UNHOMED cell can be unlocked",
    T.JOG: "the cell jogs when it is IDLE",
    T.PURGE: "the cell purges when it is IDLE",
}

EXECUTION: dict[State, str] = {
    S.OFFLINE: "STOPPED",
    S.UNHOMED: "STOPPED",
    S.IDLE: "READY",
    S.HOMING: "ACTIVE",
    S.JOGGING: "ACTIVE",
    S.PURGING: "ACTIVE",
    S.PREPARING: "WAIT",
    S.RUNNING: "ACTIVE",
    S.HOLDING: "FEED_HOLD",
    S.HELD: "FEED_HOLD",
    S.RESUMING: "WAIT",
    S.ABORTING: "INTERRUPTED",
    S.FAULT: "INTERRUPTED",
    S.STOPPED: "STOPPED",
    S.RESETTING: "STOPPED",
}
"""MTConnect's word for each state (Execution)."""


def after(state: State, trigger: Trigger) -> State:
    """The state that follows. Raises WrongStateError for what is not in the table."""
    try:
        return TRANSITIONS[state, trigger]
    except KeyError:
        raise WrongStateError(state, trigger) from None


def is_reached(state: State, trigger: Trigger) -> bool:
    """Whether the end state that a command names is reached or under way, so that it is harmless."""
    return state in REST_OF.get(trigger, frozenset())


def mermaid() -> str:
    """The table as a mermaid state diagram; arrows that nearly every state has (stop, faulted) are drawn once, from `any_state`."""
    everywhere = {T.STOP, T.FAULTED}
    lines = ["stateDiagram-v2", "    [*] --> OFFLINE"]
    grouped: dict[tuple[State, State], list[str]] = {}
    for (state, trigger), target in TRANSITIONS.items():
        if trigger not in everywhere and state is not target:
            grouped.setdefault((state, target), []).append(trigger.value)
    lines += [f"    {source} --> {target}: {', '.join(names)}" for (source, target), names in grouped.items()]
    lines += ["    any_state --> FAULT: faulted", "    any_state --> STOPPED: stop"]
    return "\n".join(lines)
