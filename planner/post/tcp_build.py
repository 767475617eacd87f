"""The tape in workpiece coordinates: blocks of tip and axis, NURBS, machine positions and commands, before any control's words."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from planner.plan import Pass
from planner.post.header import operation_text
from planner.post.pass_curve import PassCurve
from planner.post.tape import Entry, Move
from planner.post.tcp_batch import Batch, spline_blocks
from planner.post.tcp_blocks import BLOCK_DTYPE, Blocks, Command, Say, What, meaning
from planner.post.tcp_feed import pass_feeds
from planner.post.tcp_job import Job
from planner.post.tcp_pass import Control, Floats, Spline, samples, splines, straight
from planner.post.tcp_rotary import turned_to
from planner.program import Channel

Ints = NDArray[np.int64]

_SAME_ARC_MM = 1e-6
_SHORTEST_MM = 1e-3  # of a stretch of a pass: what is said nearer to a set-point is said there
_STANDS = 1e-7  # mm or deg
_TURN_DEG = 5.0  # of rapids that turn: a chord leaves the way round by less than a thousandth of its radius
_Said = dict[float, list[tuple[int, Command | None, list[Entry]]]]


class Builder:
    """Walks along the tape and adds blocks."""

    def __init__(self, job: Job, control: Control) -> None:
        self._job, self._control = job, control
        self._items = job.tape.items()
        self._parts: list[tuple[int, NDArray[np.void]]] = []
        self._serial = 0
        self._batch = Batch(job.frame, control.degrees)
        self._runs: list[int] = []  # first items of what belongs together: a pass, or what is between passes
        self._commands: list[Command] = []
        self._entries: dict[int, list[Entry]] = {}
        for entry in job.tape.entries:
            self._entries.setdefault(entry.item, []).append(entry)
        self._levels: dict[Channel, float] = {}
        self._samples: tuple[PassCurve, Floats] | None = None  # of the pass at hand
        self._machine_moves = 0  # since the tip was moved
        self._was_dark = (
            False  # the gate went off since the last move: it is to close with motion, not with a change of mode
        )
        self._starts = np.vstack([[axis.home for axis in job.cell.axes], self._items["joints"][:-1]])
        self._end = self._poses(self._items["joints"])
        self._begin = self._poses(self._starts)

    def build(self) -> Blocks:
        """All blocks in the order of the tape. Raises PostError for a command that has no meaning here."""
        items = self._items
        key = np.where(items["pass_"] >= 0, items["operation"].astype(np.int64) << 32 | items["pass_"], -1)
        edges = np.flatnonzero(np.append(True, np.diff(key) != 0))
        self._say(0, Command(Say.BEGIN))
        told = -1
        self._runs = edges.tolist()
        is_said = items["command"] >= 0
        is_said[list(self._entries)] = True
        self._said_items = np.flatnonzero(is_said)
        for begin, end in itertools.pairwise([*self._runs, len(items)]):
            here = int(items["operation"][begin])
            if here >= 0 and here != told:
                self._announce(begin, here)
                told = here
            if key[begin] >= 0:
                self._pass(begin, end)
            else:
                self._between(begin, end)
        rows, serials = self._batch.blocks()
        sizes = [len(part) for _, part in self._parts]
        rows = np.concatenate([rows, *(part for _, part in self._parts)])
        serials = np.concatenate([serials, np.repeat([serial for serial, _ in self._parts], sizes)])
        rows = rows[np.argsort(serials, kind="stable")]
        self._place_on_tape(rows)
        return Blocks(rows, self._commands)

    def _add(self, rows: NDArray[np.void]) -> None:
        self._parts.append((self._next_serials(1), rows))

    def _next_serials(self, count: int) -> int:
        self._serial += count
        return self._serial - count

    def _announce(self, item: int, operation: int) -> None:
        of_operation = self._items["operation"] == operation
        tool = int(self._items["tool"][of_operation][-1])
        self._say(item, Command(Say.COMMENT, text=operation_text(operation, self._job.posted[operation], tool)))

    def _between(self, begin: int, end: int) -> None:
        """Commands and positioning, which belong to no pass."""
        for item in range(begin, end):
            self._schedule(item, self._entries.get(item, []))
            row = self._items[item]
            if row["command"] >= 0:
                self._tape_command(item)
                continue
            block = self._row(item)
            rotary = [joint.column for joint in self._job.chain.rotary]
            stands = np.abs(row["joints"] - self._starts[item])[rotary].max() <= _STANDS
            is_machine = row["move"] == Move.RAPID and self._control.takes_machine_moves
            if is_machine and stands and self._was_dark:
                lift = block.copy()
                lift["what"] = What.RAPID
                self._add(lift)
                block["time_s"] = 0.0
            self._was_dark = False
            if is_machine:
                block["named"] = self._named(item)
            else:
                self._machine_moves = 0
            block["what"] = What.MACHINE if is_machine else What.RAPID if row["move"] == Move.RAPID else What.LINE
            way = float(np.linalg.norm(self._begin[0][item] - self._end[0][item])) if stands else float(row["way"])
            block["feed_mm_min"] = 60.0 * way / max(float(row["time_s"]), 1e-9)  # nominal: the control ramps by itself
            self._add(self._turned(item, block) if block["what"][0] == What.RAPID and not stands else block)

    def _turned(self, item: int, block: NDArray[np.void]) -> NDArray[np.void]:
        """A rapid that turns, in steps along the way that the axes take: between its ends the tip goes round, not straight."""
        columns = [joint.column for joint in self._job.chain.rotary]
        begin, end = self._starts[item], self._items["joints"][item]
        count = int(np.ceil(np.abs(end - begin)[columns].max() / _TURN_DEG))
        rows = np.repeat(block, count)
        rows["joints"] = begin + (np.arange(1, count + 1) / count)[:, None] * (end - begin)
        rows["time_s"] /= count
        tool = int(self._items["tool"][item])
        length = next((np.array(tool_.tip_mm) for tool_ in self._job.cell.tools if tool_.number == tool), np.zeros(3))
        tips, axes = self._job.chain.forward(rows["joints"], length)
        rows["tip"] = rows["tip_end"] = tips - (self._job.placed[:3, 3] - self._job.frame.shift)
        rows["axis"] = rows["axis_end"] = axes
        return rows

    def _named(self, item: int) -> int:
        """Axes of a machine move: those that move, for the tool lifts straight off; all of them from the second move on, to know every axis."""
        row = self._items[item]
        moves = np.abs(row["joints"] - self._starts[item]) > _STANDS
        told = int(row["named"]) | int((moves << np.arange(len(moves))).sum())
        if self._machine_moves == 1:
            told = (1 << len(moves)) - 1
        self._machine_moves += 1
        return told

    def _pass(self, begin: int, end: int) -> None:
        """The blocks of one pass, cut where set-points or the feed change or something is said."""
        items, job = self._items, self._job
        number, index = int(items["operation"][begin]), int(items["pass_"][begin])
        operation = job.posted[number]
        source = operation.passes[index]
        moves = begin + np.flatnonzero(items["command"][begin:end] < 0)
        if moves.size == 0:
            for item in range(begin, end):
                self._schedule(item, self._entries.get(item, []))
                self._tape_command(item)
            return
        said = self._said(begin, end)
        first, last = float(items["arc_start_mm"][moves[0]]), float(items["arc_end_mm"][moves[-1]])
        feeds = pass_feeds(items[moves], source)
        edges = _edges(first, last, [*said, *source.setpoints[:, 0].tolist(), *feeds.arc_mm.tolist()])
        of_stretch = feeds.at(0.5 * (edges[1:] + edges[:-1]))
        if self._batch.takes(source):
            parts: list[NDArray[np.void]] = []
        else:
            curve = PassCurve(source, job.frame.matrix, f"pass {index} of operation {number}")
            own = np.append(first, items["arc_end_mm"][moves])
            stretches = zip(itertools.pairwise(edges.tolist()), of_stretch.tolist(), strict=True)
            parts = [self._stretch(curve, stretch, own, feed) for stretch, feed in stretches]
        self._was_dark, self._machine_moves = False, 0
        self._in_order(said, edges, int(moves[0]), source, of_stretch, parts)

    def _in_order(
        self, said: _Said, edges: Floats, item: int, source: Pass, feeds: Floats, parts: list[NDArray[np.void]]
    ) -> None:
        """What is said within a pass between its stretches; parts : their blocks, none: they are made with those of other passes."""
        begin = 0
        count = len(edges) - 1
        for k in range(count + 1):
            is_said = k == count or any(at <= edges[k] + _SHORTEST_MM for at in said)
            if is_said and k > begin:
                serial = self._next_serials(k - begin)
                if parts:
                    for rows in parts[begin:k]:
                        rows["item"] = item
                    self._parts.append((serial, np.concatenate(parts[begin:k])))
                else:
                    self._batch.add(serial, item, source, edges[begin : k + 1], feeds[begin:k])
                begin = k
            if is_said:
                self._flush(said, np.inf if k == count else float(edges[k]) + _SHORTEST_MM)

    def _stretch(self, curve: PassCurve, arcs: tuple[float, float], tape_arcs: Floats, feed: float) -> NDArray[np.void]:
        """Blocks of the pass between two arc lengths; tape_arcs : ends of the tape's own moves."""
        low, high = curve.source.tip.domain
        start, end = curve.at_arc_length(np.array(arcs)).tolist()
        start = low if arcs[0] <= _SAME_ARC_MM else start
        end = high if curve.length_mm - arcs[1] <= _SAME_ARC_MM else end
        cell, frame = self._job.cell, self._job.frame
        made: list[Spline] = []
        if not curve.source.rapid:
            made = splines(curve, start, end, frame, self._control, cell.chord_tolerance_mm)
        if made:
            return np.concatenate([spline_blocks(item, curve, feed) for item in made])
        at = straight(curve, self._sampled(curve), start, end, cell.axis_tolerance_deg)
        if self._control.tells_rotary and not curve.has_constant_axis:
            own = curve.at_arc_length(
                tape_arcs[(tape_arcs > arcs[0] + _SHORTEST_MM) & (tape_arcs < arcs[1] - _SHORTEST_MM)]
            )
            at = np.unique(np.concatenate([at, own]))
        blocks = np.zeros(len(at) - 1, BLOCK_DTYPE)
        blocks["what"] = What.RAPID if curve.source.rapid else What.LINE
        tips, axes, reached = curve.tips(at), curve.axes(at), curve.arc_length(at)
        blocks["tip"] = blocks["tip_end"] = tips[1:]
        blocks["axis"] = blocks["axis_end"] = axes[1:]
        blocks["arc_start_mm"], blocks["arc_end_mm"] = reached[:-1], reached[1:]
        blocks["feed_mm_min"] = feed
        return blocks

    def _sampled(self, curve: PassCurve) -> Floats:
        if self._samples is None or self._samples[0] is not curve:
            self._samples = (curve, samples(curve, self._job.cell.chord_tolerance_mm))
        return self._samples[1]

    def _place_on_tape(self, rows: NDArray[np.void]) -> None:
        """What each row belongs to; of rows of passes also time and joints, by the arc length that the tape's moves have reached."""
        items, runs = self._items, np.array(self._runs)
        source = items[rows["item"]]
        for name in ("kind", "layer", "operation", "pass_", "tool"):
            rows[name] = source[name]
        follows = (rows["what"] >= What.RAPID) & (rows["pass_"] >= 0)
        rows["command"][follows] = -1
        moves = np.flatnonzero((items["pass_"] >= 0) & (items["command"] < 0))
        if moves.size == 0 or not follows.any():
            return
        far = 1.0 + float(items["arc_end_mm"][moves].max())
        run = np.searchsorted(runs, moves, side="right")
        is_first = np.append(True, np.diff(run) != 0)
        clock = np.cumsum(np.where(items["command"] < 0, self._job.times, 0.0))
        before = moves[is_first]
        at = np.concatenate(
            [far * run[is_first] + items["arc_start_mm"][before], far * run + items["arc_end_mm"][moves]]
        )
        order = np.argsort(at, kind="stable")
        at = at[order]
        joints = np.vstack([self._starts[before], items["joints"][moves]])[order]
        reached = np.concatenate([clock[before] - self._job.times[before], clock[moves]])[order]
        mine = np.searchsorted(runs, rows["item"][follows], side="right") * far
        ends, starts = mine + rows["arc_end_mm"][follows], mine + rows["arc_start_mm"][follows]
        rows["time_s"][follows] = np.interp(ends, at, reached) - np.interp(starts, at, reached)
        for column in range(joints.shape[1]):
            rows["joints"][follows, column] = np.interp(ends, at, joints[:, column])
        if self._control.tells_rotary:
            rows["joints"][follows] = turned_to(self._job.chain, rows["axis_end"][follows], rows["joints"][follows])

    def _said(self, begin: int, end: int) -> _Said:
        """What the tape says within a pass, by arc length."""
        items = self._items
        found: _Said = {}
        for item in self._said_items[slice(*np.searchsorted(self._said_items, (begin, end)))].tolist():
            is_command = items["command"][item] >= 0
            arc = self._next_arc(item, end) if is_command else float(items["arc_start_mm"][item])
            entries = self._entries.get(item, [])
            if entries or is_command:
                found.setdefault(arc, []).append((item, meaning(self._text(item)) if is_command else None, entries))
        return found

    def _next_arc(self, item: int, end: int) -> float:
        after = np.flatnonzero(self._items["command"][item:end] < 0)
        if after.size:
            return float(self._items["arc_start_mm"][item + int(after[0])])
        return float(self._items["arc_end_mm"][self._items["command"][:end] < 0][-1])

    def _flush(self, said: _Said, arc: float) -> None:
        for at in [at for at in said if at <= arc]:
            for item, command, entries in said.pop(at):
                self._schedule(item, entries)
                if command is not None:
                    self._say(item, command)

    def _schedule(self, item: int, entries: list[Entry]) -> None:
        """Gate, mode and those levels that are not what they are."""
        for entry in entries:
            if entry.channel == Channel.EMISSION:
                self._say(item, Command(Say.GATE, entry.value))
            elif entry.channel == Channel.MODE:
                self._say(item, Command(Say.MODE, entry.value))
                self._levels.clear()
            elif self._levels.get(entry.channel, 0.0) != entry.value:
                self._say(item, Command(Say.LEVEL, entry.value, channel=entry.channel))
                self._levels[entry.channel] = entry.value

    def _tape_command(self, item: int) -> None:
        if item in self._job.tape.dwells:
            if self._job.dwells.get(item, 0.0) > 0.0:
                self._say(item, Command(Say.DWELL, self._job.dwells[item]))
            return
        command = meaning(self._text(item))
        if command is not None:
            self._say(item, command)

    def _text(self, item: int) -> str:
        return self._job.tape.commands[int(self._items["command"][item])]

    def _say(self, item: int, command: Command) -> None:
        row = self._row(item)
        row["what"], row["command"] = What.COMMAND, len(self._commands)
        if self._items["command"][item] < 0:  # said before the move: the machine stands where it began
            row["joints"] = self._starts[item]
            row["time_s"] = 0.0
            row["tip"], row["axis"] = row["tip_end"], row["axis_end"] = self._begin[0][item], self._begin[1][item]
            row["arc_end_mm"] = row["arc_start_mm"]
        self._was_dark = self._was_dark or (command.say == Say.GATE and command.value == 0.0)
        self._commands.append(command)
        self._add(row)

    def _row(self, item: int) -> NDArray[np.void]:
        source, row = self._items[item], np.zeros(1, BLOCK_DTYPE)
        for name in ("kind", "layer", "operation", "pass_", "tool", "arc_start_mm", "arc_end_mm", "joints"):
            row[name] = source[name]
        row["command"], row["item"] = -1, item
        row["time_s"] = self._job.times[item]
        row["tip"], row["axis"] = row["tip_end"], row["axis_end"] = self._end[0][item], self._end[1][item]
        return row

    def _poses(self, joints: Floats) -> tuple[Floats, Floats]:
        """Tips, workpiece, and axes (n, 3) at joints (n, 5), each with the tool of its item."""
        job, tools = self._job, self._items["tool"]
        tips, axes = np.zeros((len(joints), 3)), np.zeros((len(joints), 3))
        lengths = {tool.number: np.array(tool.tip_mm) for tool in job.cell.tools}
        for number in np.unique(tools).tolist():
            rows = np.flatnonzero(tools == number)
            tips[rows], axes[rows] = job.chain.forward(joints[rows], lengths.get(number, np.zeros(3)))
        return tips - (job.placed[:3, 3] - job.frame.shift), axes


def _edges(first: float, last: float, cuts: list[float]) -> Floats:
    """Arc lengths at which a pass is cut, both ends included; none nearer to the one before, or to the end, than the shortest stretch."""
    found = [first]
    for arc in sorted(cuts):
        if found[-1] + _SHORTEST_MM < arc < last - _SHORTEST_MM:
            found.append(arc)
    return np.array([*found, last])
