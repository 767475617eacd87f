"""What is done so that nothing is hit: leaning round an obstacle, the part turned, another tool, one clear line where nothing helps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from config.cell import Cell, Tool, load_cell
from config.material import load_material
from planner.collide.clearance import Clearance
from planner.errors import ReachError
from planner.kinematics.chain import Chain, Floats
from planner.kinematics.inverse import angle_about
from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.plan import Operation, Pass, Process
from planner.post.leaned import lean_rate_deg_mm
from planner.post.linearise import linearise
from planner.post.pass_curve import PassCurve
from planner.post.pole_pass import led_round, rotary_load
from planner.post.poses import PoseSolver
from planner.post.reaching import Reached, reach_operation
from planner.post.room import table_from_build
from planner.post.sequence import Counts, Sequencer
from planner.post.tape import Tape
from tests.unit.planner.hand_plan import UP, bead, link, plan_of

Distance = Callable[[Tool, Floats, Floats, Floats], Floats]
CONTACT_MM = 0.1


@dataclass
class FieldGuard:
    """Obstacles as a distance of tips, axes (build frame) and joints: no cell's bodies, so that every clearance is known."""

    chain: Chain
    placed: Floats
    distance: Distance
    is_watching: bool = True
    contact_mm: float = CONTACT_MM

    def clearance(
        self,
        tool: Tool,
        joints: Floats,
        *,
        cuts: bool,
        limit_mm: float = np.inf,
        joined: object = None,
        passes: object = None,
    ) -> Clearance:
        follows = np.zeros(len(joints)) if joined is None else np.asarray(joined, dtype=np.float64)
        before = np.vstack([joints[:1], joints[:-1]])
        gap, places = np.full(len(joints), limit_mm), np.zeros((len(joints), 3))
        for share in np.linspace(0.0, 1.0, 31) if follows.any() else (1.0,):
            rows = joints + (share - 1.0) * follows[:, None] * (joints - before)
            tips, axes = self.chain.forward(rows, np.array(tool.tip_mm))
            inverse = np.linalg.inv(self.placed)
            tips, axes = tips @ inverse[:3, :3].T + inverse[:3, 3], axes @ inverse[:3, :3].T
            here = self.distance(tool, tips, axes, rows)
            places[here < gap] = tips[here < gap]
            gap = np.minimum(gap, here)
        return Clearance(gap, np.where(gap < limit_mm, 0, -1), places, (("nozzle", "clamp 1"),))

    def hits(self, found: Clearance) -> np.ndarray:
        return np.asarray(found.mm < -self.contact_mm)


class Bench:
    """What `reach_operation` needs of a sequencer, with the obstacles given."""

    def __init__(self, distance: Distance, cell: Cell | None = None) -> None:
        self.cell = cell or load_cell("trunnion_tcp")
        self.chain = Chain.from_cell(self.cell)
        self.placed = table_from_build(self.cell.placement.part_origin_mm, 0.0)
        self.guard = FieldGuard(self.chain, self.placed, distance)
        self.plan = plan_of([])
        self.counts = Counts()
        self.deposition = load_material(self.plan.material).deposition
        self.tape = Tape(np.array([axis.home for axis in self.cell.axes]))
        self.posted: dict[int, Operation] = {}

    def solver(self, tool: Tool) -> PoseSolver:
        return PoseSolver(self.chain, self.cell, np.array(tool.tip_mm))

    def curves(self, operation: Operation) -> list[PassCurve]:
        return [
            PassCurve(item, self.placed, f"pass {index} of operation 0 ({operation.process}), layer {operation.layer}")
            for index, item in enumerate(operation.passes)
        ]

    def reach(self, operation: Operation) -> Reached:
        sequencer: Sequencer = self  # type: ignore[assignment]
        return reach_operation(operation, self.curves(operation), sequencer)


