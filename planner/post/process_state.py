"""What laser, powder, gas and spindle are told, and where on the tape: the process schedule and the gate."""

from __future__ import annotations

from config.cell import Cell
from planner.post.tape import Origin, Tape
from planner.program import Channel

MODE_SAFE, MODE_DEPOSIT, MODE_MILL = 0, 1, 2


class ProcessState:
    """Follows the set-points along the tape and records their changes.

    The laser's level is left standing between passes (the gate decides emission) and powder flows on between passes of a
    deposition, since it takes seconds to settle; both end with the mode.
    """

    def __init__(self, tape: Tape, cell: Cell, carrier_gas_l_min: float) -> None:
        self._tape = tape
        self._output = cell.cnc.laser_gate_output
        self._carrier_gas = carrier_gas_l_min
        self.mode = MODE_SAFE
        self.is_emitting = False
        self._laser_w = 0.0
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
        self._laser_w = self._powder = self._shield_gas = 0.0
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
        if laser_w > 0.0 and not self.is_emitting:
            self.emit(origin, laser_w)
        elif laser_w > 0.0 and laser_w != self._laser_w:
            self._tape.schedule(Channel.LASER_W, laser_w, self._tape.count)
            self._laser_w = laser_w
        elif laser_w <= 0.0:
            self.darken(origin)
        if laser_w > 0.0 and powder_g_min != self._powder:
            self._tape.schedule(Channel.POWDER_G_MIN, powder_g_min, self._tape.count)
            self._powder = powder_g_min
        if laser_w > 0.0 and shield_gas_l_min != self._shield_gas:
            self._tape.schedule(Channel.SHIELD_GAS_L_MIN, shield_gas_l_min, self._tape.count)
            self._shield_gas = shield_gas_l_min

    def emit(self, origin: Origin, laser_w: float) -> None:
        """Gate on with the next move; the level is set as early as the laser has been dark."""
        if laser_w != self._laser_w:
            self._tape.schedule(Channel.LASER_W, laser_w, self._dark_item)
            self._laser_w = laser_w
        self._gate(True, origin)

    def darken(self, origin: Origin) -> None:
        """Gate off with the next move. Harmless twice."""
        if self.is_emitting:
            self._gate(False, origin)
            self._dark_item = self._tape.count

    def _gate(self, on: bool, origin: Origin) -> None:
        if self._output is None:
            self._tape.schedule(Channel.EMISSION, float(on), self._tape.count)
        else:
            self._tape.command(f"M{62 if on else 63} P{self._output}", origin)
        self.is_emitting = on
