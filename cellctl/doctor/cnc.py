"""Asks a CNC who it is without touching what it does: `?` always; `$I`, `$$` and `$#` only while it stands; never a reset."""

from __future__ import annotations

from cellctl.doctor.figures import times_text
from cellctl.doctor.report import Report
from cellctl.doctor.settings import compare_settings
from config.cell import Cell
from drivers.cnc.codes import explain_error
from drivers.cnc.driver import STANDING
from drivers.cnc.events import Identity, Status
from drivers.cnc.identity import NAMES, check_identity, read_identity
from drivers.cnc.status import MalformedReport, StatusReader
from drivers.errors import DeviceFault, DeviceSilent, DriverError
from drivers.interfaces import BytePort, Clock

SECTION = "CNC"
ANSWER_S = 3.0  # boards that reset when their port is opened take about two to be there
LATE_S = 1.0  # for an answer of a control that has answered before
QUERY_PERIOD_S = 0.1  # status at most ten times a second
READ_PERIOD_S = 0.0005
SAFE_SHARE = 0.7  # of a limit: what comes nearer will miss it one day
OFFSET_TOLERANCE = 2e-3  # mm or deg; firmware prints three decimals


class QuietCnc:
    """One port, asked line by line. letters : of the axes, in the controller's order"""

    def __init__(self, port: BytePort, letters: tuple[str, ...], clock: Clock) -> None:
        self.port = port
        self.banner = ""
        self.reader = StatusReader(letters)
        self._clock = clock
        self._rest = b""

    async def status(self, timeout_s: float = LATE_S) -> tuple[Status, float] | None:
        """Ask `?`; the report and the round trip (s), None if none comes. Raises LinkLost."""
        self._drain()
        asked_at = self._clock.now()
        self.port.write(b"?")
        while self._clock.now() - asked_at < timeout_s:
            for line in self._lines():
                if line.startswith("<"):
                    try:
                        return self.reader.read(line, self._clock.now()), self._clock.now() - asked_at
                    except MalformedReport:
                        continue
                self._note(line)
            await self._clock.sleep(READ_PERIOD_S)
        return None

    async def command(self, text: str) -> list[str]:
        """Feedback lines of a `$` command that only tells. Raises DeviceSilent, DeviceFault, LinkLost."""
        self._drain()
        self.port.write(text.encode("ascii") + b"\n")
        told: list[str] = []
        until = self._clock.now() + LATE_S
        while self._clock.now() < until:
            for line in self._lines():
                if line == "ok":
                    return told
                if line.startswith("error:"):
                    code = int(line[6:]) if line[6:].isdigit() else 0
                    cause, remedy = explain_error(code)
                    raise DeviceFault(f"the CNC refused {text!r}: {cause} (error {code})", remedy, code)
                told.append(line)
                until = self._clock.now() + LATE_S
            await self._clock.sleep(READ_PERIOD_S)
        raise DeviceSilent(f"the CNC did not answer {text!r}", "look at the control; nothing was reset")

    def _drain(self) -> None:
        for line in self._lines():
            self._note(line)

    def _note(self, line: str) -> None:
        if line.lower().startswith(("grbl", "grblhal")):
            self.banner = line

    def _lines(self) -> list[str]:
        *whole, self._rest = (self._rest + self.port.read()).split(b"\n")
        return [line.decode("ascii", "replace").strip() for line in whole if line.strip()]


async def examine_cnc(cnc: QuietCnc, cell: Cell, clock: Clock, queries: int, report: Report) -> Status | None:
    """Identity, state, buffers, latency, work offset and settings; the last status, None if the control does not answer."""
    try:
        first = await cnc.status(ANSWER_S)
        if first is None:
            report.add(
                SECTION, f"port {cnc.port.name}", "FAULT", f"no answer to ? at {cell.cnc.baud} baud", "an answer",
                "check power, cable and cnc.baud; `--probe-ports` looks for it elsewhere, where no machine may be running",
            )  # fmt: skip
            return None
        status = first[0]
        report.add(SECTION, f"port {cnc.port.name}", "ok", f"answers at {cell.cnc.baud} baud")
        _tell_state(status, report)
        status = await _time_status(cnc, cell, clock, queries, report) or status
        if status.state not in STANDING:
            report.skip(SECTION, "firmware, settings, work offset", f"the CNC is in state {status.state}: a $ command would poison what it runs")
            return status
        await _identify(cnc, cell, status, report)
        await _work_offset(cnc, cell, report)
        pairs = (line[1:].partition("=") for line in await cnc.command("$$") if line.startswith("$"))
        compare_settings({number: value.split(" ")[0] for number, _, value in pairs}, cell, report)
        return status
    except DriverError as error:
        report.fault(SECTION, f"port {cnc.port.name}", error)
        return None