def straight(process: Process = Process.DEPOSIT_FILL, **fields: float) -> Operation:
    """Down, 60 mm along x, up."""
    low, high = (-30.0, 0.0, 0.0), (30.0, 0.0, 0.0)
    item = bead(Curve.from_polyline(np.array([low, high])))
    if not process.is_deposit:
        item = Pass(item.tip, UP, np.array([[0.0, 5.0, 0.0, 0.0, 0.0]]))
    up = 6.0
    passes = (link((-30.0, 0.0, up), low), item, link(high, (30.0, 0.0, up)))
    return Operation(process, 0, passes, **fields)  # type: ignore[arg-type]


def post_beside(y_mm: float = 12.0, radius_mm: float = 3.0, height_mm: float = 40.0) -> Distance:
    """A pin of a height up in the way of a nozzle: the axis of the tool, 40 mm over the tip, keeps 12 mm from it along x = 0."""

    def gap(tool: Tool, tips: Floats, axes: Floats, joints: Floats) -> Floats:
        head = tips + height_mm * axes
        return np.asarray(np.hypot(head[:, 0], head[:, 1] - y_mm) - radius_mm - 12.0)

    return gap


def test_what_hits_nothing_is_run_as_planned() -> None:
    bench = Bench(lambda tool, tips, axes, joints: np.full(len(tips), 5.0))
    operation = straight()
    reached = bench.reach(operation)
    assert [curve.source for curve in reached.curves] == list(operation.passes) and not bench.counts.changes


def test_the_nozzle_leans_round_an_obstacle_smoothly_and_comes_back() -> None:
    bench = Bench(post_beside())
    operation = straight()
    reached = bench.reach(operation)
    tool, moves = reached.tool, reached.moves
    assert bench.guard.clearance(tool, moves.poses.joints, cuts=True).mm.min() >= -CONTACT_MM
    leaned = reached.curves[1]
    arcs = np.linspace(0.0, leaned.length_mm, 400)
    axes = leaned.axes(leaned.at_arc_length(arcs))
    lean = np.rad2deg(np.arccos(np.clip(axes[:, 2], -1.0, 1.0)))
    assert 2.0 < lean.max() <= 15.0 + 1e-6, "within the material's cone"
    first, last = reached.curves[0], reached.curves[2]
    ends = np.vstack([first.axes(np.array([0.0])), last.axes(np.array([1.0]))])
    assert np.abs(ends - UP).max() < 1e-9, "the links bring the head there and back"
    assert np.abs(np.diff(lean) / np.diff(arcs)).max() <= lean_rate_deg_mm(leaned) + 0.5 <= 7.0
    planned = bench.curves(operation)[1]
    assert np.abs(leaned.tips(leaned.at_arc_length(arcs)) - planned.tips(planned.at_arc_length(arcs))).max() < 1e-9
    assert len(bench.counts.changes) == 1 and "leaned by up to" in bench.counts.changes[0] and "clamp 1" in bench.counts.changes[0]


def test_what_no_lean_in_the_cone_clears_is_refused_with_what_where_and_what_would_help() -> None:
    bench = Bench(lambda tool, tips, axes, joints: np.where(np.abs(tips[:, 0]) < 8.0, -2.3, 9.0))
    line = r"nozzle meets clamp 1 by 2\.3 mm at x .* y .* z .* mm of the part, pass 1 of operation 0 \(deposit_fill\), layer 0"
    with pytest.raises(ReachError, match=line) as told:
        bench.reach(straight())
    assert "turn_deg" in told.value.hint


def test_flanks_are_never_tilted() -> None:
    bench = Bench(post_beside())
    with pytest.raises(ReachError, match="nozzle meets clamp 1"):
        bench.reach(straight(Process.MILL_SIDE, cutter_diameter_mm=8.0, spindle_rpm=3000.0))


def test_a_longer_cutter_of_the_table_is_taken_where_the_first_one_hits() -> None:
    cell = load_cell("trunnion_tcp")
    short = next(tool for tool in cell.tools if tool.number == 2)
    longer = short.model_copy(update={"number": 7, "stickout_mm": 55.0, "tip_mm": (0.0, 0.0, -155.0)})
    bench = Bench(lambda tool, tips, axes, joints: np.full(len(tips), tool.stickout - 50.0), cell.model_copy(update={"tools": (*cell.tools, longer)}))
    reached = bench.reach(straight(Process.MILL_SIDE, cutter_diameter_mm=8.0, spindle_rpm=3000.0))
    assert reached.tool.number == 7 and "tool 7 instead of 2" in bench.counts.changes[0]


