"""The head of a resumed program: what brings machine and process to the place of re-entry, as lines with a comment before each part."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell
from planner.kinematics.chain import Chain, Floats
from planner.kinematics.timing import axis_limited_times
from planner.post.assemble import line_table
from planner.post.blocks import Script, inverse_time
from planner.post.clock import item_times, spin_up_s
from planner.post.dialect import JointDialect
from planner.post.draft import Draft
from planner.post.header import remark
from planner.post.macros import START, MacroBook
from planner.post.process_state import MODE_DEPOSIT, MODE_MILL
from planner.post.retract import Retract
from planner.post.tape import Entry, Move, Origin, Tape, schedule_of
from planner.post.words import Words, decimal
from planner.program import Channel, LineKind, Program
from planner.resume.approach import Approach
from planner.resume.reentry import Reentry
from planner.resume.stretch import HASTE, Stretch

_ALL = 0b11111
_POWER_DECIMALS = 2  # of a watt
_ARC_MM = 1e-9


@dataclass(frozen=True)
class Setting:
    """What the head is written for.  cell : fitted to the dialect   ramp_power : share of the power at which the overlap begins"""

    program: Program
    cell: Cell
    chain: Chain
    dialect: JointDialect
    ramp_power: float


@dataclass(frozen=True)
class Head:
    """Lines (n,), table (n,) LINE_DTYPE and schedule of what comes before the original's lines; entries of line n + 1 are for the first of these."""

    lines: tuple[str, ...]
    table: NDArray[np.void]
    schedule: NDArray[np.void]