def _tell_state(status: Status, report: Report) -> None:
    place = ", ".join(f"{letter} {value:g}" for letter, value in status.machine.items())
    report.add(SECTION, "state", "told", status.state + (f", inputs {status.pins} active" if status.pins else ""))
    report.add(SECTION, "machine position", "told", place or "not told", "", "true only after homing")


async def _identify(cnc: QuietCnc, cell: Cell, status: Status, report: Report) -> None:
    seen: Identity = read_identity(await cnc.command("$I"), cnc.banner, cnc.port.name)
    report.judge(
        SECTION, "firmware", seen.firmware == cell.cnc.firmware, f"{NAMES[seen.firmware]} {seen.version}", NAMES[cell.cnc.firmware],
        "correct cnc.firmware in the cell file, or connect the right machine",
    )  # fmt: skip
    report.add(SECTION, "options", "told", seen.options or "none told")
    try:
        letters = check_identity(seen, cell.cnc.model_copy(update={"firmware": seen.firmware}), cell.letters, cnc.reader.axes_reported)
        report.add(SECTION, "axes", "ok", "".join(letters), "".join(cell.letters))
    except DriverError as error:
        report.add(SECTION, "axes", "FAULT", error.message, "".join(cell.letters), error.hint)
    least = cell.cnc.line_length_max + 1 + cell.cnc.rx_margin_bytes if seen.firmware == "grblhal" else 80
    free = min(seen.rx_bytes, status.rx_free or seen.rx_bytes)
    report.judge(
        SECTION, "receive buffer", free >= least, f"{seen.rx_bytes} bytes, {status.rx_free or 'not told how many'} free",
        f"at least {least} bytes: one longest line", "lower cnc.line_length_max in the cell file",
    )  # fmt: skip
    report.add(SECTION, "planner", "told", f"{seen.planner_blocks} blocks")


async def _work_offset(cnc: QuietCnc, cell: Cell, report: Report) -> None:
    held: dict[str, float] = {}
    for line in await cnc.command("$#"):
        name, _, values = line.strip("[]").partition(":")
        if name == "G54":
            held = {letter: float(value) for letter, value in zip(cell.letters, values.split(","), strict=False)}
    wanted = cell.placement.work_offset
    differ = [letter for letter, value in wanted.items() if not abs(held.get(letter, float("nan")) - value) <= OFFSET_TOLERANCE]
    report.judge(
        SECTION, "work offset (G54)", not differ, ", ".join(f"{letter} {value:g}" for letter, value in held.items()) or "not told",
        ", ".join(f"{letter} {value:g}" for letter, value in wanted.items()),
        f"differs in {', '.join(differ)}: measure the placement, then set G54 or placement.work_offset; a program with another one is refused",
    )  # fmt: skip


async def _time_status(cnc: QuietCnc, cell: Cell, clock: Clock, queries: int, report: Report) -> Status | None:
    taken: list[float] = []
    status: Status | None = None
    lost = 0
    for _ in range(queries):
        await clock.sleep(QUERY_PERIOD_S)
        answer = await cnc.status()
        if answer is None:
            lost += 1
            continue
        status, round_trip_s = answer
        taken.append(round_trip_s)
    limit_s = SAFE_SHARE * (cell.limits.status_stale_s - cell.cnc.status_period_s)
    if not taken:
        report.add(SECTION, "status round trip", "FAULT", f"none of {queries} answered", f"{1e3 * limit_s:.0f} ms", "check cable and control")
        return None
    _, late_s, text = times_text(taken)
    report.judge(
        SECTION, "status round trip", late_s <= limit_s and not lost, text + (f"; {lost} without answer" if lost else ""),
        f"{1e3 * limit_s:.0f} ms (limits.status_stale_s = {cell.limits.status_stale_s:g} less the period, times {SAFE_SHARE:g})",
        "look for a long or noisy cable, a USB hub, or a busy computer; else a longer limits.status_stale_s, which lets the laser on for longer",
    )  # fmt: skip
    return status
