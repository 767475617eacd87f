"""Jobs that cannot be done, each for one reason: what is asked, and the words by which that reason has to be known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from config.cell import Cell, load_cell
from planner.nurbs.curve import Curve
from planner.plan import Operation, Pass, Plan, Process
from planner.post import post
from tests.unit.planner.hand_plan import bead, circle, cone_axis, cone_operation, contour_operation, link, plan_of


@dataclass(frozen=True)
class Case:
    """name : what is asked   run : asks it   reason : regular expression that the message has to match   hint : the same of the advice"""

    name: str
    run: Callable[[], object]
    reason: str
    hint: str


def _cell(**changes: object) -> Cell:
    return load_cell("trunnion_tcp").model_copy(update=changes)


def _placed(**changes: object) -> Cell:
    cell = load_cell("trunnion_tcp")
    return cell.model_copy(update={"placement": cell.placement.model_copy(update=changes)})


def _axis(letter: str, **changes: object) -> Cell:
    cell = load_cell("trunnion_tcp")
    axes = tuple(axis.model_copy(update=changes) if axis.letter == letter else axis for axis in cell.axes)
    return cell.model_copy(update={"axes": axes})


def _milled(points: list[tuple[float, float, float]], axis: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Plan:
    """One straight cut of the 8 mm cutter, from its first point to its last."""
    unit = np.array(axis) / np.linalg.norm(axis)
    tip = Curve.from_polyline(np.array(points))
    cut = Pass(tip, unit, np.array([[0.0, 10.0, 0.0, 0.0, 0.0]]))
    start = np.array(points[0])
    way = link(start + 30.0 * unit, start, axis=unit)
    operation = Operation(Process.MILL_SIDE, 0, (way, cut), cutter_diameter_mm=8.0, spindle_rpm=3000.0)
    return plan_of([operation])


def _bead_leaning(lean_deg: float) -> Plan:
    """A bead beside the middle of the plate, the head leaning over it."""
    lean = np.deg2rad(lean_deg)
    axis = np.array([np.sin(lean), 0.0, np.cos(lean)])
    made = replace(bead(Curve.from_polyline(np.array([[20.0, -10.0, 0.0], [20.0, 10.0, 0.0]]))), axis=axis)
    return plan_of([Operation(Process.DEPOSIT_CONTOUR, 0, (made,), bead_width_mm=2.0)])


def _round_and_round(turns: int) -> Plan:
    """One pass several times round a cone, the axis leaning all the way."""
    once = circle(24.0, 0.0)
    u = np.linspace(*once.domain, 60, endpoint=False)
    points = np.vstack([np.tile(once.evaluate(u), (turns, 1)), once.evaluate([once.domain[0]])])
    points[:, 2] = np.linspace(0.0, 3.0, len(points))
    tip = Curve.from_polyline(points)
    axis = np.column_stack([0.4 * points[:, :2] / 24.0, np.ones(len(points))])
    unit = Curve(1, tip.knots, axis / np.linalg.norm(axis, axis=1)[:, None])
    cut = Pass(tip, unit, np.array([[0.0, 5.0, 0.0, 0.0, 0.0]]))
    return plan_of([Operation(Process.MILL_SIDE, 0, (cut,), cutter_diameter_mm=8.0, spindle_rpm=3000.0)])


def _parallel() -> Cell:
    cell = load_cell("trunnion_tcp")
    table = tuple(joint.model_copy(update={"direction": (0.0, 0.0, -1.0)}) for joint in cell.kinematics.table)
    return cell.model_copy(update={"kinematics": cell.kinematics.model_copy(update={"table": table})})


def _slow_pass() -> Plan:
    operation = contour_operation(0)
    passes = tuple(
        replace(item, setpoints=item.setpoints * np.array([1.0, 0.0, 1.0, 1.0, 1.0])) if not item.is_link else item
        for item in operation.passes
    )
    return plan_of([replace(operation, passes=passes)])


def _down() -> Plan:
    tip = circle(24.0, 0.0)
    operation = cone_operation(0)
    passes = tuple(replace(item, axis=cone_axis(tip, 130.0)) for item in operation.passes if not item.is_link)
    return plan_of([replace(operation, passes=passes)])


CASES = (
    Case(
        "a part larger than the machine",
        lambda: post(plan_of([contour_operation(0)], half_mm=200.0), _cell()),
        r"200\.0 mm too large",
        "units",
    ),
    Case(
        "a part placed outside the build volume",
        lambda: post(plan_of([contour_operation(0)]), _placed(part_origin_mm=(90.0, 0.0, -420.0))),
        r"leaves the build volume by 10\.0 mm in X",
        r"-10\.0 mm in X",
    ),
    Case(
        "a cutter that the cell has not",
        lambda: post(plan_of([cone_operation(0, diameter=5.0)]), _cell()),
        "of 5 mm in cell",
        "cutter_diameter_mm",
    ),
    Case(
        "a cutter turned faster than it may",
        lambda: post(plan_of([replace(cone_operation(0), spindle_rpm=30000.0)]), _cell()),
        "30000 1/min asked, tool 2 allows 18000",
        "cutting speed",
    ),
    Case("a cut from below the plate", lambda: post(_down(), _cell()), r"axis A|meets|bring the tool axis", ".+"),
    Case(
        "a cutter through a clamp",
        lambda: post(_milled([(56.0, -30.0, 2.0), (56.0, 30.0, 2.0)]), _cell()),
        r"T2 \w+ meets clamp \d by \d",
        ".+",
    ),
    Case(
        "a holder through the plate",
        lambda: post(_milled([(40.0, -10.0, 2.0), (40.0, 10.0, 2.0)], (0.95, 0.0, 0.1)), _cell()),
        r"T2 \w+ meets \w+",
        ".+",
    ),
    Case(
        "a head that lies on the plate",
        lambda: post(_bead_leaning(80.0), _cell()),
        r"(nozzle|head body) meets (plate|clamp)",
        ".+",
    ),
    Case(
        "more turns in one pass than the table has",
        lambda: post(_round_and_round(4), _axis("C", min=-400.0, max=400.0)),
        "C",
        ".+",
    ),
    Case(
        "rotary axes that are parallel",
        lambda: post(plan_of([contour_operation(0)]), _parallel()),
        "rotary joints A and C are parallel",
        "directions",
    ),
    Case("a pass with a feed of nothing", lambda: post(_slow_pass(), _cell()), "feed of 0 mm/s does not move", ".+"),
    Case(
        "a language that no post writes",
        lambda: post(plan_of([contour_operation(0)]), _cell(), dialect="klartext"),
        "no dialect 'klartext'",
        "grblhal",
    ),
    Case(
        "lines longer than the control reads",
        lambda: post(plan_of([cone_operation(0)]), _cell(cnc=_cell().cnc.model_copy(update={"line_length_max": 40}))),
        "characters",
        "line_length_max",
    ),
    Case("a plan without passes", lambda: post(plan_of([]), _cell()), "nothing to run", "plan the part again"),
)
