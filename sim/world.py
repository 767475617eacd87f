"""The whole simulated cell: CNC, laser, feeder, I/O and their wiring, moved on by `step`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from config import Cell, Device
from sim.cnc import lookahead as la
from sim.cnc.chain import Chain
from sim.cnc.firmware import Firmware
from sim.cnc.plug import Plug
from sim.faults import Fault, Faults
from sim.modbus.registers import RegisterBank
from sim.modbus.wire import Wire
from sim.plant.feeder import Feeder
from sim.plant.io import InputsOutputs
from sim.plant.laser import Laser
from sim.plant.signals import Signals
from sim.trace import Trace

Floats = NDArray[np.float64]

LINE_FAULT_STEP_S = 0.005  # how finely time is cut while a fault waits for a line


class Metal(Protocol):
    """What grows and is cut: gets every trace."""

    def apply(self, trace: Trace) -> None:
        """Add and remove metal along the pieces of motion."""


class World:
    """One cell in software. Times in s, lengths in mm, angles in deg; process time runs `time_scale` times as fast as wire time.

    cell, devices : facts; devices by role (laser, feeder, io)
    metal : gets each step's trace, if given
    dead_man : whether devices watch their heartbeats (on wire time); without a host on the wires, say no
    faults : scripted faults
    """

    def __init__(
        self, cell: Cell, devices: Mapping[Any, Device], *, metal: Metal | None = None, time_scale: float = 1.0,
        dead_man: bool = True, faults: Sequence[Fault | str] = (),
    ) -> None:  # fmt: skip
        simulation, gate = cell.simulation, cell.cnc.laser_gate_output
        self.cell = cell
        self.time_scale = time_scale
        self.metal = metal
        self.time_s = self.wire_time_s = 0.0
        self.chain = Chain(cell)
        self.cnc = Firmware(cell)
        self.laser = Laser(devices["laser"], simulation.laser_ramp_s, gate is not None)
        self.feeder = Feeder(
            devices["feeder"], simulation.hopper_g, simulation.powder_transport_s, simulation.powder_settle_s
        )
        self.io = InputsOutputs(devices["io"])
        self._gate_bit = 0 if gate is None else 1 << gate
        plants: dict[str, Signals] = {"laser": self.laser, "feeder": self.feeder, "io": self.io}
        for plant in plants.values():
            plant.watches_heartbeat = dead_man
        self.banks = {role: RegisterBank(devices[role], plant) for role, plant in plants.items()}
        self.plants = plants
        self.wires = {role: Wire() for role in plants}
        self.plug = Plug()
        self.faults = Faults({role: bank.names for role, bank in self.banks.items()})
        for fault in faults:
            self.faults.add(fault)
        self.trace = self._trace_of(np.zeros((0, la.PIECE_COLUMNS)), np.zeros(0), np.zeros(0))

    # -- time ------------------------------------------------------------------------------------------------------

    def step(self, dt_s: float) -> None:
        """Let dt_s of process time go by. `trace` then tells the motion of this step (of its last part if a fault cut it)."""
        left = dt_s
        self.faults.strike(self)
        while left > 0.0:
            part = min(left, self.faults.until_next(self.time_s))
            if self.faults.waits_for_line:
                part = min(part, LINE_FAULT_STEP_S)
            self._step_part(part)
            left -= part
            if self.faults.pending:
                self.faults.strike(self)

    def _step_part(self, dt_s: float) -> None:
        wire_dt_s = dt_s / self.time_scale
        self.io.step(dt_s, wire_dt_s)
        self.cnc.step(dt_s, wire_dt_s)
        pieces = self.cnc.machine.motion.pieces
        dt = pieces[:, la.DURATION].copy()
        powder = self.feeder.step(dt, wire_dt_s)
        emission = self.laser.step(self._gates(pieces), dt, wire_dt_s)
        self.time_s += dt_s
        self.wire_time_s += wire_dt_s
        self.trace = self._trace_of(pieces, emission, powder)
        if self.metal is not None:
            self.metal.apply(self.trace)

    def _gates(self, pieces: Floats) -> Floats:
        """(k,) 1 where the wired gate is open; a cell without one has it open always."""
        if not self._gate_bit:
            return np.ones(len(pieces))
        return np.asarray((pieces[:, la.PIECE_OUTPUTS].astype(np.int64) & self._gate_bit) != 0, dtype=np.float64)

    def _trace_of(self, pieces: Floats, emission: Floats, powder: Floats) -> Trace:
        machine = self.cnc.machine
        n, k, tool = machine.motion.n, len(pieces), machine.tool
        joints = np.concatenate((pieces[:, la.FROM : la.FROM + n], pieces[:, la.TO : la.TO + n])) + machine.slip
        tips, axes = self.chain.tip_and_axis_in_table(joints, tool)
        return Trace(
            tip0=tips[:k],
            tip1=tips[k:],
            axis0=axes[:k],
            axis1=axes[k:],
            down=self.chain.down_in_table(joints[k:]),
            emission_w=emission,
            powder_g_min=powder,
            dt=pieces[:, la.DURATION].copy(),
            line=pieces[:, la.PIECE_LINE].astype(np.int64),
            joints0=joints[:k],
            joints1=joints[k:],
            tool=tool,
            spindle_rpm=machine.spindle_rpm,
            head_deployed=self.io.is_deployed,
        )

    # -- what one sees ---------------------------------------------------------------------------------------------

    @property
    def joints(self) -> Floats:
        """(n,) real joint positions, mm or deg, order of the cell's axes."""
        return self.cnc.machine.joints

    @property
    def tip_position(self) -> Floats:
        """(3,) mm, tip in the table frame."""
        return np.asarray(self.chain.tip_in_table(self.joints[None, :], self.cnc.machine.tool)[0])

    @property
    def tip_speed_mm_s(self) -> float:
        """Speed of the tip over the table, from the last piece of the last step."""
        if not len(self.trace) or not self.trace.dt[-1]:
            return 0.0
        return float(np.linalg.norm(self.trace.tip1[-1] - self.trace.tip0[-1]) / self.trace.dt[-1])

    @property
    def laser_emission_w(self) -> float:
        """Light on the part now, W."""
        return self.laser.emission_w

    # -- hands -----------------------------------------------------------------------------------------------------

    def wire_interlocks(self) -> None:
        """Carry the contacts' levels to everything that hangs on them by wire."""
        io = self.io
        io.show()
        self.laser.set_interlocks(io.estop_ok, io.door_closed, io.chiller_ok)
        self.feeder.gas_pressure_ok = io.gas_pressure_ok

    def open_door(self) -> None:
        """Open the door: light off at once, the CNC brakes."""
        self.io.door_closed = False
        self.wire_interlocks()
        self.cnc.machine.door(True)

    def close_door(self) -> None:
        """Close the door; nothing starts by that."""
        self.io.door_closed = True
        self.wire_interlocks()
        self.cnc.machine.door(False)

    def press_estop(self) -> None:
        """Press the E-stop: light off, drives and spindle without power, feeder stopped."""
        self.io.estop_ok = False
        self.wire_interlocks()
        self.feeder.outputs_safe()
        self.cnc.estop(True)

    def release_estop(self) -> None:
        """Release the E-stop; everything stays off."""
        self.io.estop_ok = True
        self.wire_interlocks()
        self.cnc.estop(False)
