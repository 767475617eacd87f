"""The guarded changes of the cell: safe, deposit, mill, powder steady, gas; each step commanded and read back (invariant 7)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from cellctl.cell.cnc_checks import STATUS_TIMEOUT_S, CncChecks
from cellctl.cell.transaction import Step
from config.cell import Cell
from drivers.cell_wires import CellDrivers
from drivers.interfaces import Clock
from drivers.modbus.device import DeviceClient

SAFE, DEPOSIT, MILL = 0, 1, 2
HEAD_TIMEOUT_S = 10.0  # a slide takes a second or two
LASER_TIMEOUT_S = 2.0
FLOW_STEADY_S = 0.1  # a read-back within its band so long is no passing value
DIVERTER_S = 0.25  # a diverter switches within 0.2 s
GAS_TIMEOUT_S = 5.0
GAS_TOLERANCE = 0.15  # relative; gas only has to flow
NO_POWDER_G_MIN = 0.2  # a feeder's read-back at rest
NO_GAS_L_MIN = 0.3  # a flow meter at rest


class Laserproof(Protocol):
    """The only hand on the laser's permit and power."""

    power_wanted_w: float

    def lock(self, because: str) -> None:
        """Permit and power off, now."""


class Modes:
    """Builds the steps of each guarded change for one cell."""

    def __init__(self, cell: Cell, drivers: CellDrivers, clock: Clock, hand: Laserproof) -> None:
        self._cell = cell
        self._d = drivers
        self._clock = clock
        self._hand = hand
        self._is_dusty = False  # powder has flowed since the last purge
        self._cnc = CncChecks(cell, drivers, clock)

    def steps(self, mode: int, tool: int | None, offset: dict[str, float]) -> list[Step]:
        """Steps of MODE 0, 1 or 2. tool : what has to be in the spindle (None: not checked); offset : G54 of the Program."""
        if mode == DEPOSIT:
            return self.deposit(tool, offset)
        return self.dark("milling" if mode == MILL else "the end")

    def deposit(self, tool: int | None, offset: dict[str, float]) -> list[Step]:
        """Spindle stands, tool and datum checked, no cutter in the way, head deployed, laser enabled with the permit still off."""
        io, laser = self._d.io, self._d.laser
        ready = lambda: laser.is_enabled and not laser.faults and not laser.interlocks and laser.age_s < LASER_TIMEOUT_S  # noqa: E731
        return [
            self._cnc.spindle_stands(),
            self._cnc.tool(tool) if tool is not None else self._cnc.no_cutter(),
            self._cnc.datum(offset),
            Step(
                "deploying the deposition head",
                lambda: io.head_deployed and not io.head_parked,
                HEAD_TIMEOUT_S,
                act=self._once(lambda: self._hand.lock("the head is moving"), io.deploy_head),
                age_s=lambda: io.age_s,
                detail=self._slide,
                remedy="look at the head's slide and its end switches, then reset",
                undo=(self.park(),),
                moves=True,
            ),
            Step(
                "enabling the laser",
                ready,
                LASER_TIMEOUT_S,
                act=lambda: laser.enable(True),
                age_s=lambda: laser.age_s,
                detail=lambda: "; ".join([*laser.faults, *laser.interlocks]) or "not ready",
                remedy="look at the laser's panel, then reset",
                undo=(self.laser_off("the way back"),),
            ),
        ]

    def cutting(self, tool: int | None, offset: dict[str, float], rpm: float) -> list[Step]:
        """Before the first cut behind a tool change, and before one that was held goes on: laser dark, head out of the way, tool, datum,
        and the spindle at its speed (rpm; 0: it is to stand, and nothing is asked of it)."""
        io = self._d.io
        parked = Step(
            "checking that the deposition head is parked",
            lambda: io.head_parked and not io.head_deployed,
            STATUS_TIMEOUT_S,
            age_s=lambda: io.age_s,
            code="head_position",
            detail=self._slide,
        )
        return [
            self.laser_off("the cut"),
            parked,
            *([self._cnc.tool(tool)] if tool is not None else []),
            self._cnc.datum(offset),
            *([self._cnc.spindle_turns(rpm)] if rpm > 0.0 else []),
        ]

    def dark(self, purpose: str) -> list[Step]:
        """Laser locked out and read back, powder shut and purged, head parked and confirmed."""
        feeder, limits = self._d.feeder, self._cell.limits
        self._is_dusty |= feeder.rate_setpoint_g_min > 0 or not feeder.rate_readback_g_min <= NO_POWDER_G_MIN
        steps = [self.laser_off(purpose), self.powder_off()]
        if self._is_dusty and limits.purge_s > 0:
            until = [0.0]
            steps.append(
                Step(
                    f"purging the powder line for {limits.purge_s:g} s",
                    lambda: self._clock.now() >= until[0],
                    limits.purge_s + 1.0,
                    act=lambda: until.__setitem__(0, self._clock.now() + limits.purge_s),
                    undo=(self.gas_off(),),
                )
            )
        gas = self._once(self._purged, lambda: feeder.set_carrier_gas(0.0), lambda: feeder.set_shield_gas(0.0))
        return [*steps, self.park(then=gas)]

    def back(self) -> list[Step]:
        """What every way back begins with: a dark laser, and no powder."""
        return [self.laser_off("the way back"), self.powder_off()]

    def stand_down(self, mode: int, *, is_standing: bool) -> list[Step]:
        """What undoes a mode that an earlier sequence had set up. is_standing : whether the CNC waits, or is held, and can stop its spindle"""
        if mode == DEPOSIT:
            return [self.gas_off(), self.park()]
        return [self._cnc.spindle_off()] if mode == MILL and is_standing else []

    # -- single changes to the safe side -------------------------------------------------------------------------------

    def laser_off(self, purpose: str) -> Step:
        """Permit, enable and power off, each as the laser itself tells it."""
        laser, limits = self._d.laser, self._cell.limits

        def is_off() -> bool:
            is_dark = not laser.is_emitting and laser.power_readback_w < limits.emission_off_w
            return is_dark and not laser.is_enabled and not laser.is_permitted and self._is_told(laser.client)

        return Step(
            f"switching the laser off for {purpose}",
            is_off,
            LASER_TIMEOUT_S,
            act=self._once(lambda: self._hand.lock(f"laser locked out for {purpose}"), lambda: laser.enable(False)),
            age_s=lambda: laser.age_s,
            code="laser_emitting",
            detail=lambda: f"{laser.power_readback_w:.0f} W read back",
        )

    def powder_off(self) -> Step:
        """No powder at the feeder, by its read-back."""
        feeder = self._d.feeder
        return Step(
            "waiting for powder to stop",
            lambda: feeder.rate_readback_g_min <= NO_POWDER_G_MIN,
            self._cell.limits.powder_settle_timeout_s,
            act=lambda: feeder.set_rate(0.0),
            age_s=lambda: feeder.age_s,
            detail=lambda: f"{feeder.rate_readback_g_min:.1f} g/min read back",
            remedy="look at the feeder, then reset",
        )

    def gas_off(self) -> Step:
        """Carrier and shield gas shut, by their read-backs."""
        feeder = self._d.feeder
        return Step(
            "shutting the gas",
            lambda: max(feeder.carrier_gas_readback_l_min, feeder.shield_gas_readback_l_min) <= NO_GAS_L_MIN,
            GAS_TIMEOUT_S,
            act=self._once(lambda: feeder.set_carrier_gas(0.0), lambda: feeder.set_shield_gas(0.0)),
            age_s=lambda: feeder.age_s,
            code="gas_flow",
            detail=lambda: f"{feeder.carrier_gas_readback_l_min:.1f} and {feeder.shield_gas_readback_l_min:.1f} L/min read back",
        )

    def park(self, then: Callable[[], None] | None = None) -> Step:
        """The deposition head out of the way, confirmed. then : commanded with it"""
        io = self._d.io
        return Step(
            "parking the deposition head",
            lambda: io.head_parked and not io.head_deployed,
            HEAD_TIMEOUT_S,
            act=self._once(io.park_head, *([then] if then else [])),
            age_s=lambda: io.age_s,
            detail=self._slide,
            remedy="look at the head's slide and its end switches, then reset",
            undo=(self.gas_off(),) if then else (),
            moves=True,
        )

    def by_hand(self, purpose: str, *, parks: bool) -> list[Step]:
        """Before a person moves the machine: laser locked out and read back, no powder, spindle at rest, head out of the way."""
        steps = [self.laser_off(purpose), self.powder_off(), self._cnc.spindle_stands()]
        return [*steps, self.park()] if parks else steps

    def _slide(self) -> str:
        return f"deployed={self._d.io.head_deployed}, parked={self._d.io.head_parked}"

    @staticmethod
    def _is_told(client: DeviceClient) -> bool:
        """Whether the device has taken, and where it can be read back holds, what switches it off."""
        return all(client.holds(name) for name in ("enable", "emission_permit"))

    def powder(self, g_min: float) -> list[Step]:
        """Set the rate and wait until its read-back is steady.

        Powder that was shut a moment ago still arrives through the hose: it has to be gone before its read-back tells anything.
        """
        feeder, limits = self._d.feeder, self._cell.limits
        band = max(limits.powder_settle_tolerance * g_min, NO_POWDER_G_MIN)
        flow = Step(
            f"waiting for powder to flow at {g_min:g} g/min" if g_min > 0 else "waiting for powder to stop",
            lambda: abs(feeder.rate_readback_g_min - g_min) <= band,
            limits.powder_settle_timeout_s,
            act=self._once(lambda: feeder.set_rate(g_min), self._powdered, *([lambda: feeder.divert(False)] if g_min > 0 else [])),
            age_s=lambda: feeder.age_s,
            must_last_s=self._steady_s(g_min),
            code="powder_flow",
            detail=lambda: (
                f"{feeder.rate_readback_g_min:.1f} of {g_min:g} g/min after {limits.powder_settle_timeout_s:g} s"
            ),
            undo=(self.powder_off(),),
        )
        gone = Step(
            "waiting for the powder in the hose",
            lambda: feeder.rate_setpoint_g_min > 0 or g_min <= 0 or feeder.rate_readback_g_min <= NO_POWDER_G_MIN,
            limits.powder_settle_timeout_s,
            age_s=lambda: feeder.age_s,
            code="powder_flow",
            detail=lambda: f"{feeder.rate_readback_g_min:.1f} g/min read back though it is shut",
        )
        return [gone, flow]

    def _steady_s(self, g_min: float) -> float:
        """How long a read-back has to be steady before powder is so at the nozzle: a diverter switches, a sensor at the feeder knows no hose."""
        client, response = self._d.feeder.client, self._cell.response
        hose_s = response.powder_delay_s + 3.0 * response.powder_settle_s if client.device.flow_sensed_at == "feeder" and g_min > 0 else 0.0
        return max(FLOW_STEADY_S, hose_s, DIVERTER_S if self._d.feeder.has_diverter else 0.0)

    def gas(self, carrier: bool, l_min: float) -> Step:
        """Set carrier or shield gas and wait until it flows."""
        feeder = self._d.feeder
        name = "carrier" if carrier else "shield"

        def read() -> float:
            return feeder.carrier_gas_readback_l_min if carrier else feeder.shield_gas_readback_l_min

        return Step(
            f"waiting for {name} gas at {l_min:g} L/min",
            lambda: abs(read() - l_min) <= max(GAS_TOLERANCE * l_min, 0.3),
            GAS_TIMEOUT_S,
            act=lambda: feeder.set_carrier_gas(l_min) if carrier else feeder.set_shield_gas(l_min),
            age_s=lambda: feeder.age_s,
            code="gas_flow",
            detail=lambda: f"{read():.1f} L/min read back",
            undo=(self.gas_off(),),
        )

    def _powdered(self) -> None:
        self._is_dusty = True

    def _purged(self) -> None:
        self._is_dusty = False

    @staticmethod
    def _once(*acts: Callable[[], None]) -> Callable[[], None]:
        def act() -> None:
            for one in acts:
                one()

        return act
