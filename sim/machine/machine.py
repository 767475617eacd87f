"""The machine under watch: every step's motion in, what met what out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from config import Cell, ConfigError
from sim.cnc.chain import Chain
from sim.machine.against_solids import pair_distance
from sim.machine.against_stock import GROUP, group_mask
from sim.machine.bodies import Body, pack
from sim.machine.links import Links, links_of, multiply, place
from sim.machine.reach import pair_reach
from sim.machine.solids import bodies_of
from sim.machine.watch import HIT_COLUMNS, STOCK, Odometers, Rules, Stand, follow
from sim.process.field import BLOCK
from sim.process.stock import Stock
from sim.trace import Trace

Array = NDArray[np.float64]

CLEARANCE_CAP_MM = 2.0  # gaps above this are not looked at closely (or above the cell's own limit, where that is more)
NEW_METAL_MM = 5.0  # from the spot, beyond which a bead does not reach
HITS_MAX = 4096  # of one step
MEASURE_NEW = -1.0  # odometer reading that has passed already


class Hit(NamedTuple):
    """Two things that are in each other. piece : index in the trace; depth_mm : the least way that parts them (the stock's: see
    `sim.machine.against_stock`); at_mm : (3,) build frame; tool : number in the spindle."""

    line: int
    piece: int
    moving: str
    other: str
    depth_mm: float
    at_mm: Array
    tool: int


class Approach(NamedTuple):
    """Where things that must not touch came nearest. at_mm : (3,) build frame."""

    line: int
    moving: str
    other: str
    gap_mm: float
    at_mm: Array
    tool: int


class Machine:
    """All solids of a cell; `check` gets every step's trace in order of time.

    build_from_table : (4, 4) float   Places are told in the build frame, as the stock is.
    A cell without `machine` has no solids: nothing is checked, and `is_drawn` is False.
    Raises ConfigError: an STL, a carrier or a name in `machine.ignore` that is no good.
    """

    def __init__(self, cell: Cell, chain: Chain, build_from_table: Array) -> None:
        self.is_drawn = cell.machine is not None
        self.links, self.carriers = links_of(cell)
        self.solids = bodies_of(cell, self.carriers)
        self.bodies = pack(self.solids)
        self._chain = chain
        self._kinds = {tool.number: tool.kind for tool in cell.tools}
        self._build_from_table = np.asarray(build_from_table, dtype=np.float64)
        self._rules = _rules(cell, self.solids, self.links)
        self.ignored: tuple[tuple[str, str], ...] = cell.machine.ignore if cell.machine else ()
        self.touching = self._touching(len(cell.letters))
        """Pairs of names that overlap in the pose as drawn (all joints zero, head in or out) and are not in `machine.ignore`."""
        count, links = len(self.solids), len(self.links.column)
        still = np.tile(np.eye(3, 4), (links, 1, 1))
        nearest = np.zeros(HIT_COLUMNS)
        nearest[3] = max(CLEARANCE_CAP_MM, 2.0 * cell.proof.clearance_mm)
        self._state = Odometers(
            still, still.copy(), np.zeros(len(self._rules.pair)), np.zeros(count), np.full(len(self._rules.pair), MEASURE_NEW),
            np.full(count, MEASURE_NEW), np.zeros(count, dtype=np.int64), np.zeros((HITS_MAX, HIT_COLUMNS)), np.zeros(1, dtype=np.int64), nearest,
        )  # fmt: skip
        self._tool = MEASURE_NEW
        self._slide = MEASURE_NEW
        self._joints = np.zeros(len(cell.letters))
        self._directory: NDArray[np.int32] | None = None
        self._mask = np.zeros((0, 0, 0), dtype=np.uint8)
        self._fresh_metal = np.zeros((0, 3))
        self.nearest: Approach | None = None
        """Where the least clearance was; None while all gaps are above the cap."""

    @property
    def clearance_mm(self) -> float:
        """Least gap so far between things that must not touch, mm; capped (at least 2 mm, and twice the cell's limit)."""
        return float(self._state.nearest[3])

    @property
    def mounted(self) -> int:
        """Number of the tool in the spindle at the last check, -1 before the first."""
        return int(self._tool)

    @property
    def slide(self) -> float:
        """Of the deposition head at the end of the last check, 0 parked to 1 deployed; -1 before the first."""
        return self._slide

    def check(self, trace: Trace, stock: Stock, slide: float) -> list[Hit]:
        """Watch one step against the stock as it stands: after beads were laid, before cuts.

        slide : of the deposition head at its end, 0 parked to 1 deployed

        One Hit for each pair and line, the deepest; in order of the pieces. Nothing that moves more than 0.5 mm through another is missed.
        """
        if not self.solids:
            return []
        if self._slide < 0.0:
            self._slide = slide
        joints, line, tip, room, dt = self._pieces(trace)
        if len(trace):
            self._joints = trace.joints1[-1].copy()
        is_same = trace.tool == self._tool and slide == self._slide and self._directory is stock.field.blocks.directory
        if is_same and not (joints[0::2] != joints[1::2]).any() and not room.any():
            return []
        self._mount(trace.tool)
        stand = self._stand(stock, tip[room > 0.0])
        passed = np.concatenate(([0.0], np.cumsum(dt)))
        slides = self._slide + (slide - self._slide) * (passed / passed[-1] if passed[-1] > 0.0 else np.linspace(0.0, 1.0, len(passed)))
        self._slide = slide
        state = self._state
        state.found[0] = 0
        before = state.nearest.copy()
        follow(self.links, self.bodies, self._rules, state, stand, joints, slides, line, tip, room)
        if (state.nearest != before).any():
            hit = self._hit(state.nearest, line, trace.tool)
            self.nearest = Approach(hit.line, hit.moving, hit.other, hit.depth_mm, hit.at_mm, hit.tool)
        return sorted((self._hit(row, line, trace.tool) for row in state.hits[: state.found[0]]), key=lambda hit: hit.piece)

    def snapshot(self) -> dict[str, NDArray[np.generic]]:
        """The state, for `restore`."""
        kept: dict[str, NDArray[np.generic]] = {name: getattr(self._state, name).copy() for name in _KEPT}
        kept["place"] = np.concatenate(([self._tool, self._slide], self._joints))
        near = self.nearest
        kept["near"] = np.array([near.line, near.tool, *near.at_mm]) if near else np.zeros(0)
        return kept

    def restore(self, kept: dict[str, NDArray[np.generic]]) -> None:
        """Go back to a snapshot; the stock has to be put back by whoever owns it."""
        for name in _KEPT:
            getattr(self._state, name)[...] = kept[name]
        place_of = np.asarray(kept["place"], dtype=np.float64)
        self._tool, self._slide, self._joints = float(place_of[0]), float(place_of[1]), place_of[2:].copy()
        self._directory = None
        self._fresh_metal = np.zeros((0, 3))
        near = np.asarray(kept["near"], dtype=np.float64)
        self.nearest = None
        if len(near):
            names = self._names(self._state.nearest)
            self.nearest = Approach(int(near[0]), *names, self.clearance_mm, near[2:].copy(), int(near[1]))

    # -- within ----------------------------------------------------------------------------------------------------

    def _pieces(self, trace: Trace) -> tuple[Array, NDArray[np.int64], Array, Array, Array]:
        """Joints (2 k, n), begin and end of each piece in turn; line (k,), tip (k, 3), room for new metal (k,), time (k,). At least one piece."""
        if not len(trace):
            still = np.vstack((self._joints, self._joints))
            return still, np.zeros(1, dtype=np.int64), np.zeros((1, 3)), np.zeros(1), np.zeros(1)
        joints = np.empty((2 * len(trace), trace.joints0.shape[1]))
        joints[0::2], joints[1::2] = trace.joints0, trace.joints1
        room = np.zeros(len(trace))
        if self._kinds.get(trace.tool) == "deposition":
            length = np.sqrt(((trace.tip1 - trace.tip0) ** 2).sum(axis=1))
            room = np.where(trace.emission_w > 0.0, NEW_METAL_MM + length, 0.0)
        return joints, trace.line, np.ascontiguousarray(trace.tip0), room, trace.dt

    def _mount(self, tool: int) -> None:
        """Solids of one tool in the spindle; what is new there is measured at once."""
        if tool == self._tool:
            return
        self._tool = tool
        active = np.array([body.tool in (0, tool) for body in self.solids], dtype=np.int64)
        fresh = (active == 1) & (self._state.active == 0)
        self._state.active[:] = active
        self._state.pair_due[fresh[self._rules.pair].any(axis=1)] = MEASURE_NEW
        self._state.pair_due[~(active == 1)[self._rules.pair].all(axis=1)] = np.inf
        self._state.stock_due[fresh] = MEASURE_NEW

    def _stand(self, stock: Stock, lit: Array) -> Stand:
        """The stock for the kernels; groups of blocks are looked through again where metal may have come. lit : (m, 3) mm, table frame"""
        blocks = stock.field.blocks
        shape = blocks.directory.shape
        frame = np.ascontiguousarray(self._build_from_table[:3])
        low, high = np.zeros(3, dtype=np.int64), np.array([-(-n // GROUP) for n in shape], dtype=np.int64)
        if self._directory is not blocks.directory:
            self._directory = blocks.directory
            self._mask = np.zeros(tuple(high), dtype=np.uint8)
            group_mask(blocks, self._mask, low, high)
        spots = np.vstack((self._fresh_metal, lit))
        if len(spots):
            places = spots @ frame[:, :3].T + frame[:, 3]
            size = GROUP * BLOCK * stock.cell_mm
            low = np.floor((places.min(axis=0) - 2.0 * NEW_METAL_MM - blocks.origin) / size).astype(np.int64)
            high = np.ceil((places.max(axis=0) + 2.0 * NEW_METAL_MM - blocks.origin) / size).astype(np.int64) + 1
            group_mask(blocks, self._mask, low, high)
        self._fresh_metal = lit
        return Stand(blocks, self._mask, frame)

    def _names(self, row: Array) -> tuple[str, str]:
        """What moved and what it met: the head's side first."""
        a, b = int(row[0]), int(row[1])
        if b == STOCK:
            return self.solids[a].name, "stock"
        last_of_head = int(self.links.slide[0])
        if not 0 < self.solids[a].carrier <= last_of_head:
            a, b = (b, a) if self.solids[b].carrier > 0 else (a, b)
        return self.solids[a].name, self.solids[b].name

    def _hit(self, row: Array, line: NDArray[np.int64], tool: int) -> Hit:
        frame = self._build_from_table
        moving, other = self._names(row)
        piece = int(row[2])
        return Hit(int(line[piece]), piece, moving, other, float(row[3]), frame[:3, :3] @ row[4:] + frame[:3, 3], tool)

    def _touching(self, letters: int) -> tuple[tuple[str, str], ...]:
        """Pairs that overlap as drawn."""
        found = []
        world = np.zeros((len(self.links.column), 3, 4))
        poses = np.zeros((len(self.solids), 3, 4))
        at = np.empty(3)
        for slide in (0.0, 1.0):
            place(self.links, np.zeros(letters), slide, world, np.zeros_like(world))
            for n, body in enumerate(self.solids):
                multiply(world[body.carrier], body.pose, poses[n])
            for (a, b), allowed in zip(self._rules.pair.tolist(), self._rules.allowed, strict=True):
                names = (self.solids[a].name, self.solids[b].name)
                if names not in found and pair_distance(self.bodies, a, b, poses[a], poses[b], 0.0, at) < -allowed:
                    found.append(names)
        return tuple(found)


_KEPT = ("world", "table", "of_pair", "in_table", "pair_due", "stock_due", "active", "nearest")


def _rules(cell: Cell, solids: list[Body], links: Links) -> Rules:
    """Which solids are watched against which: all on different carriers but the pairs that the cell's file lets touch."""
    machine = cell.machine
    ignore = {frozenset(pair) for pair in machine.ignore} if machine else set()
    unknown = sorted({name for pair in ignore for name in pair} - {solid.name for solid in solids})
    if unknown:
        raise ConfigError(f"cell {cell.name}: machine.ignore: no solid {unknown[0]}", "solids: " + ", ".join(dict.fromkeys(s.name for s in solids)))
    contact, cut = (machine.contact_mm, machine.plate_cut_mm) if machine else (0.0, 0.0)
    pairs, allowed, counts = [], [], []
    for a, one in enumerate(solids):
        for b in range(a + 1, len(solids)):
            other = solids[b]
            apart = one.tool and other.tool and one.tool != other.tool
            if one.carrier == other.carrier or apart or frozenset((one.name, other.name)) in ignore:
                continue
            is_cut = (one.cuts and other.name == "plate") or (other.cuts and one.name == "plate")
            pairs.append((a, b))
            allowed.append(max(cut, contact) if is_cut else contact)
            counts.append(int(not is_cut))
    rows = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    meets = [int(not solid.cuts and solid.carrier != links.table[0]) for solid in solids]
    return Rules(
        rows, np.array(allowed, dtype=np.float64), np.array(counts, dtype=np.int64), np.array(meets, dtype=np.int64),
        np.ascontiguousarray(pair_reach(cell, links, solids, rows).T), np.array([contact]), np.array([_lever_mm(cell, solids)]),
    )  # fmt: skip


def _lever_mm(cell: Cell, solids: list[Body]) -> float:
    """Bound on how far any solid gets from any rotary axis, mm: its own place, the pivots, and all linear travels."""
    reach = max((float(np.linalg.norm(centre)) + radius for centre, radius in (solid.sphere() for solid in solids)), default=0.0)
    points = [cell.placement.pivots_mm.get(joint.axis, joint.point_mm) for joint in (*cell.kinematics.table, *cell.kinematics.head)]
    pivots = max((float(np.linalg.norm(point)) for point in points), default=0.0)
    travels = [max(abs(axis.min), abs(axis.max)) for axis in cell.axes if axis.kind == "linear"]
    return reach + pivots + float(np.linalg.norm(travels)) + float(np.linalg.norm(cell.machine.parked_offset_mm if cell.machine else (0.0,)))
