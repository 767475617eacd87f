"""A guarded sequence: every step is commanded, then verified at the plant, before the next; a way back undoes what was begun, last first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass


def _nothing() -> None:
    """A step that only waits."""


def _no_detail() -> str:
    return ""


@dataclass(frozen=True)
class Step:
    """One step.

    text : what the operator reads while it lasts
    is_done : verified by read-back; act : commands the end state, once, when the step begins
    timeout_s : wire time after which the step has failed; must_last_s : is_done has to hold that long without a break
    age_s : age of what is_done reads; a reading from before the command proves nothing
    code : cause in the reaction table when it fails; detail and remedy fill its sentences
    undo : steps that bring back what this one changed, each verified in its turn; none where the step itself leads to the safe side
    moves : whether something with mass moves, which an undoing does only behind a closed door
    """

    text: str
    is_done: Callable[[], bool]
    timeout_s: float
    act: Callable[[], None] = _nothing
    must_last_s: float = 0.0
    age_s: Callable[[], float] | None = None
    code: str = "step_failed"
    detail: Callable[[], str] = _no_detail
    remedy: str = ""
    undo: tuple[Step, ...] = ()
    moves: bool = False


class StepFailedError(Exception):
    """A step was not verified in time."""

    def __init__(self, step: Step) -> None:
        detail = step.detail()
        super().__init__(f"{step.text}: {detail}" if detail else step.text)
        self.code = step.code
        self.detail = f"{step.text} failed: {detail or f'no confirmation within {step.timeout_s:g} s'}"
        self.remedy = step.remedy


class Transaction:
    """Steps in order. Dropping the object ends it; what the plant is to be then is its owner's to command."""

    def __init__(self, steps: Sequence[Step]) -> None:
        self._steps = tuple(steps)
        self._index = 0
        self._began_at: float | None = None
        self._true_since: float | None = None

    @property
    def is_done(self) -> bool:
        """Whether every step is verified."""
        return self._index >= len(self._steps)

    @property
    def waiting(self) -> str:
        """The step under way, in the operator's words."""
        return "" if self.is_done else self._steps[self._index].text

    @property
    def begun(self) -> tuple[Step, ...]:
        """The steps that were commanded, the one under way included."""
        return self._steps[: self._index + (self._began_at is not None)]

    def advance(self, now: float) -> bool:
        """Go as far as read-backs allow at wire time `now` (s); True when done. Raises StepFailedError."""
        while not self.is_done:
            step = self._steps[self._index]
            if self._began_at is None:
                self._began_at = now
                self._true_since = None
                step.act()
            is_fresh = step.age_s is None or step.age_s() < now - self._began_at
            if not is_fresh or not step.is_done():
                self._true_since = None
            elif self._true_since is None:
                self._true_since = now
            if self._true_since is not None and now - self._true_since >= step.must_last_s:
                self._index += 1
                self._began_at = None
                continue
            if now - self._began_at > step.timeout_s + step.must_last_s:
                raise StepFailedError(step)
            return False
        return True


class Rollback:
    """The way back from a transaction that was broken off: what its steps did is undone last first, each undoing verified.

    An undoing that is not verified in time stops nothing: the next one goes on, and it is told as not undone.
    """

    def __init__(
        self, first: Sequence[Step], broken: Transaction, last: Sequence[Step], failed: str, may_move: Callable[[], str]
    ) -> None:
        """first, last : steps before and behind those of `broken`

        failed : what is told of the step that failed; may_move : why nothing may move now, or ''
        """
        undoing = [step for done in reversed(broken.begun) for step in done.undo]
        self._left = list({step.text: step for step in [*first, *undoing, *last]}.values())
        self._may_move = may_move
        self._under_way: Transaction | None = None
        self.failed = failed
        self.undone: list[str] = []
        self.not_undone: list[str] = []

    @property
    def is_done(self) -> bool:
        """Whether nothing is left to undo."""
        return not self._left

    @property
    def waiting(self) -> str:
        """The step under way, in the operator's words."""
        return "" if self.is_done else f"undoing: {self._left[0].text}"

    @property
    def text(self) -> str:
        """What was undone and what could not be, in one line for the operator."""
        parts = [f"undone: {', '.join(self.undone)}"] if self.undone else []
        parts += [f"NOT undone: {'; '.join(self.not_undone)}"] if self.not_undone else []
        return "; ".join(parts) or "nothing had to be undone"

    def advance(self, now: float) -> bool:
        """Go as far as read-backs allow at wire time `now` (s); True when done. Raises nothing."""
        while self._left:
            step = self._left[0]
            why_not = self._may_move() if step.moves else ""
            if why_not:
                self._end(step, f"{step.text} ({why_not})")
                continue
            self._under_way = self._under_way or Transaction([step])
            try:
                if not self._under_way.advance(now):
                    return False
                self._end(step)
            except StepFailedError as error:
                self._end(step, error.detail)
        return True

    def give_up(self, because: str) -> None:
        """What is left stays as it is."""
        while self._left:
            self._end(self._left[0], f"{self._left[0].text} ({because})")

    def _end(self, step: Step, not_undone: str = "") -> None:
        if not_undone:
            self.not_undone.append(not_undone)
        else:
            self.undone.append(step.text)
        self._left.pop(0)
        self._under_way = None
