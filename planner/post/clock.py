"""How long the items of a tape take on the cell, and how long its barriers wait: the model of firmware and devices, from the cell's facts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell
from planner.kinematics.chain import Floats
from planner.kinematics.timing import predicted_times
from planner.post.tape import Entry, Move
from planner.program import Channel

Ints = NDArray[np.int64]

_MODE_SAFE, _MODE_DEPOSIT = 0, 1
_STEADY = 0.05  # relative: a flow this near to its set-point is steady
_DRY_G_MIN = 0.05  # powder at the nozzle below this is none


def item_times(items: NDArray[np.void], cell: Cell, waits: Ints) -> Floats:
    """(n,) float, s: what each item takes as the control runs it, waits at barriers not counted.

    items : (n,) ITEM_DTYPE from the cell's home position on, time_s nominal   waits : rows before which a barrier stops the machine
    """
    start = np.array([axis.home for axis in cell.axes])
    steps = np.diff(np.vstack([start, items["joints"]]), axis=0)
    stops = items["stop"] | np.append(False, items["stop"][:-1])
    stops[waits] = True
    acceleration = np.array([axis.max_acceleration for axis in cell.axes])
    columns = cell.letters.index("X"), cell.letters.index("Y")
    return predicted_times(
        steps,
        items["time_s"],
        _carried(stops, items["move"] == Move.NONE),
        acceleration,
        cell.cnc.junction_deviation_mm,
        items["bulge"],
        columns,
        cell.cnc.arc_tolerance_mm,
    )


def _carried(stops: NDArray[np.bool_], stands: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Standing carried on over items without motion to the next motion."""
    result = stops.copy()
    for i in np.flatnonzero(stands).tolist():
        if result[i] and i + 1 < len(result):
            result[i + 1] = True
    return result


def spin_up_s(cell: Cell, from_rpm: float, to_rpm: float) -> float:
    """s that the control waits until the spindle turns; it does not wait for a standstill."""
    return abs(to_rpm - from_rpm) / cell.response.spindle_rpm_per_s if to_rpm > 0.0 else 0.0


def barrier_waits_s(entries: Sequence[Entry], cell: Cell) -> float:
    """s that all barriers of a schedule wait: head slide, purge, gas and powder until they are steady, one after the other.

    A flow that follows with the time constant T is within a share e of a step after T ln(1 / e); powder comes through its hose first.
    """
    response = cell.response
    waited, powder, carrier, shield = 0.0, 0.0, 0.0, 0.0
    for entry in entries:
        value = entry.value
        if entry.channel == Channel.POWDER_G_MIN:
            if entry.is_barrier and abs(value - powder) > _STEADY * value:  # what is steady already waits for nothing
                waited += response.powder_delay_s + _settling(powder, value, _STEADY * value, response.powder_settle_s)
            powder = value
        elif entry.channel == Channel.MODE and value != _MODE_DEPOSIT:
            if powder > 0.0:
                waited += response.powder_delay_s + _settling(powder, 0.0, _DRY_G_MIN, response.powder_settle_s)
            waited += cell.limits.purge_s + response.head_slide_s
            powder = 0.0
            carrier, shield = (0.0, 0.0) if value == _MODE_SAFE else (carrier, shield)
        elif entry.channel == Channel.MODE:
            waited += response.head_slide_s
        elif entry.channel == Channel.CARRIER_GAS_L_MIN:
            waited += _settling(carrier, value, _STEADY * max(value, 1.0), response.gas_settle_s)
            carrier = value
        elif entry.channel == Channel.SHIELD_GAS_L_MIN and entry.is_barrier:
            waited += _settling(shield, value, _STEADY * max(value, 1.0), response.gas_settle_s)
            shield = value
    return waited


def _settling(before: float, value: float, band: float, constant_s: float) -> float:
    """s until a flow that starts at `before` is within the band of its value."""
    gap = abs(value - before)
    return constant_s * float(np.log(gap / band)) if gap > band > 0.0 else 0.0
