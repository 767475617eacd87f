"""What a post says of the blocks it wrote."""

from __future__ import annotations

import numpy as np
import pytest

from config.cell import load_cell
from planner.post import post_with_report
from planner.post.economy import LINKS, all_passes
from tests.unit.planner.hand_plan import RADIUS_MM, WAYS, hybrid_plan


def test_blocks_bytes_and_lengths_per_kind_are_those_of_the_text_and_the_plan() -> None:
    cell = load_cell("trunnion_tcp")
    program, report = post_with_report(hybrid_plan(), cell)
    rows = {row.kind: row for row in report.economy}
    assert set(rows) == {"deposit_contour", "deposit_fill", "mill_side", LINKS}
    contour = rows["deposit_contour"]
    assert contour.length_mm == pytest.approx(2.0 * 2.0 * np.pi * RADIUS_MM, rel=1e-4)
    assert contour.arcs >= 4 and contour.blocks <= 12
    assert rows["deposit_fill"].length_mm == pytest.approx(2.0 * sum(2.0 * abs(x) for x, _ in WAYS))
    assert rows["deposit_fill"].arcs == 0
    total = all_passes(report.economy)
    assert total.bytes < sum(len(line) + 1 for line in program.lines) and total.bytes_per_mm == pytest.approx(
        total.bytes / total.length_mm
    )
    assert 0.0 < total.tip_mm <= cell.chord_tolerance_mm and total.axis_deg <= cell.axis_tolerance_deg
    assert report.reread.max_tip_mm <= total.tip_mm + 0.1 * cell.chord_tolerance_mm
    assert any("bytes/mm" in line for line in report.findings)
