"""From the words of one line to actions, with every refusal that grbl and grblHAL know; a refused line changes nothing."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field

from config import Axis
from sim.cnc import codes
from sim.cnc.actions import (
    FEED,
    INVERSE_TIME,
    RAPID,
    Action,
    Coolant,
    Dwell,
    Move,
    Output,
    Pause,
    ProgramEnd,
    Spindle,
    ToolChange,
)
from sim.cnc.arcs import centre_from_radius, segments
from sim.cnc.codes import GcodeError
from sim.cnc.modal import (
    G_GROUP,
    INCH_MM,
    LINE_NUMBER_MAX,
    M_GROUP,
    OUTPUTS,
    PLANES,
    TAKES_AXIS_WORDS,
    TOOL_MAX,
    Modal,
    Offsets,
)


@dataclass(slots=True)
class Block:
    """One line's words, sorted: `g` and `m` by modal group, `axes` by axis index, `values` by letter."""

    g: dict[str, int] = field(default_factory=dict)
    m: dict[str, int] = field(default_factory=dict)
    axes: dict[int, float] = field(default_factory=dict)
    values: dict[str, float] = field(default_factory=dict)

    def take(self, letter: str) -> float:
        """A value that the line must carry. Raises GcodeError 28."""
        if letter not in self.values:
            raise GcodeError(codes.VALUE_WORD_MISSING)
        return self.values.pop(letter)