def test_the_part_is_turned_about_an_upright_tool_before_anything_is_tilted() -> None:
    def gap(tool: Tool, tips: Floats, axes: Floats, joints: Floats) -> Floats:
        return np.asarray(np.where(np.abs((joints[:, 4] + 180.0) % 360.0 - 180.0) < 30.0, -3.0, 5.0))

    bench, operation = Bench(gap), straight()
    reached = bench.reach(operation)
    assert abs(reached.moves.poses.joints[0, 4]) == 90.0
    assert [curve.source for curve in reached.curves] == list(operation.passes)


def test_a_ball_cutter_leans_about_its_centre() -> None:
    cell = load_cell("trunnion_tcp")
    ball = next(tool for tool in cell.tools if tool.number == 2).model_copy(update={"number": 7, "kind": "ball_mill", "diameter_mm": 6.0})
    bench = Bench(post_beside(), cell.model_copy(update={"tools": (*cell.tools, ball)}))
    operation = straight(Process.MILL_SIDE, cutter_diameter_mm=6.0, spindle_rpm=3000.0)
    reached = bench.reach(operation)
    old, new = bench.curves(operation)[1], reached.curves[1]
    share = np.linspace(0.0, 1.0, 300)
    centre = new.tips(new.at_arc_length(share * new.length_mm)) + 3.0 * new.axes(new.at_arc_length(share * new.length_mm))
    assert np.abs(centre[:, 1:] - (old.tips(np.array([0.0])) + 3.0 * UP)[0, 1:]).max() < 2e-3
    assert bench.guard.clearance(reached.tool, reached.moves.poses.joints, cuts=True).mm.min() >= -CONTACT_MM


def across_the_dome(off_mm: float, radius_mm: float = 20.0) -> Pass:
    """A bead over a hemisphere along x, beside its pole by off_mm, the head square to the surface."""
    turn = np.linspace(-0.8, 0.8, 60)
    ring = np.sqrt(radius_mm**2 - off_mm**2)
    tip = interpolate(np.column_stack([ring * np.sin(turn), np.full(60, off_mm), ring * np.cos(turn)]), closed=False)
    return Pass(tip, Curve(tip.degree, tip.knots, tip.control_points / radius_mm), bead(tip).setpoints)


@pytest.mark.parametrize(
    ("name", "off_mm"), [("trunnion_tcp", 0.0), ("trunnion_tcp", 0.05), ("head_head", 1.0), ("head_table", 0.2)]
)
def test_a_bead_over_a_dome_crosses_the_pole_with_no_joint_faster_than_it_can_go(name: str, off_mm: float) -> None:
    cell = load_cell(name)
    bench = Bench(lambda tool, tips, axes, joints: np.full(len(tips), 5.0), cell)
    operation = Operation(Process.DEPOSIT_CONTOUR, 0, (across_the_dome(off_mm),))
    tool = cell.tools[0]
    solver = bench.solver(tool)
    curves = bench.curves(operation)
    planned = rotary_load(curves, linearise(curves, solver, bench.tape.joints, cell.chord_tolerance_mm, cell.axis_tolerance_deg), solver)
    reached = bench.reach(operation)
    led = rotary_load(reached.curves, reached.moves, solver)
    assert led.max() <= 1.0
    if off_mm > 0.0:
        assert planned.max() > 3.0, "as planned the spin would turn by half a turn in no time"
        assert "led round the pole" in bench.counts.changes[0]
    at = np.linspace(*curves[0].source.tip.domain, 300)
    between = np.einsum("ij,ij->i", curves[0].axes(at), reached.curves[0].axes(at))
    assert np.rad2deg(np.arccos(np.clip(between, -1.0, 1.0))).max() <= 15.0


