"""The guarded changes of the cell: safe, deposit, mill, powder steady, gas; each step commanded and read back (invariant 7)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from cellctl.cell.transaction import Step
from config.cell import Cell
from drivers.cell_wires import CellDrivers
from drivers.cnc.protocol import FULL_STATUS
from drivers.interfaces import Clock

SAFE, DEPOSIT, MILL = 0, 1, 2
HEAD_TIMEOUT_S = 10.0  # a slide takes a second or two
LASER_TIMEOUT_S = 2.0
GAS_TIMEOUT_S = 5.0
STATUS_TIMEOUT_S = 5.0  # firmware repeats WCO and T every 10 to 30 reports
GAS_TOLERANCE = 0.15  # relative; gas only has to flow
NO_POWDER_G_MIN = 0.2  # a feeder's read-back at rest
OFFSET_TOLERANCE = 2e-3  # mm or deg; firmware prints three decimals


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

    def steps(self, mode: int, tool: int | None, offset: dict[str, float]) -> list[Step]:
        """Steps of MODE 0, 1 or 2. tool : what has to be in the spindle (None: not checked); offset : G54 of the Program."""
        if mode == DEPOSIT:
            return self.deposit(tool, offset)
        return self.dark("milling" if mode == MILL else "the end")

    def deposit(self, tool: int | None, offset: dict[str, float]) -> list[Step]:
        """Tool and datum checked, head deployed and confirmed, laser enabled with the permit still off."""
        io, laser = self._d.io, self._d.laser
        ready = lambda: laser.is_enabled and not laser.faults and not laser.interlocks and laser.age_s < LASER_TIMEOUT_S  # noqa: E731
        return [
            *([self._tool(tool)] if tool is not None else []),
            self._datum(offset),
            Step(
                "deploying the deposition head",
                lambda: io.head_deployed and not io.head_parked,
                HEAD_TIMEOUT_S,
                act=self._once(lambda: self._hand.lock("the head is moving"), io.deploy_head),
                age_s=lambda: io.age_s,
                detail=lambda: f"deployed={io.head_deployed}, parked={io.head_parked}",
                remedy="look at the head's slide and its end switches, then reset",
            ),
            Step(
                "enabling the laser",
                ready,
                LASER_TIMEOUT_S,
                act=lambda: laser.enable(True),
                age_s=lambda: laser.age_s,
                detail=lambda: "; ".join([*laser.faults, *laser.interlocks]) or "not ready",
                remedy="look at the laser's panel, then reset",
            ),
        ]

    def dark(self, purpose: str) -> list[Step]:
        """Laser locked out and read back, powder shut and purged, head parked and confirmed."""
        io, laser, feeder, limits = self._d.io, self._d.laser, self._d.feeder, self._cell.limits
        self._is_dusty |= feeder.rate_setpoint_g_min > 0 or not feeder.rate_readback_g_min <= NO_POWDER_G_MIN
        steps = [
            Step(
                f"switching the laser off for {purpose}",
                lambda: (
                    not laser.is_emitting and laser.power_readback_w < limits.emission_off_w and not laser.is_enabled
                ),
                LASER_TIMEOUT_S,
                act=self._once(lambda: self._hand.lock(f"laser locked out for {purpose}"), lambda: laser.enable(False)),
                age_s=lambda: laser.age_s,
                code="laser_emitting",
                detail=lambda: f"{laser.power_readback_w:.0f} W read back",
            ),
            Step(
                "waiting for powder to stop",
                lambda: feeder.rate_readback_g_min <= NO_POWDER_G_MIN,
                limits.powder_settle_timeout_s,
                act=lambda: feeder.set_rate(0.0),
                age_s=lambda: feeder.age_s,
                detail=lambda: f"{feeder.rate_readback_g_min:.1f} g/min read back",
                remedy="look at the feeder, then reset",
            ),
        ]
        if self._is_dusty and limits.purge_s > 0:
            until = [0.0]
            steps.append(
                Step(
                    f"purging the powder line for {limits.purge_s:g} s",
                    lambda: self._clock.now() >= until[0],
                    limits.purge_s + 1.0,
                    act=lambda: until.__setitem__(0, self._clock.now() + limits.purge_s),
                )
            )
        steps.append(
            Step(
                "parking the deposition head",
                lambda: io.head_parked and not io.head_deployed,
                HEAD_TIMEOUT_S,
                act=self._once(
                    self._purged, io.park_head, lambda: feeder.set_carrier_gas(0.0), lambda: feeder.set_shield_gas(0.0)
                ),
                age_s=lambda: io.age_s,
                detail=lambda: f"deployed={io.head_deployed}, parked={io.head_parked}",
                remedy="look at the head's slide and its end switches, then reset",
            )
        )
        return steps

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
            act=self._once(lambda: feeder.set_rate(g_min), self._powdered),
            age_s=lambda: feeder.age_s,
            must_last_s=0.1,
            code="powder_flow",
            detail=lambda: (
                f"{feeder.rate_readback_g_min:.1f} of {g_min:g} g/min after {limits.powder_settle_timeout_s:g} s"
            ),
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
        )

    def _tool(self, number: int) -> Step:
        def mounted() -> int | None:
            return self._d.cnc.status.tool if self._d.cnc.status else None

        return Step(
            f"checking that tool {number} is mounted",
            lambda: mounted() == number,
            STATUS_TIMEOUT_S,
            code="tool",
            detail=lambda: f"the CNC reports T{mounted()}",
        )

    def _datum(self, offset: dict[str, float]) -> Step:
        cnc = self._d.cnc

        def ask() -> None:
            if cnc.identity is not None and cnc.identity.firmware == "grblhal":
                cnc.urge(FULL_STATUS)  # with the offset; others repeat it every 10 to 30 reports

        return Step(
            "checking the work offset",
            lambda: not offset_differs(self._d.cnc.status.wco if self._d.cnc.status else {}, offset),
            STATUS_TIMEOUT_S,
            act=ask,
            age_s=lambda: self._clock.now() - cnc.status.at if cnc.status else STATUS_TIMEOUT_S,
            must_last_s=0.03,  # a report that was asked for before may still come first
            code="datum",
            detail=lambda: offset_differs(self._d.cnc.status.wco if self._d.cnc.status else {}, offset),
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


def offset_differs(held: dict[str, float], wanted: dict[str, float]) -> str:
    """Where the controller's offset is not the Program's, in words; empty when they agree."""
    if not held:
        return "the CNC has not told its work offset"
    wrong = [
        f"{letter} is {held.get(letter, float('nan')):.3f}, the program needs {value:.3f}"
        for letter, value in wanted.items()
        if not abs(held.get(letter, float("nan")) - value) <= OFFSET_TOLERANCE
    ]
    return "; ".join(wrong)