class Interpreter:
    """Modal state, offsets and the position that the parser has reached (machine coordinates, order of the axes)."""

    def __init__(
        self, axes: Sequence[Axis], work_offset: Sequence[float], position: Sequence[float], rpm_max: float
    ) -> None:
        self.index = {axis.letter: i for i, axis in enumerate(axes)}
        self.is_linear = [axis.kind == "linear" for axis in axes]
        self.offsets = Offsets(len(axes), systems={540: list(work_offset)}, g28=[axis.home for axis in axes])
        self.position = list(position)
        self.modal = Modal()
        self.rpm_max = rpm_max
        self.tools: frozenset[int] = frozenset()
        self.arc_tolerance_mm = 0.002

    def reset(self, position: Sequence[float]) -> None:
        """Defaults after a reset or power-up; G92 is volatile."""
        tool = self.modal.tool_selected
        self.modal = Modal(tool_selected=tool)
        self.position = list(position)
        self.offsets.g92 = [0.0] * len(self.position)

    def shift(self) -> list[float]:
        """Machine minus work coordinates (`WCO:`)."""
        system = self.offsets.systems[self.modal.system]
        shift = [a + b for a, b in zip(system, self.offsets.g92, strict=True)]
        if self.modal.length_offset_mm and "Z" in self.index:
            shift[self.index["Z"]] += self.modal.length_offset_mm
        return shift

    def interpret(self, words: list[tuple[str, float]]) -> list[Action]:
        """Actions of one line in order of execution. Raises GcodeError; then nothing has changed."""
        saved = self.modal
        offsets = self.offsets
        position = list(self.position)
        try:
            block = self._sort(words)
            if not block.g and not block.m and block.values.keys() <= {"N", "F"}:
                return self._motion(block, int(block.values.pop("N", 0)))
            self.modal = copy(saved)
            if block.g.get("once", 40) != 40:
                self.offsets = Offsets(offsets.count, dict(offsets.systems), offsets.g28, offsets.g30, offsets.g92)
            return self._carry_out(block)
        except GcodeError:
            self.modal, self.offsets, self.position = saved, offsets, position
            raise

    def _sort(self, words: list[tuple[str, float]]) -> Block:
        block = Block()
        index = self.index
        for letter, value in words:
            if letter in index:
                if index[letter] in block.axes:
                    raise GcodeError(codes.WORD_REPEATED)
                block.axes[index[letter]] = value
            elif letter == "G" or letter == "M":
                self._sort_code(block, letter, value)
            elif letter in "FIJKLNPRST":
                if letter in block.values:
                    raise GcodeError(codes.WORD_REPEATED)
                block.values[letter] = value
            else:
                raise GcodeError(codes.UNSUPPORTED)
        self._check_values(block.values)
        return block

    @staticmethod
    def _sort_code(block: Block, letter: str, value: float) -> None:
        code = round(value * 10) if letter == "G" else round(value)
        exact = abs(value * 10 - code) < 1e-6 if letter == "G" else abs(value - code) < 1e-9
        group = (G_GROUP if letter == "G" else M_GROUP).get(code)
        if not exact or group is None:
            raise GcodeError(codes.UNSUPPORTED)
        chosen = block.g if letter == "G" else block.m
        if group in chosen:
            raise GcodeError(codes.MODAL_GROUP_VIOLATION)
        chosen[group] = code

    @staticmethod
    def _check_values(values: dict[str, float]) -> None:
        for letter in "NFSTP":
            if values.get(letter, 0.0) < 0.0:
                raise GcodeError(codes.NEGATIVE_VALUE)
        if values.get("N", 0.0) > LINE_NUMBER_MAX:
            raise GcodeError(codes.INVALID_LINE_NUMBER)
        for letter in "NTL":
            if values.get(letter, 0.0) % 1.0:
                raise GcodeError(codes.NOT_INTEGER)
        if values.get("T", 0.0) > TOOL_MAX:
            raise GcodeError(codes.TOOL_NUMBER)

    def _carry_out(self, block: Block) -> list[Action]:
        modal, actions = self.modal, list[Action]()
        line = int(block.values.pop("N", 0))
        if "feed_mode" in block.g:
            if block.g["feed_mode"] != modal.feed_mode:
                modal.feed_mm_min = 0.0
            modal.feed_mode = block.g["feed_mode"]
        modal.units = block.g.get("units", modal.units)
        modal.plane = block.g.get("plane", modal.plane)
        self._spindle_and_tool(block, actions)
        if "output" in block.m:
            port = block.take("P")
            if port % 1.0 or port >= OUTPUTS:
                raise GcodeError(codes.P_VALUE)
            code = block.m["output"]
            actions.append(Output(int(port), code in (62, 64), code in (62, 63)))
        once = block.g.get("once", 0)
        if once == 40:
            actions.append(Dwell(block.take("P")))
        self._length_offset(block)
        modal.system = block.g.get("system", modal.system)
        modal.distance = block.g.get("distance", modal.distance)
        if once in TAKES_AXIS_WORDS and "motion" in block.g and block.axes:
            raise GcodeError(codes.AXIS_WORD_CONFLICT)
        if once in (100, 280, 281, 300, 301, 920, 921):
            actions += self._offsets_and_references(block, once, line)
        modal.motion = block.g.get("motion", modal.motion)
        if once == 530 and modal.motion not in (0, 10):
            raise GcodeError(codes.G53_NEEDS_G0_OR_G1)
        actions += self._motion(block, line, machine_frame=once == 530, explicit="motion" in block.g)
        stop = block.m.get("stop")
        if stop == 0:
            actions.append(Pause())
        elif stop in (2, 30):
            self._end()
            actions.append(ProgramEnd())
        return actions

    def _spindle_and_tool(self, block: Block, actions: list[Action]) -> None:
        modal = self.modal
        if "T" in block.values:
            tool = int(block.values.pop("T"))
            if tool and tool not in self.tools:
                raise GcodeError(codes.TOOL_NUMBER)
            modal.tool_selected = tool
        if "change" in block.m:
            actions.append(ToolChange(modal.tool_selected))
        has_speed = "S" in block.values
        if has_speed:
            modal.rpm = min(block.values.pop("S"), self.rpm_max)
        modal.spindle = block.m.get("spindle", modal.spindle)
        if "spindle" in block.m or (has_speed and modal.spindle != 5):
            direction = {3: 1, 4: -1, 5: 0}[modal.spindle]
            actions.append(Spindle(direction, modal.rpm if direction else 0.0))
        if "coolant" in block.m:
            code = block.m["coolant"]
            modal.flood = code == 8 or (code == 7 and modal.flood)
            modal.mist = code == 7 or (code == 8 and modal.mist)
            actions.append(Coolant(modal.flood, modal.mist))

    def _length_offset(self, block: Block) -> None:
        length = block.g.get("length")
        if length == 490:
            self.modal.length_offset_mm = 0.0
        elif length == 431:
            if set(block.axes) != {self.index.get("Z", -1)}:
                raise GcodeError(codes.TOOL_OFFSET_AXIS)
            if "motion" in block.g:
                raise GcodeError(codes.AXIS_WORD_CONFLICT)
            self.modal.length_offset_mm = next(iter(self._scaled(block).values()))
            block.axes.clear()

    def _scaled(self, block: Block) -> dict[int, float]:
        if self.modal.units == 210:
            return block.axes
        return {i: value * INCH_MM if self.is_linear[i] else value for i, value in block.axes.items()}

    def _target(self, block: Block, machine_frame: bool) -> list[float]:
        target = list(self.position)
        shift = [0.0] * len(target) if machine_frame else self.shift()
        is_relative = self.modal.distance == 910 and not machine_frame
        for i, value in self._scaled(block).items():
            target[i] = target[i] + value if is_relative else value + shift[i]
        return target

    def _offsets_and_references(self, block: Block, once: int, line: int) -> list[Action]:
        offsets = self.offsets
        if once == 100:
            self._set_system(block)
        elif once == 920:
            if not block.axes:
                raise GcodeError(codes.NO_AXIS_WORDS)
            without = [a - b for a, b in zip(self.shift(), offsets.g92, strict=True)]
            offsets.g92 = list(offsets.g92)
            for i, value in self._scaled(block).items():
                offsets.g92[i] = self.position[i] - without[i] - value
        elif once == 921:
            offsets.g92 = [0.0] * offsets.count
        elif once == 281:
            offsets.g28 = list(self.position)
        elif once == 301:
            offsets.g30 = list(self.position)
        else:
            reference = offsets.g28 if once == 280 else offsets.g30
            moves: list[Action] = []
            goal = list(reference)
            if block.axes:
                between = self._target(block, machine_frame=False)
                moves.append(Move(tuple(between), RAPID, 0.0, line))
                goal = [reference[i] if i in block.axes else value for i, value in enumerate(between)]
            block.axes.clear()
            self.position = goal
            return [*moves, Move(tuple(goal), RAPID, 0.0, line)]
        block.axes.clear()
        return []

    def _set_system(self, block: Block) -> None:
        if not block.axes:
            raise GcodeError(codes.NO_AXIS_WORDS)
        kind, number = block.take("L"), block.take("P")
        if kind not in (2, 20):
            raise GcodeError(codes.UNSUPPORTED)
        if number % 1.0 or number > 6:
            raise GcodeError(codes.UNSUPPORTED_COORDINATE_SYSTEM)
        code = 530 + 10 * int(number) if number else self.modal.system
        values = list(self.offsets.systems[code])
        length = self.modal.length_offset_mm
        for i, value in self._scaled(block).items():
            own = length if self.index.get("Z") == i else 0.0
            values[i] = value if kind == 2 else self.position[i] - self.offsets.g92[i] - own - value
        self.offsets.systems[code] = values

    def _motion(self, block: Block, line: int, machine_frame: bool = False, explicit: bool = False) -> list[Action]:
        modal, values = self.modal, block.values
        feed = values.pop("F", None)
        if feed is not None and modal.units == 200 and modal.feed_mode == 940:
            feed *= INCH_MM
        if modal.feed_mode == 940:
            feed = modal.feed_mm_min if feed is None else feed
        is_arc = modal.motion in (20, 30)
        if not block.axes:
            if explicit and is_arc:
                raise GcodeError(codes.NO_AXIS_WORDS)
            if values:
                raise GcodeError(codes.UNUSED_WORDS)
            self._keep_feed(feed)
            return []
        if modal.motion == 800:
            raise GcodeError(codes.UNUSED_AXIS_WORDS)
        if modal.motion and not feed:
            raise GcodeError(codes.UNDEFINED_FEED)
        target = self._target(block, machine_frame)
        if is_arc:
            points = self._arc(block, target)
        elif values:
            raise GcodeError(codes.UNUSED_WORDS)
        else:
            points = [target]
        self.position = target
        self._keep_feed(feed)
        if not modal.motion:
            return [Move(tuple(target), RAPID, 0.0, line)]
        if modal.feed_mode == 930:
            return [Move(tuple(point), INVERSE_TIME, 60.0 / (feed or 1.0) / len(points), line) for point in points]
        return [Move(tuple(point), FEED, feed or 0.0, line) for point in points]

    def _keep_feed(self, feed: float | None) -> None:
        if self.modal.feed_mode == 940 and feed is not None:
            self.modal.feed_mm_min = feed

    def _arc(self, block: Block, target: list[float]) -> list[list[float]]:
        i, j, letters = PLANES[self.modal.plane]
        if i not in block.axes and j not in block.axes:
            raise GcodeError(codes.NO_AXIS_WORDS_IN_PLANE)
        scale = INCH_MM if self.modal.units == 200 else 1.0
        clockwise = self.modal.motion == 20
        values = block.values
        if "R" in values:
            x, y = target[i] - self.position[i], target[j] - self.position[j]
            centre = centre_from_radius(x, y, values.pop("R") * scale, clockwise)
        elif letters[0] in values or letters[1] in values:
            centre = values.pop(letters[0], 0.0) * scale, values.pop(letters[1], 0.0) * scale
        else:
            raise GcodeError(codes.NO_OFFSETS_IN_PLANE)
        if values:
            raise GcodeError(codes.UNUSED_WORDS)
        return segments(self.position, target, centre, (i, j), clockwise, self.arc_tolerance_mm)

    def _end(self) -> None:
        modal = self.modal
        modal.motion, modal.plane, modal.distance, modal.feed_mode, modal.system = 10, 170, 900, 940, 540
        modal.spindle, modal.flood, modal.mist, modal.feed_mm_min = 5, False, False, 0.0
