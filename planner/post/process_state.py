"""What laser, powder, gas and spindle are told, and where on the tape: the process schedule and the gate."""

from __future__ import annotations

from dataclasses import dataclass, replace

from config.cell import Cell
from planner.post.tape import Origin, Tape
from planner.program import Channel

MODE_SAFE, MODE_DEPOSIT, MODE_MILL = 0, 1, 2


@dataclass(frozen=True)
class Emission:
    """A stretch with the laser's gate open, in items of the tape.

    dark : from this item on the laser has been dark before it   begin, end : first item, one past the last
    is_fresh : the first one since the laser's level was 0
    """

    dark: int
    begin: int
    end: int
    is_fresh: bool


class ProcessState:
    """Follows the set-points along the tape and records their changes.

    The laser's level is left standing between passes (the gate decides emission; `tracking` sets it) and powder flows on between
    passes of a deposition, since it takes seconds to settle; both end with the mode.
    """

    def __init__(self, tape: Tape, cell: Cell, carrier_gas_l_min: float) -> None:
        self._tape = tape
        self._output = cell.cnc.laser_gate_output
        self._carrier_gas = carrier_gas_l_min
        self.mode = MODE_SAFE
        self.is_emitting = False
        self.emissions: list[Emission] = []
        self._is_fresh = True
        self._powder = 0.0
        self._shield_gas = 0.0
        self._dark_item = 0
        self._approach_item: int | None = None

    @property
    def gate(self) -> str:
        """stream or modbus."""
        return "modbus" if self._output is None else "stream"

    def enter_mode(self, mode: int, item: int) -> None:
        """Guarded change of mode before an item; levels start from nothing in every mode."""
        self._tape.schedule(Channel.MODE, mode, item, is_barrier=True)
        self.mode = mode
        self._powder = self._shield_gas = 0.0
        self._is_fresh = True
        self._dark_item = item
        self._approach_item = None

    def note_link(self, item: int) -> None:
        """This item moves without process: at its start the head stands clear, to wait for powder if it is the last such."""
        self._approach_item = item

    def start_flows(self, powder_g_min: float, shield_gas_l_min: float) -> None:
        """Powder and gas steady before the next pass: at the last link before it, where the head stands clear of the part."""
        item = self._tape.count if self._approach_item is None else self._approach_item
        if shield_gas_l_min != self._shield_gas:
            if self._shield_gas == 0.0:
                self._tape.schedule(Channel.CARRIER_GAS_L_MIN, self._carrier_gas, item, is_barrier=True)
            self._tape.schedule(Channel.SHIELD_GAS_L_MIN, shield_gas_l_min, item, is_barrier=True)
            self._shield_gas = shield_gas_l_min
        if powder_g_min != self._powder:
            self._tape.schedule(Channel.POWDER_G_MIN, powder_g_min, item, is_barrier=True)
            self._powder = powder_g_min

    def set_points(self, laser_w: float, powder_g_min: float, shield_gas_l_min: float, origin: Origin) -> None:
        """Set-points of the moves that come next; a laser power above 0 emits."""
        if laser_w > 0.0:
            self.emit(origin)
        else:
            self.darken(origin)
        if laser_w > 0.0 and powder_g_min != self._powder:
            self._tape.schedule(Channel.POWDER_G_MIN, powder_g_min, self._tape.count)
            self._powder = powder_g_min
        if laser_w > 0.0 and shield_gas_l_min != self._shield_gas:
            self._tape.schedule(Channel.SHIELD_GAS_L_MIN, shield_gas_l_min, self._tape.count)
            self._shield_gas = shield_gas_l_min

    def emit(self, origin: Origin) -> None:
        """Gate on with the next move. Harmless twice."""
        if not self.is_emitting:
            self._gate(True, origin)
            self.emissions.append(Emission(self._dark_item, self._tape.count, self._tape.count, self._is_fresh))
            self._is_fresh = False

    def darken(self, origin: Origin) -> None:
        """Gate off with the next move. Harmless twice."""
        if self.is_emitting:
            self.emissions[-1] = replace(self.emissions[-1], end=self._tape.count)
            self._gate(False, origin)
            self._dark_item = self._tape.count

    def _gate(self, on: bool, origin: Origin) -> None:
        if self._output is None:
            self._tape.schedule(Channel.EMISSION, float(on), self._tape.count)
        else:
            self._tape.command(f"M{62 if on else 63} P{self._output}", origin)
        self.is_emitting = on
