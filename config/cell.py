"""Facts about one cell: machine, wires, tools, placement, safety. The only place where `mode = "sim"` or `"real"` is said."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from config.base import ConfigError, Facts, Finite, NotNegative, Positive, Vector3, find_facts, read_facts
from config.by_hand import ByHand
from config.device import load_device
from config.machine import MachineGeometry, ProofLimits
from config.macros import DialectName, Macros, check_real_time
from config.reactions import Reaction, complete

Letter = Literal["X", "Y", "Z", "A", "B", "C"]


class Axis(Facts):
    """One driven axis: travel and limits in mm or degrees."""

    letter: Letter
    kind: Literal["linear", "rotary"]
    min: Finite = Field(description="mm or deg, machine coordinates")
    max: Finite = Field(description="mm or deg, machine coordinates")
    max_velocity: Positive = Field(description="mm/s or deg/s")
    max_acceleration: Positive = Field(description="mm/s2 or deg/s2")
    max_jerk: Positive | None = Field(None, description="mm/s3 or deg/s3; none: what reaches the greatest acceleration in 50 ms")
    home: Finite = Field(0.0, description="machine coordinate after homing")

    @model_validator(mode="after")
    def _ordered(self) -> Axis:
        if self.min >= self.max:
            raise ValueError(f"axis {self.letter}: min {self.min} must be below max {self.max}")
        return self

    @property
    def jerk(self) -> float:
        """mm/s3 or deg/s3."""
        return 20.0 * self.max_acceleration if self.max_jerk is None else self.max_jerk


class Joint(Facts):
    """One joint of the chain: what it carries turns or moves by the joint's value along `direction` (right-hand rule).

    A table that follows ISO 841 (A', C') turns against the sense of the letter: direction = [-1, 0, 0].
    """

    axis: Letter
    direction: Vector3 = Field(description="unit vector, machine frame at all joints zero")
    point_mm: Vector3 = Field((0.0, 0.0, 0.0), description="a point on a rotary axis (the pivot), machine frame at all joints zero")

    @model_validator(mode="after")
    def _unit(self) -> Joint:
        length = sum(value * value for value in self.direction) ** 0.5
        if abs(length - 1.0) > 1e-9:
            raise ValueError(f"joint {self.axis}: direction must have length 1 (has {length:.6g})")
        return self


class Kinematics(Facts):
    """Two chains from the machine's base: to the table (which carries the part) and to the head (which carries the tool).

    world_from_table = product of the table joints in order; world_from_head = product of the head joints in order.
    With all joints at zero the head's gauge point is at the machine's origin, the tool axis is +z (from tip into head).
    """

    table: tuple[Joint, ...] = ()
    head: tuple[Joint, ...] = ()


class Nozzle(Facts):
    """Shape of a coaxial deposition head, from the focus upwards: air, the nozzle's cone, the cylinder of the head's body.

    The body's diameter is the tool's `holder_diameter_mm`. Usual coaxial heads stand off 7 to 16 mm.
    """

    standoff_mm: Positive = Field(13.0, description="from the focus (the tip) to the nozzle's end")
    end_diameter_mm: Positive = Field(12.0, description="of the nozzle's end")
    cone_length_mm: Positive = Field(60.0, description="from the nozzle's end to the body")
    body_length_mm: Positive = Field(120.0, description="of the body above the cone")


class Tool(Facts):
    """A deposition head or a cutter, as mounted."""

    number: int = Field(ge=1, le=99)
    name: str
    kind: Literal["deposition", "end_mill", "ball_mill", "bull_nose"]
    tip_mm: Vector3 = Field(description="tip (focus point of the head) from the gauge point, machine frame at all joints zero; z is negative")
    diameter_mm: Positive = Field(description="cutter diameter, or laser spot")
    corner_radius_mm: NotNegative = 0.0
    flute_length_mm: NotNegative = 0.0
    holder_diameter_mm: Positive = Field(40.0, description="of a cutter's holder, or of the deposition head's body")
    shank_diameter_mm: Positive | None = Field(None, description="of a cutter above its flutes; none: the cutter's diameter")
    stickout_mm: Positive | None = Field(None, description="of a cutter out of its holder; none: its flutes and one diameter more")
    nozzle: Nozzle = Nozzle()
    teeth: int = Field(2, ge=1)
    max_rpm: Positive = 18000.0

    @property
    def stickout(self) -> float:
        """mm from a cutter's tip to its holder; at most its whole gauge length."""
        wanted = self.flute_length_mm + self.diameter_mm if self.stickout_mm is None else self.stickout_mm
        return min(wanted, -self.tip_mm[2]) if self.tip_mm[2] < 0.0 else wanted


