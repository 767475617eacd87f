"""The snapshot: what the cell process says about itself, one struct from everything it knows."""

from __future__ import annotations

from cellctl.cell import overriding
from cellctl.cell.controller import Controller
from cellctl.cell.figures import fills_percent
from cellctl.cell.tick import Beat
from cellctl.domain.snapshot import (
    Alarm,
    CncView,
    FeederView,
    HandView,
    IoView,
    LaserView,
    LatencyView,
    Snapshot,
    TickView,
)
from cellctl.domain.states import EXECUTION, State
from drivers.cell_wires import CellDrivers
from drivers.modbus.latency import Latency

NEVER_S = 1e9  # age of what was never read; JSON has no infinity


def snapshot(c: Controller, seq: int, beat: Beat) -> Snapshot:
    """The cell as it stands."""
    d = c.drivers
    tip, axis, speed = _tip(c)
    views = (
        (_laser(c, d), _feeder(d), _io(d), _cnc(c, d))
        if d is not None
        else (LaserView(), FeederView(), IoView(), CncView())
    )
    return Snapshot(
        seq=seq,
        at=c.times.unix(),
        cell=c.cell.name,
        mode=c.cell.mode,
        state=c.state.value,
        execution=EXECUTION[c.state],
        because=c.because,
        waiting=_waiting(c),
        tip=tip,
        tool_axis=axis,
        tip_speed_mm_s=speed,
        lines=c.lines(),
        laser=views[0],
        feeder=views[1],
        io=views[2],
        cnc=views[3],
        job=c.job_view() if c.run is not None else c.ended.view if c.ended else None,
        permissives=c.permissives,
        alarms=_alarms(c),
        tick=_tick(c, beat),
        control=c.control.view,
        table=c.table.view,
        overrides=overriding.view(c),
        hand=_hand(c, d),
        position=c.position.why,
    )


def _tick(c: Controller, beat: Beat) -> TickView:
    worst_ms = round(c.sampling.jitter.worst_ms, 2)
    return TickView(beat.count, beat.missed, round(beat.jitter_p99_ms, 3), beat.scheduler, round(beat.longest_ms, 1), worst_ms)


def _hand(c: Controller, d: CellDrivers | None) -> HandView:
    laser = d.laser if d is not None else None
    return HandView(
        laser is not None and laser.has_pilot, laser is not None and laser.is_pilot_on, round(c.pilot.left_s, 1),
        round(c.flow_by_hand.left_s, 1), [*c.cell.by_hand.places],
    )  # fmt: skip


def _waiting(c: Controller) -> str:
    if c.transaction is not None:
        return c.transaction.waiting
    if c.run is not None and c.run.transaction is not None:
        return c.run.transaction.waiting
    if c.way_back is not None:
        return c.way_back.waiting
    return c.offline_line if c.state is State.OFFLINE else ""


def _alarms(c: Controller) -> list[Alarm]:
    """What is latched, and what is missing while offline (id 0: it goes when the device answers)."""
    latched = list(c.alarms.values())
    if c.state is State.OFFLINE and c.offline_line:
        latched.append(
            Alarm(
                0,
                c.times.unix(),
                "offline",
                c.offline_line,
                "connect the device that is named; the cell tries every second",
            )
        )
    return latched


def _tip(c: Controller) -> tuple[tuple[float, float, float], tuple[float, float, float], float]:
    last = c.run.follower.last if c.run is not None else None
    if c.run is None or last is None:
        status = c.drivers.cnc.status if c.drivers is not None else None
        if status is None:
            return (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.0
        return *c.tips.find(status.machine, status.tool or 0), 0.0
    tip, axis = c.run.timeline.tip_at(last.line, last.fraction)
    speed = c.run.follower.speed_mm_s if last.is_run else 0.0
    return (float(tip[0]), float(tip[1]), float(tip[2])), (float(axis[0]), float(axis[1]), float(axis[2])), speed


def _age(age_s: float) -> float:
    return min(age_s, NEVER_S)


def _number(value: float) -> float:
    return value if value == value else 0.0  # NaN: never read; the age says so


def _latency(known: Latency) -> LatencyView:
    on, off = known.on, known.off
    return LatencyView(
        request_s=round(known.write.value_s, 5),
        on_s=round(on.value_s, 5),
        off_s=round(off.value_s, 5),
        transport_s=round(known.transport.believed(0.0).value_s, 3),
        learnt=min(on.samples, off.samples),
    )


def _laser(c: Controller, d: CellDrivers) -> LaserView:
    laser = d.laser
    return LaserView(
        laser.connected, _age(laser.age_s), laser.is_enabled, laser.is_permitted, laser.is_emitting,
        laser.power_setpoint_w, _number(laser.power_readback_w), list(laser.faults), list(laser.interlocks),
        _latency(laser.client.latency),
    )  # fmt: skip


def _feeder(d: CellDrivers) -> FeederView:
    f = d.feeder
    return FeederView(
        f.connected, _age(f.age_s), f.rate_setpoint_g_min, _number(f.rate_readback_g_min), f.carrier_gas_setpoint_l_min,
        _number(f.carrier_gas_readback_l_min), f.shield_gas_setpoint_l_min, _number(f.shield_gas_readback_l_min),
        _number(f.hopper_fraction), list(f.faults), _latency(f.client.latency),
    )  # fmt: skip


def _io(d: CellDrivers) -> IoView:
    io = d.io
    return IoView(
        io.connected, _age(io.age_s), io.estop_ok, io.door_closed, io.chiller_ok, io.gas_pressure_ok,
        io.fume_extraction_ok, io.head_deployed, io.head_parked,
    )  # fmt: skip


def _cnc(c: Controller, d: CellDrivers) -> CncView:
    status, identity = d.cnc.status, d.cnc.identity
    firmware = f"{identity.firmware} {identity.version}" if identity else ""
    if status is None:
        return CncView(connected=c.is_cnc_alive, firmware=firmware)
    return CncView(
        c.is_cnc_alive, _age(c.senses.cnc_age_s), firmware, status.state, status.machine, status.work, status.feed_mm_min,
        status.rpm, status.tool or 0, status.planner_free or 0, status.rx_free or 0, status.overrides[0], *fills_percent(d),
    )  # fmt: skip
