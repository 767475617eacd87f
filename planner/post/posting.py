"""From a Plan to a Program: the stages, one call each."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from config import ConfigError
from config.cell import Cell, Placement
from config.material import load_material
from planner.collide.guard import Least
from planner.errors import PostError
from planner.files.plan_file import plan_sha256
from planner.kinematics.chain import Chain, Floats
from planner.plan import Plan
from planner.post.assemble import Assembly, Setting, assemble
from planner.post.dialect import JOINT_DIALECTS, check_dialect, joint_dialect
from planner.post.economy import Economy, all_passes, economy
from planner.post.header import About
from planner.post.reread import RereadReport, check, verify
from planner.post.room import check_room, table_from_build
from planner.post.sequence import Counts, Sequencer
from planner.post.slowing import SpeedReport, speed_report
from planner.post.tcp import read_back, write_tcp
from planner.post.tools import tool_for
from planner.process import block_allowance_mm
from planner.program import ProcessWindow, Program
from planner.recipe import parse_recipe


@dataclass(frozen=True)
class PostReport:
    """What posting did: the text read back against the Plan, and where it had to depart from the Plan's feeds.

    economy : blocks, arcs, bytes per mm and errors by construction per kind of operation, links last
    least : what came nearest to what, up to 2 mm; None: the cell file draws no bodies, nothing was looked for
    """

    reread: RereadReport
    counts: Counts
    speed: SpeedReport
    least: tuple[Least, ...] | None = None
    economy: tuple[Economy, ...] = ()

    @property
    def findings(self) -> tuple[str, ...]:
        """One line each."""
        told = [
            f"tip within {self.reread.max_tip_mm:.4f} mm, axis within {self.reread.max_axis_deg:.4f} deg of the plan"
        ]
        if self.economy:
            told.append(str(all_passes(self.economy)))
        told += self.speed.lines
        if self.counts.positionings:
            told.append(f"{self.counts.positionings} times lifted and positioned where no link of the plan leads")
        if self.least is None:
            told.append("the cell file draws no machine: nobody looked for collisions")
        elif self.least:
            told.append(f"least clearance: {self.least[0].why}")
        return (*told, *self.counts.changes)


def post_with_report(
    plan: Plan, cell: Cell, placement: Placement | None = None, dialect: str = "grblhal"
) -> tuple[Program, PostReport]:
    """The Program of a Plan, and what there is to say about it. Same plan, cell and placement give the same Program.

    placement : where the workpiece is (default: as the cell file says)
    Raises PostError (TravelLimitError, ReachError): no such tool, the part does not fit, an axis would leave its travel,
    no pose gives an axis, or the text read back differs from the Plan.
    """
    check_dialect(dialect)
    if not any(operation.passes for operation in plan.operations):
        raise PostError(f"the plan of {plan.part_name} has no passes: there is nothing to run", "plan the part again")
    placement, given = placement or cell.placement, cell
    language = joint_dialect(dialect) if dialect in JOINT_DIALECTS else None
    cell = language.fitted(cell) if language else _without_arcs(cell)
    chain = Chain.from_cell(cell, placement)
    placed = table_from_build(placement.part_origin_mm, placement.rotation_deg)
    planned = [tool_for(item, cell) for item in plan.operations if item.passes]
    check_room(plan, cell, chain, placed, list({tool.number: tool for tool in planned}.values()))
    sequencer = Sequencer(plan, cell, chain, placed, _carrier_gas_l_min(plan))
    used = sorted({int(number) for number in sequencer.run().items()["tool"]} - {0})
    tools = [tool for tool in cell.tools if tool.number in used]
    remarks = language.remarks(cell) if language else []
    about = About(plan, plan_sha256(plan), cell, placement, dialect, tools, remarks)
    posted = sequencer.posted
    if language:
        made = assemble(sequencer.tape, Setting(cell, chain, placed, _work_offset(about), about, posted, language))
    else:
        made = write_tcp(dialect, sequencer, placement, about)
    program = replace(_program(made, about, placed), cell_sha256=given.sha256)
    reread = check(program, plan, cell, chain, posted) if language else read_back(program, posted, cell, chain)
    verify(reread, cell)
    least = sequencer.guard.least if sequencer.guard.is_watching else None
    speed, spent = speed_report(sequencer, program), economy(program, posted, sequencer.counts.built)
    return program, PostReport(reread, sequencer.counts, speed, least, spent)


def _without_arcs(cell: Cell) -> Cell:
    """The cell for dialects whose blocks are in the workpiece's coordinates: arcs of the joints have no place there."""
    return cell.model_copy(update={"cnc": cell.cnc.model_copy(update={"takes_arcs": False})})


def _work_offset(about: About) -> Floats:
    return np.array([about.placement.work_offset.get(letter, 0.0) for letter in about.cell.letters])


def _program(made: Assembly, about: About, placed: Floats) -> Program:
    plan, cell = about.plan, about.cell
    return Program(
        part_name=plan.part_name,
        cell_name=cell.name,
        dialect=about.dialect,
        plan_sha256=about.plan_sha256,
        mesh_sha256=plan.mesh_sha256,
        cell_sha256=cell.sha256,
        tolerance_mm=plan.tolerance_mm,
        process=plan.process,
        material=plan.material,
        lines=made.lines,
        table=made.table,
        schedule=made.schedule,
        layer_starts=made.layer_starts,
        axis_letters=cell.letters,
        machine_from_build=placed,
        build_from_part=np.asarray(plan.build_from_part, dtype=np.float64),
        work_offset=_work_offset(about),
        gate="modbus" if cell.cnc.laser_gate_output is None else "stream",
        tools=tuple(tool.number for tool in about.tools),
        duration_s=made.duration_s,
        stock_allowance_mm=block_allowance_mm(parse_recipe(plan.recipe_toml)) if plan.process == "mill" else None,
        window=_window(plan),
    )


def _window(plan: Plan) -> ProcessWindow | None:
    """What the plan's material allows, as it is posted with; None where nothing is deposited. Raises PostError."""
    if not any(operation.process.is_deposit for operation in plan.operations):
        return None
    try:
        material = load_material(plan.material)
    except ConfigError as error:
        raise PostError(f"window of {plan.material}: {error.message}", error.hint) from None
    laser, powder = material.deposition.laser_w, material.deposition.powder_g_min
    return ProcessWindow(material.sha256, (laser.min, laser.max), (powder.min, powder.max))


def _carrier_gas_l_min(plan: Plan) -> float:
    """Carrier gas of the plan's material; 0 where nothing is deposited. Raises PostError if the material cannot be read."""
    if not any(operation.process.is_deposit for operation in plan.operations):
        return 0.0
    try:
        return load_material(plan.material).deposition.carrier_gas_l_min.usual
    except ConfigError as error:
        raise PostError(f"carrier gas of {plan.material}: {error.message}", error.hint) from None