class Cnc(Facts):
    """The CNC and its serial line."""

    firmware: Literal["grblhal", "grbl"]
    port: str = Field(
        description="device path, best /dev/serial/by-id/..., or a pattern of one, or usb:VID:PID[:SERIAL]: these stay when the device is "
        "plugged in again under another name; a relative path is taken from the run directory"
    )
    baud: int = Field(115200, ge=1200, le=4_000_000)
    line_length_max: int = Field(256, ge=40, description="characters, without newline")
    rx_margin_bytes: int = Field(4, ge=0, description="of the receive buffer that are never filled: some firmwares count a byte or two too many")
    answer_timeout_s: Positive = Field(5.0, description="for ok or error, beyond the time of the moves ahead of it")
    tool_change_s: float = Field(120.0, ge=0.0, le=3600.0, description="longest tool change of a control that reports no state Tool meanwhile")
    spindle_s: float = Field(5.0, ge=0.0, le=120.0, description="longest run-up or run-down of a spindle whose speed the control does not report")
    status_period_s: Positive = Field(0.1, ge=0.05, description="status query period")
    laser_gate_output: int | None = Field(None, ge=0, le=15, description="digital output (M62/M63 P) that gates the laser; none: gate by Modbus")
    power_output: int | None = Field(None, ge=0, le=15, description="analogue output (M67 E) of the laser's power in the stream; none: by Modbus")
    max_blocks_per_s: Positive = Field(400.0, description="what the control takes in, of straight five-axis blocks")
    junction_deviation_mm: Positive = Field(0.01, description="how far a corner may be cut (mm, or deg where rotary axes turn); grblHAL's $11")
    arc_tolerance_mm: Positive = Field(0.002, description="how far the straight pieces that the control cuts an arc into leave it; grblHAL's $12")
    takes_arcs: bool = Field(True, description="G2 and G3 in the XY plane")
    takes_comments: bool = Field(True, description="text in parentheses; it goes over the wire like any other")
    takes_nurbs: bool | None = Field(None, description="NURBS under the five-axis transformation; none: as manuals have it: Siemens yes, Fanuc no")


class Link(Facts):
    """How a Modbus device is reached."""

    device: str = Field(description="register map: path or shipped name")
    transport: Literal["tcp", "rtu"]
    host: str = "127.0.0.1"
    tcp_port: int = Field(502, ge=0, le=65535, description="0 in a cell to be simulated: any free port")
    serial_port: str = Field("", description="RTU line; devices with the same serial_port share one line")
    baud: int = Field(115200, ge=1200, le=4_000_000)
    parity: Literal["N", "E", "O"] = "N"
    device_id: int = Field(1, ge=1, le=247)

    @model_validator(mode="after")
    def _line(self) -> Link:
        if self.transport == "rtu" and not self.serial_port:
            raise ValueError("transport rtu needs serial_port")
        return self


class Placement(Facts):
    """Where the workpiece is, measured at the machine: part frame in the table frame, and the controller's work offset (G54)."""

    part_origin_mm: Vector3 = Field((0.0, 0.0, 0.0), description="origin of the build frame, table frame (machine frame at joints zero)")
    rotation_deg: Finite = Field(0.0, description="of the build frame about the table's z")
    work_offset: dict[str, float] = Field(default_factory=dict, description="G54 per axis letter, mm or deg, machine coordinates")
    pivots_mm: dict[str, Vector3] = Field(default_factory=dict, description="measured point on a rotary axis, replaces the nominal one of the chain")


class Plate(Facts):
    """The plate that is clamped to the table and that parts grow from."""

    size_mm: tuple[Positive, Positive, Positive] = Field((120.0, 120.0, 10.0), description="x, y and thickness")
    top_mm: Vector3 = Field((0.0, 0.0, 0.0), description="centre of its top, table frame")


class Volume(Facts):
    """Box in which metal may be, in the table frame (mm)."""

    min_mm: Vector3
    max_mm: Vector3


