"""What the firmware says about itself: welcome, build, settings, offsets, and the status report of both firmwares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from config import Axis
from config.cell import Cnc
from sim.cnc.modal import Offsets

BUSY_WCO_EVERY = 30  # grbl: reports between two that carry WCO:, while busy
IDLE_WCO_EVERY = 10
OVERRIDES_AFTER_WCO = 1

# bits of $10 in grblHAL
MACHINE_POSITION, BUFFER, LINE_NUMBERS, FEED_SPEED, PINS, WORK_OFFSET, OVERRIDES = (1 << bit for bit in range(7))
ALARM_SUBSTATE = 1 << 9
# bits of $10 in grbl 1.1
GRBL_MACHINE_POSITION, GRBL_BUFFER = 1, 2


@dataclass(frozen=True)
class Build:
    """One firmware build: sizes, texts and habits."""

    name: str
    rx_bytes: int
    planner_blocks: int
    line_length_max: int
    is_hal: bool
    letters: str
    tools: int

    @property
    def welcome(self) -> str:
        """The banner after power-up and reset."""
        return "GrblHAL 1.1f ['$' or '$HELP' for help]" if self.is_hal else "Grbl 1.1h ['$' for help]"

    def information(self, extended: bool) -> list[str]:
        """Answer to `$I` (`$I+`: extended)."""
        axes = f"[AXS:{len(self.letters)}:{self.letters}]"
        if not self.is_hal:
            return ["[VER:1.1h.20190830:]", f"[OPT:VMN,{self.planner_blocks},{self.rx_bytes}]", axes]
        options = f"[OPT:VNMSL,{self.planner_blocks},{self.rx_bytes},{len(self.letters)},{self.tools}]"
        lines = ["[VER:1.1f.20260801:]", options, axes, "[NEWOPT:ENUMS,RT-,ATC,ES,SD]", "[FIRMWARE:grblHAL]"]
        extra = ["[SIGNALS:HSED]", "[NVS STORAGE:*FLASH]", "[DRIVER:Simulator]", "[AUX IO:0,8,0,0]", "[WCS:0]"]
        return lines + (extra if extended and self.is_hal else [])


def build_of(firmware: str, letters: str, tools: int, rx_bytes: int, planner_blocks: int) -> Build:
    """grblHAL with the sizes of the cell's simulation, or grbl 1.1 with its own."""
    if firmware == "grbl":
        return Build("grbl", 128, 15, 79, False, letters, tools)
    return Build("grblHAL", rx_bytes, planner_blocks, 256, True, letters, tools)


def default_settings(build: Build, axes: Sequence[Axis], rpm_max: float, cnc: Cnc) -> dict[int, float]:
    """`$$` after flashing: reports, limits and speeds of this machine."""
    settings: dict[int, float] = {
        10: 511 + ALARM_SUBSTATE if build.is_hal else GRBL_MACHINE_POSITION | GRBL_BUFFER,
        11: cnc.junction_deviation_mm, 12: cnc.arc_tolerance_mm, 13: 0, 20: 1, 21: 0, 22: 1, 30: rpm_max, 31: 0, 32: 0,
    }  # fmt: skip
    for i, axis in enumerate(axes):
        settings[100 + i] = 320.0
        settings[110 + i] = axis.max_velocity * 60.0
        settings[120 + i] = axis.max_acceleration
        settings[130 + i] = axis.max - axis.min
    if build.is_hal:
        settings[481] = 0
    return dict(sorted(settings.items()))


def numbers(values: Sequence[float]) -> str:
    """Comma list with three decimals, as in every report."""
    return ",".join(f"{value:.3f}" for value in values)


def offset_report(offsets: Offsets, length_offset_mm: float) -> list[str]:
    """Answer to `$#`."""
    lines = [f"[G{code // 10}:{numbers(values)}]" for code, values in sorted(offsets.systems.items())]
    lines += [f"[G28:{numbers(offsets.g28)}]", f"[G30:{numbers(offsets.g30)}]", f"[G92:{numbers(offsets.g92)}]"]
    return [*lines, f"[TLO:{length_offset_mm:.3f}]", f"[PRB:{numbers([0.0] * offsets.count)}:0]"]


@dataclass(frozen=True)
class Snapshot:
    """What a status report is made of."""

    state: str
    substate: int | None
    position: Sequence[float]
    shift: Sequence[float]
    planner_free: int
    rx_free: int
    line: int
    feed_mm_min: float
    rpm: float
    overrides: tuple[int, int, int]
    pins: str
    accessories: str
    tool: int


class StatusReport:
    """Counts the reports, because WCO: and Ov: come only every so often."""

    def __init__(self) -> None:
        self._until_wco = 0
        self._until_overrides = OVERRIDES_AFTER_WCO
        self._tool: int | None = None

    def refresh(self) -> None:
        """Have WCO: and Ov: in the next two reports."""
        self._until_wco, self._until_overrides = 0, OVERRIDES_AFTER_WCO

    def text(self, now: Snapshot, build: Build, mask: int, full: bool = False) -> str:
        """One `<...>` line."""
        wanted = _wanted(build, mask)
        with_wco = full or self._until_wco <= 0
        with_overrides = full or (not with_wco and self._until_overrides <= 0)
        busy = now.state in ("Run", "Hold", "Jog", "Home", "Door")
        self._until_wco = (BUSY_WCO_EVERY if busy else IDLE_WCO_EVERY) - 1 if with_wco else self._until_wco - 1
        if with_overrides:
            self._until_overrides = BUSY_WCO_EVERY if busy else IDLE_WCO_EVERY
        self._until_overrides -= 1
        parts = [now.state if now.substate is None else f"{now.state}:{now.substate}"]
        if wanted & MACHINE_POSITION:
            parts.append("MPos:" + numbers(now.position))
        else:
            parts.append("WPos:" + numbers([a - b for a, b in zip(now.position, now.shift, strict=True)]))
        if wanted & BUFFER:
            parts.append(f"Bf:{now.planner_free},{now.rx_free}")
        if wanted & LINE_NUMBERS and now.line:
            parts.append(f"Ln:{now.line}")
        if wanted & FEED_SPEED:
            parts.append(f"FS:{now.feed_mm_min:.0f},{now.rpm:.0f}")
        if wanted & PINS and now.pins:
            parts.append("Pn:" + now.pins)
        if wanted & WORK_OFFSET and with_wco:
            parts.append("WCO:" + numbers(now.shift))
        if wanted & OVERRIDES and with_overrides:
            parts.append("Ov:" + ",".join(str(value) for value in now.overrides))
            if now.accessories:
                parts.append("A:" + now.accessories)
        regular = (with_wco and wanted & WORK_OFFSET) or (with_overrides and wanted & OVERRIDES)
        if build.is_hal and (regular or now.tool != self._tool):
            self._tool = now.tool
            parts.append(f"T:{now.tool}")
        return "<" + "|".join(parts) + ">"


def _wanted(build: Build, mask: int) -> int:
    """The mask in grblHAL's bits; grbl 1.1 has two bits and no line numbers in its usual build."""
    if build.is_hal:
        return mask
    always = FEED_SPEED | PINS | WORK_OFFSET | OVERRIDES
    position = MACHINE_POSITION if mask & GRBL_MACHINE_POSITION else 0
    return always | position | (BUFFER if mask & GRBL_BUFFER else 0)