@dataclass
class HeadWriter:
    """Writes the parts of the head on a tape, in the order in which they are run."""

    setting: Setting
    reentry: Reentry
    approach: Approach
    tape: Tape = field(init=False)

    def __post_init__(self) -> None:
        cell, row = self.setting.cell, self.setting.program.table[self.reentry.place]
        self.tape = Tape(np.array([axis.home for axis in cell.axes]))
        self._layer, self._operation, self._pass = int(row["layer"]), int(row["operation"]), int(row["pass_"])
        self._link = Origin(LineKind.LINK, self._layer, self._operation)
        self._does = Origin(LineKind.PROCESS, self._layer, self._operation, self._pass)
        self._speeds = np.array([axis.max_velocity for axis in cell.axes])
        self._part = 0

    def written(self, about: list[str]) -> Head:
        """The whole head; about : comments at its top. Raises PostError if a line is too long for the control."""
        for text in about:
            self._say(text)
        self._make_safe()
        self._wait()
        self._take_tool()
        self._turn_and_go_over()
        self._come_down()
        if self.reentry.stretch is not None:
            self._run_again(self.reentry.stretch)
        return _head(self.tape, self.setting)

    def _make_safe(self) -> None:
        output = self.setting.cell.cnc.laser_gate_output
        self._say("modal state, gate shut, then up: clear of everything", is_part=True)
        self.tape.command(START, Origin())
        if self.setting.program.gate == "stream" and output is not None:
            self.tape.command(f"M63 P{output}", Origin())
        retract = Retract.of(self.setting.chain, self.setting.cell)
        up = self.tape.joints.copy()
        up[retract.column] = retract.end
        self._go(up, Origin(LineKind.LINK, self._layer), named=1 << retract.column)

    def _wait(self) -> None:
        dwells = self.reentry.dwells
        if not dwells:
            return
        self._say("the layers' wait, as planned; on a cold part it is not needed", is_part=True)
        table = self.setting.program.table
        for line in dwells:
            text = self.setting.program.lines[line].split(" ", 1)[-1]
            place = Origin(LineKind.DWELL, int(table["layer"][line]), int(table["operation"][line]))
            self.tape.command(
                text, place, stops=True, time_s=float(table["time_end_s"][line] - table["time_start_s"][line])
            )

    def _take_tool(self) -> None:
        tool, cell = self.reentry.tool, self.setting.cell
        self._say(f"T{tool.number} {tool.name}{'' if self.reentry.is_deposit else ', spindle'}", is_part=True)
        place = Origin(LineKind.TOOL, self._layer, self._operation)
        self.tape.tool = tool.number
        change = self.tape.command(f"M6 T{tool.number}", place, stops=True, time_s=cell.response.tool_change_s)
        if not self.reentry.is_deposit:
            self.tape.schedule(Channel.MODE, MODE_MILL, change, is_barrier=True)
        rpm = self.reentry.spindle_rpm
        if rpm > 0.0:
            self.tape.command(f"M3 S{rpm:.0f}", place, stops=True, time_s=spin_up_s(cell, 0.0, rpm))

    def _turn_and_go_over(self) -> None:
        cell, way = self.setting.cell, self.approach
        rotary = [axis.letter for axis in cell.axes if axis.kind == "rotary"]
        self._say(f"{' and '.join(rotary)} as at the place of re-entry, up there", is_part=True)
        if self.reentry.is_deposit:
            self.tape.schedule(Channel.MODE, MODE_DEPOSIT, self.tape.count, is_barrier=True)
        named = sum(1 << k for k, axis in enumerate(cell.axes) if axis.kind == "rotary")
        self._go(way.turned, self._link, named=named)
        self._say("over the place of re-entry", is_part=True)
        self._go(way.over, self._link, named=_ALL)
        self._say("down, clear of the part", is_part=True)
        if self.reentry.is_deposit:
            self._power(self._level(0.0 if self.reentry.stretch is not None else 1.0))
        self._go(way.clear, self._link)

    def _come_down(self) -> None:
        stretch = self.reentry.stretch
        if self.reentry.is_deposit:
            levels = self.reentry.levels
            for channel in (Channel.CARRIER_GAS_L_MIN, Channel.SHIELD_GAS_L_MIN, Channel.POWDER_G_MIN):
                if channel in levels:
                    self.tape.schedule(channel, levels[channel], self.tape.count + self._comments, is_barrier=True)
            told = [f"{levels[Channel.SHIELD_GAS_L_MIN]:.3g} L/min gas"] if Channel.SHIELD_GAS_L_MIN in levels else []
            told += [f"{levels[Channel.POWDER_G_MIN]:.3g} g/min powder"] if Channel.POWDER_G_MIN in levels else []
            steady = f", first {', '.join(told)}, steady" if told else ""
            self._say(f"{'down' if stretch is not None else 'on'} to the pass{steady}", is_part=True)
        elif stretch is not None:
            self._say("down into what is cut already, at the feed of the pass", is_part=True)
        if stretch is not None:
            self._feed_to(self.approach.target, stretch.speed_mm_s)

    @property
    def _comments(self) -> int:
        """Items that a comment takes."""
        return int(self.setting.cell.cnc.takes_comments)

    def _run_again(self, stretch: Stretch) -> None:
        lights = self.reentry.is_deposit
        if lights and stretch.lead_in_mm > 0.0:
            self._say(f"lead-in of {stretch.lead_in_mm:.2f} mm, laser off", is_part=True)
        if not lights and stretch.overlap_mm > 0.0:
            self._say(f"{stretch.overlap_mm:.2f} mm along the cut once more", is_part=True)
        is_lit = has_ended = False
        for k in range(len(stretch.line)):
            again = bool(stretch.overlap[k, 0] < 1.0)
            if stretch.is_lit[k] and not is_lit:
                self._light(stretch)
                is_lit = True
            if is_lit:
                self._power(self._level(float(stretch.overlap[k].mean()) if again else 1.0))
            if not again and not has_ended and is_lit == lights:
                self._say(f"here {'metal' if lights else 'the cut'} ended: on as programmed", is_part=True)
                has_ended = True
            times = self._taken(stretch.joints[k + 1], self._time_s(stretch, k))
            self.tape.moves(
                stretch.joints[k + 1 : k + 2],
                stretch.arc_mm[k],
                times,
                Move.FEED,
                self._does,
                bulge=stretch.bulge[k : k + 1],
            )

    def _time_s(self, stretch: Stretch, k: int) -> float:
        """Of a piece: as planned, but for the laser's overlap, as fast as the control takes lines."""
        planned_s = float(stretch.time_s[k])
        if not self.reentry.is_deposit or stretch.overlap[k, 0] >= 1.0:
            return planned_s
        return min(planned_s, max(planned_s / HASTE, 1.0 / self.setting.cell.cnc.max_blocks_per_s))

    def _light(self, stretch: Stretch) -> None:
        output = self.setting.cell.cnc.laser_gate_output
        level = self.reentry.levels.get(Channel.LASER_W, 0.0)
        if stretch.overlap_mm > 0.0:
            low = self.setting.ramp_power * level
            self._say(
                f"laser on {stretch.overlap_mm:.2f} mm before metal's end, {low:.0f} to {level:.0f} W, fast",
                is_part=True,
            )
        if self.setting.program.gate == "modbus" or output is None:
            self.tape.schedule(Channel.EMISSION, 1.0, self.tape.count)
        else:
            self.tape.command(f"M62 P{output}", self._does)

    def _level(self, share: float) -> float:
        """W: of the level there, at a share of the overlap."""
        low = self.setting.ramp_power
        return self.reentry.levels.get(Channel.LASER_W, 0.0) * (low + (1.0 - low) * share)

    def _power(self, level_w: float) -> None:
        """The laser's level from the next move on."""
        output = self.setting.cell.cnc.power_output
        if output is None:
            self.tape.schedule(Channel.LASER_W, level_w, self.tape.count)
        else:
            text = decimal(round(level_w * 10**_POWER_DECIMALS), _POWER_DECIMALS)
            self.tape.command(f"M67 E{output} Q{text}", self._link)

    def _taken(self, joints: Floats, time_s: float) -> Floats:
        return axis_limited_times((joints - self.tape.joints)[None, :], np.array([time_s]), self._speeds)

    def _go(self, joints: Floats, origin: Origin, named: int = 0) -> None:
        self.tape.moves(joints[None, :], np.zeros(2), self._taken(joints, 0.0), Move.RAPID, origin, named)

    def _feed_to(self, joints: Floats, feed_mm_s: float) -> None:
        way = float(np.linalg.norm(joints - self.tape.joints))
        if way > _ARC_MM:
            self.tape.moves(joints[None, :], np.zeros(2), self._taken(joints, way / feed_mm_s), Move.FEED, self._link)

    def _say(self, text: str, is_part: bool = False) -> None:
        """A comment of its own; parts are numbered."""
        if not self.setting.cell.cnc.takes_comments:
            return
        self._part += int(is_part)
        self.tape.command(
            remark(f"{self._part}. {text}" if is_part else text),
            Origin(LineKind.SETUP, self._layer if self._part > 1 else -1),
        )