class Limits(Facts):
    """Safety figures of the cell."""

    tick_s: Positive = Field(0.01, description="period of the safety tick")
    moving_mm_s: Positive = Field(0.5, description="tip speed below which the laser has to be off")
    status_stale_s: Positive = Field(0.5, description="CNC status older than this is unsafe")
    powder_settle_tolerance: Positive = Field(0.05, description="relative; flow is steady within this of its set-point")
    powder_settle_timeout_s: Positive = 15.0
    purge_s: NotNegative = Field(2.0, description="gas only, before milling")
    emission_off_w: NotNegative = Field(5.0, description="read-back below which there is no emission")
    hopper_low_fraction: NotNegative = Field(0.05, lt=1.0)
    retract_mm: Positive = Field(20.0, description="by which a reaction with retract takes the head back along the tool axis")


class Response(Facts):
    """How soon machine and process devices follow, measured at the cell: predicted times and set-points that follow the speed rest on it."""

    tool_change_s: NotNegative = 4.0
    spindle_rpm_per_s: Positive = Field(9000.0, description="by which the spindle speeds up")
    head_slide_s: NotNegative = Field(1.0, description="to deploy or to park the deposition head")
    laser_write_s: Positive = Field(0.02, description="least time between two writes of the laser's power over its link")
    powder_delay_s: NotNegative = Field(1.2, description="from a new powder rate to its first change at the nozzle")
    powder_settle_s: Positive = Field(0.6, description="time constant of the powder flow behind the delay")
    gas_settle_s: Positive = Field(0.15, description="time constant of the gas flows")


class Service(Facts):
    """Where the service listens (loopback by default), and how much it keeps."""

    host: str = "127.0.0.1"
    port: int = Field(8000, ge=0, le=65535)
    stop_port: int = Field(8001, ge=0, le=65535, description="the cell process's own listener for STOP")
    samples_kept: int = Field(
        2_000_000, ge=10_000, description="samples of runs kept whole, newest first; as many older ones thinned to each tenth; events for ever"
    )


class Rates(Facts):
    """What the cell costs, for estimates; what is not stated is not guessed, and no cost is shown."""

    currency: str = Field(min_length=1, max_length=8, description="in which all rates are, e.g. EUR; that of the powder's price too")
    machine_per_h: NotNegative | None = Field(None, description="currency per hour that the cell works on a part: machine, room, attendance")
    gas_per_m3: NotNegative | None = Field(None, description="currency per cubic metre of gas at 1 bar")


class Simulation(Facts):
    """Read by `sim` only."""

    seed: int = 1
    hopper_g: Positive = 2000.0
    powder_transport_s: NotNegative = Field(1.2, description="delay from feeder to nozzle")
    powder_settle_s: Positive = Field(0.6, description="time constant of the flow")
    laser_ramp_s: NotNegative = Field(0.002, description="time constant of the laser")
    real_pivots_mm: dict[str, Vector3] = Field(
        default_factory=dict, description="where the simulated machine's rotary axes really are, per letter, whatever the placement says"
    )
    real_plate_top_mm: Vector3 | None = Field(None, description="where the simulated plate's top really is; none: as `plate` says")
    real_tips_mm: dict[int, Vector3] = Field(default_factory=dict, description="where a simulated tool's tip really is, per number")
    rx_bytes: int = Field(1024, ge=64)
    planner_blocks: int = Field(100, ge=4)


