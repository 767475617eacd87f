"""What is posted runs on the simulated firmware, which shares no code with the planner: no error, the same end, the predicted time."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from config.cell import load_cell
from planner.post import post
from planner.program import Program
from sim.cnc.firmware import Firmware
from tests.unit.planner.hand_plan import cone_operation, contour_operation, fill_operation, oval_operation, plan_of

STEP_S = 0.02
WINDOW_BYTES = 900


def homed(machine: Firmware) -> Firmware:
    machine.receive(b"$H\n")
    for _ in range(10_000):
        machine.step(STEP_S)
        if b"ok" in machine.transmit():
            return machine
    raise AssertionError("homing did not end")


def run(machine: Firmware, program: Program) -> tuple[float, list[str]]:
    """Stream all lines by character counting; time until the machine is idle, s, and every answer that is not ok."""
    waiting, unanswered = deque(program.lines), deque[int]()
    complaints: list[str] = []
    for tick in range(20_000):
        while waiting and sum(unanswered) + len(waiting[0]) + 1 < WINDOW_BYTES:
            line = waiting.popleft()
            machine.receive(line.encode() + b"\n")
            unanswered.append(len(line) + 1)
        machine.step(STEP_S)
        for answer in machine.transmit().decode().split("\r\n"):
            if answer == "ok":
                unanswered.popleft()
            elif answer.startswith(("error", "ALARM")):
                complaints.append(f"{answer} near {program.lines[-len(waiting) - len(unanswered)]}")
        if complaints or (not waiting and not unanswered and machine.is_idle):
            return tick * STEP_S, complaints
    raise AssertionError("the program did not end")


@pytest.mark.parametrize("name", ["trunnion_tcp", "head_head", "head_table"])
def test_the_simulated_firmware_runs_the_program_to_its_end_in_the_predicted_time(name: str) -> None:
    cell = load_cell(name)
    program = post(plan_of([fill_operation(0), contour_operation(0), oval_operation(0), cone_operation(0)]), cell)
    assert name == "head_head" or any("G3" in line for line in program.lines)
    assert any(line.endswith("op 3 mill_side T2)") for line in program.lines)
    machine = homed(Firmware(cell))
    seconds, complaints = run(machine, program)
    assert complaints == []
    assert 0.97 * program.duration_s - 0.1 <= seconds <= 1.03 * program.duration_s + 0.1
    machine.transmit()
    machine.receive(b"?")
    report = next(text for text in machine.transmit().decode().split("\r\n") if text.startswith("<"))
    stands = [float(value) for value in report.split("MPos:")[1].split("|")[0].split(",")]
    assert np.abs(np.array(stands) - program.table["joints_end"][-1]).max() < 2e-3
