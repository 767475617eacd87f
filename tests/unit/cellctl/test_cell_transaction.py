"""Guarded sequences: commanded, verified, in order."""

from __future__ import annotations

import pytest

from cellctl.cell.transaction import Step, StepFailedError, Transaction


def test_a_step_begins_only_when_the_one_before_is_verified() -> None:
    done = {"a": False, "b": False}
    acted: list[str] = []
    steps = [Step(name, lambda n=name: done[n], 1.0, act=lambda n=name: acted.append(n)) for name in done]  # type: ignore[misc]
    transaction = Transaction(steps)
    assert not transaction.advance(0.0)
    assert (acted, transaction.waiting) == (["a"], "a")
    done["a"] = True
    assert not transaction.advance(0.1)
    assert acted == ["a", "b"]
    done["b"] = True
    assert transaction.advance(0.2) and transaction.is_done and transaction.waiting == ""


def test_a_reading_from_before_the_command_proves_nothing() -> None:
    age = [0.05]
    transaction = Transaction([Step("park", lambda: True, 1.0, age_s=lambda: age[0])])
    assert not transaction.advance(10.0)
    age[0] = 0.06
    assert not transaction.advance(10.05)
    age[0] = 0.01
    assert transaction.advance(10.06)


def test_a_step_that_has_to_last_starts_anew_when_it_breaks() -> None:
    level = [True]
    transaction = Transaction([Step("steady", lambda: level[0], 5.0, must_last_s=0.5)])
    assert not transaction.advance(0.0)
    level[0] = False
    assert not transaction.advance(0.4)
    level[0] = True
    assert not transaction.advance(0.5)
    assert not transaction.advance(0.9)
    assert transaction.advance(1.0)


def test_a_step_that_is_not_verified_in_time_fails_with_its_words() -> None:
    transaction = Transaction([Step("deploying", lambda: False, 1.0, detail=lambda: "parked=True", remedy="look")])
    transaction.advance(0.0)
    with pytest.raises(StepFailedError) as caught:
        transaction.advance(1.1)
    assert (caught.value.code, caught.value.detail, caught.value.remedy) == (
        "step_failed",
        "deploying failed: parked=True",
        "look",
    )


def test_no_steps_are_done_at_once() -> None:
    assert Transaction([]).advance(0.0)