class Cell(Facts):
    """One machine with everything on it."""

    schema_version: Literal[1]
    name: str
    mode: Literal["sim", "real"]
    cnc: Cnc
    axes: tuple[Axis, ...]
    kinematics: Kinematics
    build_volume: Volume
    tools: tuple[Tool, ...]
    links: dict[Literal["laser", "feeder", "io"], Link]
    materials: tuple[str, ...] | None = Field(None, description="powders that it may be fed, by name; none: every one that laser and feeder manage")
    placement: Placement = Placement()
    plate: Plate = Plate()
    limits: Limits = Limits()
    reactions: dict[str, Reaction] = Field(default_factory=lambda: complete({}), description="per cause; what is not given is the safe default")
    response: Response = Response()
    service: Service = Service()
    by_hand: ByHand = ByHand()
    simulation: Simulation = Simulation()
    rates: Rates | None = Field(None, description="none: estimates show no cost")
    machine: MachineGeometry | None = Field(None, description="none: no collisions are looked for")
    proof: ProofLimits = ProofLimits()
    macros: dict[DialectName, Macros] = Field(default_factory=dict, description="lines per dialect at the fixed places of a program")
    chord_tolerance_mm: Positive = Field(0.01, description="linearisation, tip")
    axis_tolerance_deg: Positive = Field(0.05, description="linearisation, tool axis")
    rapid_clearance_mm: Positive = Field(5.0, description="above the highest metal, along the tool axis")

    @property
    def sha256(self) -> str:
        """Hash (hex) of what a Program depends on; the machine's STL files by what is in them, wherever they are.

        Not: the wires, the powders that it may be fed, the service's address, the simulation, the reactions, the rates, and the limits that
        only the proof judges by.
        """
        left_out: dict[str, Any] = {
            "mode": True, "cnc": {"port", "baud", "tool_change_s", "spindle_s"},
            "links": True, "materials": True, "service": True, "by_hand": True, "simulation": True, "proof": True,
            "reactions": True, "rates": True, "limits": {"retract_mm"},
            "machine": {"solids": {"__all__": {"file"}}},
        }  # fmt: skip
        return self._with_files(self.model_dump_json(exclude=left_out))

    @property
    def twin_sha256(self) -> str:
        """Hash (hex) of what a Proof depends on: the simulation, the plate, the machine's shape, tools, the verdict's limits; STL files as above."""
        paths = {"machine": {"solids": {"__all__": {"file"}}}}
        return self._with_files(self.model_dump_json(include={"simulation", "plate", "machine", "proof", "tools"}, exclude=paths))

    def _with_files(self, text: str) -> str:
        digest = hashlib.sha256(text.encode())
        for solid in self.machine.solids if self.machine else ():
            if solid.file:
                digest.update(Path(solid.file).read_bytes())
        return digest.hexdigest()

    @property
    def letters(self) -> tuple[str, ...]:
        """Axis letters in the controller's order."""
        return tuple(axis.letter for axis in self.axes)

    def axis(self, letter: str) -> Axis:
        """Axis by letter. Raises KeyError."""
        return next(axis for axis in self.axes if axis.letter == letter) if letter in self.letters else _no_axis(letter)

    @field_validator("reactions", mode="before")
    @classmethod
    def _every_cause_has_one(cls, given: Any) -> Any:
        return complete(given) if isinstance(given, dict) else given

    @field_validator("macros")
    @classmethod
    def _nothing_acts_on_the_way(cls, macros: dict[DialectName, Macros]) -> dict[DialectName, Macros]:
        check_real_time(macros)
        return macros

    @model_validator(mode="after")
    def _consistent(self) -> Cell:
        if len(set(self.letters)) != len(self.letters):
            raise ValueError("axes: a letter stands twice")
        joints = [joint.axis for joint in (*self.kinematics.table, *self.kinematics.head)]
        if sorted(joints) != sorted(self.letters):
            raise ValueError(f"kinematics: joints {joints} and axes {list(self.letters)} must be the same letters")
        if len({tool.number for tool in self.tools}) != len(self.tools):
            raise ValueError("tools: a number stands twice")
        if not any(tool.kind == "deposition" for tool in self.tools):
            raise ValueError("tools: no deposition head")
        missing = {"laser", "feeder", "io"} - set(self.links)
        if missing:
            raise ValueError(f"links: {', '.join(sorted(missing))} missing")
        unknown = (set(self.placement.work_offset) | set(self.placement.pivots_mm)) - set(self.letters)
        if unknown:
            raise ValueError(f"placement: no axis {', '.join(sorted(unknown))}")
        return self


def _no_axis(letter: str) -> Axis:
    raise KeyError(f"no axis {letter}")


def _check_diverter(cell: Cell, path: Path) -> None:
    """Raise ConfigError where a reaction diverts powder and the feeder's map has no diverter."""
    diverting = [name for name, reaction in cell.reactions.items() if reaction.powder == "divert"]
    if diverting and "diverter" not in load_device(cell.links["feeder"].device).registers:
        device = cell.links["feeder"].device
        line = f"{path}: reactions.{diverting[0]}.powder: {device} has no register diverter"
        raise ConfigError(line, 'say powder = "off", or add the coil to its map')


def load_cell(name: str | Path) -> Cell:
    """Cell by path or shipped name. Raises ConfigError."""
    path = find_facts("cells", str(name))
    cell = read_facts(Cell, path)
    _check_diverter(cell, path)
    if cell.machine is None:
        return cell
    machine = cell.machine.beside(path.parent)
    absent = next((solid for solid in machine.solids if solid.shape == "stl" and not Path(solid.file).is_file()), None)
    if absent is not None:
        raise ConfigError(f"{path}: machine.solids {absent.name}: no file {absent.file}", "name an STL beside the cell's file or by its whole path")
    return cell.model_copy(update={"machine": machine})
