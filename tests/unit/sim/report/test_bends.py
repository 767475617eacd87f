"""Arcs as the report draws them, against the way that the firmware drives."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from config import load_cell
from sim.cnc import lookahead as la
from sim.cnc.chain import Chain
from sim.cnc.firmware import Firmware
from sim.findings import Finding
from sim.report.bends import Bends, joints_along
from sim.report.silhouette import Scene
from tests.unit.sim.report.made_up import ByHand

CELL = load_cell("trunnion_tcp")
HOME = np.array([axis.home for axis in CELL.axes])
DTYPE = np.dtype(
    [("layer", "<i4"), ("operation", "<i4"), ("tip_end", "<f8", (3,)), ("joints_end", "<f8", (5,)), ("bulge", "<f8")]
)
FROM = np.array([-20.0, 30.0, -40.0, 20.0, 35.0])
TO = np.array([-32.0, 21.0, -40.0, 20.0, 35.0])


@dataclass(frozen=True)
class OneArc(ByHand):
    """To FROM on the first line, to TO on an arc on the second, with tool 2."""

    bulge: float = 0.5
    lines: tuple[str, ...] = field(default=("M6 T2", "N2 G3"))

    @property
    def table(self) -> NDArray[np.void]:
        rows = np.zeros(2, dtype=DTYPE)
        rows["joints_end"] = [FROM, TO]
        rows["tip_end"] = Chain(CELL).tip_in_table(np.array([FROM, TO]), 2)
        rows["bulge"][1] = self.bulge
        return rows


def driven(bulge: float) -> NDArray[np.float64]:
    """(n, 5) joints of the firmware's chords from FROM to TO on the arc of this bulge."""
    chord = TO[:2] - FROM[:2]
    radius, word = 0.25 * np.hypot(*chord) * abs(bulge + 1.0 / bulge), "G3" if bulge > 0.0 else "G2"
    firmware = Firmware(CELL)
    words = " ".join(f"{letter}{value}" for letter, value in zip("XYZAC", FROM, strict=True))
    firmware.receive(f"G53 G0 {words}\n".encode())
    firmware.step(60.0)
    x, y = chord
    firmware.receive(f"G91 {word} X{x} Y{y} R{radius:.9f} F6000\n".encode())
    firmware.step(60.0)
    pieces = firmware.machine.motion.pieces
    return np.asarray(pieces[:, la.TO : la.TO + 5])


@pytest.mark.parametrize("bulge", [0.999, 0.3, 0.05, -0.4, -0.9])
def test_arc_is_drawn_where_the_firmware_drives_it(bulge: float) -> None:
    tips = Chain(CELL).tip_in_table(driven(bulge), 2)
    drawn = Bends(OneArc(bulge=bulge), CELL).path(0, 1)
    assert np.allclose(drawn[[0, -1]], OneArc().table["tip_end"])
    steps = np.linspace(drawn[:-1], drawn[1:], 64, axis=1).reshape(-1, 3)
    off = np.sqrt(((tips[:, None] - steps[None]) ** 2).sum(axis=2)).min(axis=1)
    assert off.max() < 0.03  # chords of 3 degrees, looked at in points
    assert np.linalg.norm(np.diff(drawn, axis=0), axis=1).sum() == pytest.approx(
        np.hypot(12.0, 9.0) * 2.0 * np.arctan(abs(bulge)) / np.sin(2.0 * np.arctan(abs(bulge))), rel=1e-3
    )


def test_joints_on_an_arc_start_and_end_at_its_ends_and_pass_its_middle() -> None:
    joints = joints_along(np.zeros(3), np.array([10.0, 0.0, 4.0]), 0.5, (0, 1), np.array([0.0, 0.5, 1.0]))
    assert np.allclose(joints, [[0.0, 0.0, 0.0], [5.0, -2.5, 2.0], [10.0, 0.0, 4.0]])  # to the right of its chord


def test_tool_of_a_finding_in_the_middle_of_an_arc_stands_on_the_arc() -> None:
    program = OneArc(bulge=0.6)
    middle = joints_along(FROM, TO, 0.6, (0, 1), np.array([0.5]))
    at = Chain(CELL).tip_in_table(middle, 2)[0]
    x, y, z = (float(value) for value in at)
    stand = Scene(program, CELL).at(Finding("gouge", "T2 cuts", 2, 0, 1, at_mm=(x, y, z), depth_mm=1.0))
    assert stand is not None
    assert np.linalg.norm(stand.axis[0] - at) <= 4.1  # within the cutter
    chord = 0.5 * (program.table["tip_end"][0] + program.table["tip_end"][1])
    assert np.linalg.norm(chord - at) == pytest.approx(0.6 * 7.5)