def test_a_cone_of_nothing_leads_round_no_pole_and_slowing_down_is_left() -> None:
    cell = load_cell("trunnion_tcp")
    bench = Bench(lambda tool, tips, axes, joints: np.full(len(tips), 5.0), cell)
    operation = Operation(Process.MILL_SIDE, 0, (across_the_dome(0.2),), cutter_diameter_mm=8.0, spindle_rpm=3000.0)
    reached = bench.reach(operation)
    assert reached.curves[0].source is operation.passes[0]


def test_a_spiral_that_winds_beyond_the_travel_in_one_pass_is_refused_in_one_line() -> None:
    cell = load_cell("head_head")
    turn = np.linspace(0.0, 2.0 * np.pi * 4.0, 500)
    tip = Curve.from_polyline(np.column_stack([15.0 * np.cos(turn), 15.0 * np.sin(turn), 0.1 * turn]))
    lean = np.deg2rad(20.0)
    vectors = np.column_stack([np.sin(lean) * np.cos(turn), np.sin(lean) * np.sin(turn), np.full(500, np.cos(lean))])
    spiral = Pass(tip, Curve(1, tip.knots, vectors), bead(tip).setpoints)
    bench = Bench(lambda tool, tips, axes, joints: np.full(len(tips), 5.0), cell)
    with pytest.raises(ReachError, match=r"axis C would wind by 14\d\d\.\d deg, its travel holds 800 deg, pass 0 of operation 0"):
        bench.reach(Operation(Process.DEPOSIT_CONTOUR, 0, (spiral,)))


def test_rings_with_rapid_links_between_unwind_beside_the_links_only() -> None:
    cell = load_cell("head_head")
    turn = np.linspace(0.0, 2.0 * np.pi, 90)
    lean = np.deg2rad(20.0)
    passes: list[Pass] = []
    for ring in range(4):
        z = 0.5 * ring
        tip = Curve.from_polyline(np.column_stack([15.0 * np.cos(turn), 15.0 * np.sin(turn), np.full(90, z)]))
        vectors = np.column_stack([np.sin(lean) * np.cos(turn), np.sin(lean) * np.sin(turn), np.full(90, np.cos(lean))])
        axis = vectors[0]
        start = tip.control_points[0]
        passes += [link(start + 10.0 * axis, start, axis=axis), Pass(tip, Curve(1, tip.knots, vectors), bead(tip).setpoints)]
        passes.append(link(start, start + 10.0 * axis, axis=axis))
    bench = Bench(lambda tool, tips, axes, joints: np.full(len(tips), 5.0), cell)
    operation = Operation(Process.DEPOSIT_CONTOUR, 0, tuple(passes))
    moves = bench.reach(operation).moves
    spin = moves.poses.joints[:, 4]
    assert spin.min() >= -400.0 and spin.max() <= 400.0
    leaps = np.flatnonzero(np.abs(np.diff(spin)) > 180.0) + 1
    assert leaps.size, "four turns of one sense do not fit without unwinding"
    is_rapid = np.array([item.rapid for item in operation.passes])
    numbers = moves.rows.pass_
    assert all(is_rapid[numbers[row]] or is_rapid[numbers[row - 1]] for row in leaps) and moves.poses.needs_positioning[leaps].all()


def test_a_turned_and_moved_part_is_leaned_in_the_same_way() -> None:
    bench = Bench(post_beside())
    first = bench.reach(straight()).curves[1]
    turned = Bench(post_beside())
    turned.placed = table_from_build((20.0, -10.0, -400.0), 30.0)
    turned.guard = replace(turned.guard, placed=turned.placed)
    second = turned.reach(straight()).curves[1]
    axes = [curve.source.axis.evaluate([0.5]) for curve in (first, second) if isinstance(curve.source.axis, Curve)]
    lean = [float(angle_about(np.array([1.0, 0.0, 0.0]), UP[None, :], axis)[0]) for axis in axes]
    assert len(lean) == 2 and np.sign(lean[0]) == np.sign(lean[1]) != 0.0
    assert led_round([first], np.zeros(1), bench.solver(bench.cell.tools[0]), bench.placed, bench.cell.tools[0], 15.0) == [first]
