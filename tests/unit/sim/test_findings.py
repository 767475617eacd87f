"""Findings: one of a kind in an operation, its worst place kept; what can be said of a text without running it; what refusals mean."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from config import load_cell
from sim import job
from sim.findings import Findings
from sim.limits import beyond, check, targets_beyond_travel
from sim.remedies import ALARMS, HELP, REFUSALS, explain

CELL = load_cell("trunnion_tcp")
TABLE = np.dtype([("kind", "u1"), ("layer", "<i4"), ("operation", "<i4")])
SCHEDULE = np.dtype([("n", "<i4"), ("channel", "u1"), ("barrier", "u1"), ("value", "<f8")])


@dataclass
class Text:
    """A Program of lines alone, two operations of ten lines each."""

    lines: tuple[str, ...] = ()
    entries: tuple[tuple[int, int, int, float], ...] = ()
    part_name: str = "text"
    process: str = "deposit"
    material: str = "316L"
    tolerance_mm: float = 0.1
    gate: str = "stream"
    stock_allowance_mm: float | None = None
    machine_from_build: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    build_from_part: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))

    @property
    def work_offset(self) -> NDArray[np.float64]:
        return np.array([CELL.placement.work_offset.get(letter, 0.0) for letter in CELL.letters])

    @property
    def table(self) -> NDArray[np.void]:
        rows = np.zeros(max(20, len(self.lines)), TABLE)
        rows["operation"] = np.arange(len(rows)) // 10
        rows["layer"] = rows["operation"]
        return rows

    @property
    def schedule(self) -> NDArray[np.void]:
        return np.array(list(self.entries), SCHEDULE)


def test_worst_of_a_kind_in_an_operation_stands_with_its_place_and_all_are_counted() -> None:
    findings = Findings(Text())
    findings.add("gouge", "shallow", 3, at_mm=(1.0, 0.0, 0.0), depth_mm=0.2)
    findings.add("gouge", "deep", 7, at_mm=(2.0, 0.0, 0.0), depth_mm=0.9)
    findings.add("gouge", "again", 9, at_mm=(3.0, 0.0, 0.0), depth_mm=0.9)
    findings.add("gouge", "elsewhere", 12, depth_mm=0.1)
    first, second = findings.all()
    assert (first.text, first.line, first.first_line, first.count, first.at_mm, first.depth_mm) == ("deep", 7, 3, 3, (2.0, 0.0, 0.0), 0.9)
    assert (second.line, second.layer, second.operation, second.count) == (12, 1, 1, 1)
    assert first.help == HELP["gouge"]


def test_a_warning_becomes_an_error_with_the_first_error_of_its_kind() -> None:
    findings = Findings(Text())
    findings.add("speed", "slower cut", 1, severity="warning", rank=2.0)
    findings.add("speed", "heavier bead", 2, rank=1.0)
    assert [finding.severity for finding in findings.all()] == ["error"]


def test_findings_come_back_from_their_written_state() -> None:
    findings = Findings(Text())
    findings.add("collision", "holder in plate", 4, at_mm=(1.0, 2.0, 3.0), depth_mm=0.5)
    findings.add("starved", "no powder", 14, rank=0.3)
    other = Findings(Text())
    other.restore(findings.state())
    assert other.all() == findings.all()
    other.add("collision", "deeper", 5, depth_mm=0.6)
    assert other.all()[0].text == "deeper" and other.all()[0].count == 2


def test_targets_beyond_travel_are_named_with_axis_and_distance() -> None:
    axis = CELL.axis("X")
    lines = ("N1 G90", "N2 G54", f"N3 G0 X{axis.max - 1.0}", f"N4 X{axis.max + 12.5}", "N5 G1 A500 F100", "N6 X1 X2", "N7 G0 X0 A0")
    found = list(targets_beyond_travel(lines, CELL))
    assert [(each.line, each.axis.letter) for each in found] == [(4, "X"), (5, "A")]
    assert found[0].by == pytest.approx(12.5)
    assert "12.500 mm beyond" in found[0].text


def test_axis_that_is_farthest_out_for_its_travel_is_named() -> None:
    target = [axis.max for axis in CELL.axes]
    assert beyond(CELL.axes, target) is None
    target[0] += 1.0
    target[3] += 50.0
    found = beyond(CELL.axes, target)
    assert found is not None
    assert found[0].letter == CELL.axes[3].letter and found[1] == pytest.approx(50.0)


def test_line_length_schedule_and_missing_bodies_are_found_without_a_run() -> None:
    lines = ("N1 G90", "N2 G1 X1 (" + "x" * 300 + ")")
    entries = ((1, job.MODE, 0, 1.0), (1, 77, 1, 0.0), (9, job.LASER_W, 0, 5.0))
    findings = Findings(Text(lines, entries))
    check(Text(lines, entries), CELL.model_copy(update={"machine": None}), 256, findings)
    told = [(finding.kind, finding.line, finding.severity) for finding in findings.all()]
    assert ("line length", 2, "error") in told
    assert ("unchecked", 0, "warning") in told
    assert sum(finding.count for finding in findings.all() if finding.kind == "schedule") == 3


def test_every_refusal_has_a_meaning_and_a_remedy() -> None:
    for number, (meaning, remedy) in {**REFUSALS, **ALARMS}.items():
        assert meaning and remedy.endswith("."), number
    assert explain("error", 20)[0].startswith("a word or value")
    assert explain("error", 999)[1] == HELP["firmware"]
