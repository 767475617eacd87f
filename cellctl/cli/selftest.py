"""`cellctl post --selftest`: the probe program for signs and pivots, and what the machine's readings say."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cellctl.cli import output
from cellctl.cli.input import InputFault, existing_file, writable

if TYPE_CHECKING:
    from planner.post.selftest import SelfTest


def selftest(cell: str, out: Path, readings: Path | None, as_json: bool) -> None:
    """Write the program and the readings to expect; with readings, judge the machine by them.

    Exits with 1 if the cell file does not describe the machine. Raises ConfigError, PostError, InputFault.
    """
    from config import load_cell
    from planner.post.selftest import make_selftest

    test = make_selftest(load_cell(cell))
    if readings is not None:
        _judge(test, readings, as_json)
        return
    program = writable(out / "selftest.ngc")
    program.write_text("".join(line + "\n" for line in test.lines), encoding="ascii")
    expected = _expected(test)
    (out / "selftest.json").write_text(json.dumps(expected, indent=2) + "\n", encoding="utf-8")
    (out / "selftest.txt").write_text(_sheet(test), encoding="utf-8")
    if as_json:
        output.as_json({"program": str(program), **expected})
        return
    artefact = test.artefact
    output.table(["touch", "stage", "tool", "on", *test.cell.letters], _rows(test))
    output.line(
        f"{program}: {len(test.touches)} touches. Set a cube of {artefact.edge_mm:g} mm with its centre at {_at(artefact.cube_mm)} and a "
        f"ball of {artefact.ball_diameter_mm:g} mm at {_at(artefact.ball_mm)} of the build frame, edges along x, y, z; probe with "
        f"{artefact.probe_length_mm:g} mm to the centre of its ball of {artefact.probe_ball_mm:g} mm. "
        f"Laser and spindle off. Run it with a hand on the E-stop; it stops after the first stage. "
        f"Then: cellctl post --selftest --readings FILE with the control's [PRB:...] lines."
    )


def _judge(test: SelfTest, readings: Path, as_json: bool) -> None:
    from planner.post.selftest_readings import judge, read_readings

    try:
        text = existing_file(readings, "file of readings").read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise InputFault(f"{readings}: is no text", "give the control's [PRB:...] lines") from None
    found = judge(test, read_readings(text, test))
    if as_json:
        output.as_json(
            {
                "agrees": found.agrees,
                "rest_mm": found.rest_mm,
                "explained_mm": found.explained_mm,
                "turned": list(found.turned),
                "missed": list(found.missed),
                "pivots_mm": {letter: way.tolist() for letter, way in found.pivots_mm.items()},
                "findings": list(found.lines),
            }
        )
    else:
        for line in found.lines:
            output.line(line)
    if not found.agrees:
        raise SystemExit(1)


def _expected(test: SelfTest) -> dict[str, Any]:
    artefact = test.artefact
    return {
        "cell": test.cell.name,
        "axes": list(test.cell.letters),
        "cube_mm": list(artefact.cube_mm),
        "edge_mm": artefact.edge_mm,
        "ball_mm": list(artefact.ball_mm),
        "ball_diameter_mm": artefact.ball_diameter_mm,
        "probe_length_mm": artefact.probe_length_mm,
        "probe_ball_mm": artefact.probe_ball_mm,
        "lean_deg": test.lean_deg,
        "touches": [
            {
                "stage": touch.stage,
                "tool": touch.direction,
                "on": touch.body,
                "normal": touch.normal.tolist(),
                "reading": touch.joints.tolist(),
            }
            for touch in test.touches
        ],
    }


def _rows(test: SelfTest) -> list[list[str]]:
    return [
        [str(number), str(touch.stage), touch.direction, touch.body, *(f"{value:.3f}" for value in touch.joints)]
        for number, touch in enumerate(test.touches, start=1)
    ]


def _sheet(test: SelfTest) -> str:
    head = ["touch", "stage", "tool", "on", *test.cell.letters]
    rows = [head, *_rows(test)]
    width = [max(len(row[k]) for row in rows) for k in range(len(head))]
    lines = ["  ".join(text.rjust(size) for text, size in zip(row, width, strict=True)) for row in rows]
    return "".join(line.rstrip() + "\n" for line in lines)


def _at(place: tuple[float, float, float]) -> str:
    return f"({place[0]:g}, {place[1]:g}, {place[2]:g})"