def _head(tape: Tape, setting: Setting) -> Head:
    program, cell = setting.program, setting.cell
    words = Words.of(cell, program.work_offset)
    draft = Draft.of(tape, words)
    book = MacroBook(cell, setting.dialect.NAME, setting.dialect.MACROS, setting.dialect.values(cell))
    draft = draft.completed(book)
    items = draft.items
    rows = np.append(draft.line_of_item(tape.count), len(items)).astype(np.int64)
    waits = rows[np.array(sorted({entry.item for entry in tape.entries if entry.is_barrier}), dtype=np.int64)]
    times = item_times(items, cell, waits[waits < len(items)])
    counts = np.vstack([words.counts(np.array([[axis.home for axis in cell.axes]])), words.counts(items["joints"])])
    is_rotary = np.array([axis.kind == "rotary" for axis in cell.axes])
    by_time = inverse_time(counts, is_rotary, items["move"], items["chunk"].astype(np.int64))
    script = Script(
        counts, items["move"], by_time, items["time_s"], items["way"], items["named"], items["bulge"], draft.texts
    )
    lines = setting.dialect.write(words, script, cell.cnc.line_length_max)
    table = line_table(items, times, setting.program.machine_from_build, setting.chain, setting.cell)
    return Head(lines, table, schedule_of(_ordered(tape.entries), rows))


def _ordered(entries: list[Entry]) -> list[Entry]:
    return sorted(entries, key=lambda entry: entry.item)
