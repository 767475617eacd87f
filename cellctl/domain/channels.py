"""The channels of the trends: what of a process is sampled, in which unit, and how large a change is news while no job runs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Channel:
    """One column of the journal. step : in its unit; a smaller change is not written down by itself while no job runs

    setpoint : channel that says what this one should read; "" if it is no read-back
    """

    name: str
    unit: str
    step: float
    setpoint: str = ""


CHANNELS: tuple[Channel, ...] = (
    Channel("laser_setpoint_w", "W", 1.0),
    Channel("laser_readback_w", "W", 5.0, "laser_setpoint_w"),
    Channel("powder_setpoint_g_min", "g/min", 0.05),
    Channel("powder_readback_g_min", "g/min", 0.2, "powder_setpoint_g_min"),
    Channel("carrier_gas_setpoint_l_min", "L/min", 0.05),
    Channel("carrier_gas_readback_l_min", "L/min", 0.3, "carrier_gas_setpoint_l_min"),
    Channel("shield_gas_setpoint_l_min", "L/min", 0.05),
    Channel("shield_gas_readback_l_min", "L/min", 0.5, "shield_gas_setpoint_l_min"),
    Channel("tip_speed_mm_s", "mm/s", 0.5),
    Channel("planner_fill_percent", "%", 20.0),
    Channel("rx_fill_percent", "%", 20.0),
    Channel("tick_jitter_ms", "ms", 5.0),
    Channel("spindle_rpm", "1/min", 50.0),
    Channel("feed_override_percent", "%", 0.5),
    Channel("laser_override_percent", "%", 0.5),
    Channel("powder_override_percent", "%", 0.5),
)
"""In the order in which their figures are packed (store/trend_levels.py): new ones are added at the end, none is taken out.

tick_jitter_ms : largest deviation of the time between two safety ticks from its period, since the sample before
planner_fill_percent, rx_fill_percent : of the CNC's planner and receive buffer, as it reports them
"""

NAMES: tuple[str, ...] = tuple(channel.name for channel in CHANNELS)
INTERLOCK_BITS: tuple[str, ...] = ("estop_ok", "door_closed", "chiller_ok", "gas_pressure_ok", "fume_extraction_ok")
"""Levels in a sample's `interlocks`, the least significant bit first; set: safe."""
