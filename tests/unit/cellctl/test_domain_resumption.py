from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cellctl.domain.resumption import MetalEnd, metal_end_of

# a link, a bead of two lines of 10 mm each, a link, a bead of 10 mm, a link
EMITTING = np.array([False, True, True, False, True, False])
ARC = np.array([0.0, 5.0, 15.0, 25.0, 30.0, 40.0, 45.0])


def place(line: int, fraction: float) -> dict[str, Any]:
    return {"line": line, "fraction": fraction, "arc_mm": 0.0}


def end(executed: int, stood: tuple[int, float], lit: tuple[int, float], known_by: str = "tick") -> MetalEnd | None:
    told = {"last_line": executed, "place": place(*stood), "metal_end": place(*lit), "known_by": known_by}
    return metal_end_of(told, ARC, EMITTING)


def test_killed_in_a_bead_metal_ends_where_the_dead_man_let_it_go_on_to() -> None:
    assert end(2, (2, 0.4), (2, 0.45)) == MetalEnd(2, 0.45, "tick")
    assert end(1, (1, 0.9), (2, 0.1)) == MetalEnd(2, 0.1, "tick")


def test_light_lost_before_the_machine_stood_metal_ends_where_the_light_did() -> None:
    assert end(2, (2, 0.9), (1, 0.5)) == MetalEnd(1, 0.5, "tick")


def test_end_of_a_bead_that_the_last_tick_did_not_see_is_no_interruption() -> None:
    assert end(3, (3, 0.5), (2, 0.99)) == MetalEnd(3, 0.5, "tick")
    assert end(5, (5, 0.2), (4, 0.97)) == MetalEnd(5, 0.2, "tick")


def test_bead_that_was_passed_in_the_dark_is_laid_again() -> None:
    assert end(5, (5, 0.2), (2, 0.99)) == MetalEnd(2, 0.99, "tick")
    assert end(3, (3, 0.5), (-1, 0.0)) == MetalEnd(0, 0.0, "tick")


def test_place_that_is_ahead_of_the_executed_lines_is_not_believed() -> None:
    assert end(3, (5, 0.9), (2, 1.0)) == MetalEnd(3, 0.0, "tick")


def test_without_the_last_tick_the_executed_lines_are_what_is_known() -> None:
    assert end(2, (-1, 0.0), (-1, 0.0), "sample") == MetalEnd(2, 0.0, "sample")
    assert metal_end_of({"last_line": 4}, ARC, EMITTING) == MetalEnd(4, 0.0, "sample")


@pytest.mark.parametrize("known_by", ["tick", "sample"])
def test_run_of_which_every_line_was_executed_has_nothing_left(known_by: str) -> None:
    assert end(6, (5, 1.0), (4, 1.0), known_by) is None
