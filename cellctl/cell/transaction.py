"""A guarded sequence: every step is commanded, then verified at the plant, before the next; advanced by the tick, dropped at any instant."""

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
