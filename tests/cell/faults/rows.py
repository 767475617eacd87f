"""Every fault of the matrix: how it is made and mended in a simulated cell, what the operator has to be told, how long light may stay."""

from __future__ import annotations

from dataclasses import replace

from tests.cell.faults.row import ACTIVE, EVERYWHERE, STREAMING, Row


def _told(*codes: str) -> frozenset[str]:
    return frozenset(codes)


SILENT = _told("cnc_silent", "cnc_lost", "answer_overdue")
STREAM = _told("answer_overdue", "cnc_answers", "line_rejected", "cnc_alarm")
CNC_WORDS = ("CNC", "serial", "answer")

SERIAL = (
    Row("serial unplugged", ("serial_unplug",), ("serial_plug",), _told("cnc_lost"), CNC_WORDS, EVERYWHERE, "request"),
    Row(
        "serial replugged at once",
        ("serial_unplug", "+0.02 serial_plug"),
        (),
        _told("cnc_lost"),
        CNC_WORDS,
        EVERYWHERE,
        "request",
    ),
    Row(
        "replugged under another name",
        ("serial_unplug", "+0.2 serial_plug ttyOther"),
        ("serial_plug",),
        _told("cnc_lost"),
        CNC_WORDS,
        EVERYWHERE,
        "request",
    ),
    Row("answers garbled", ("serial_garble 3",), (), STREAM, CNC_WORDS),
    Row("reports garbled", ("serial_garble_reports 3",), (), _told("cnc_silent"), CNC_WORDS),
    Row("lines garbled", ("serial_garble_lines",), (), STREAM, CNC_WORDS, is_gappy=True),
    Row("half a line to the machine", ("half_line",), (), STREAM, CNC_WORDS, is_gappy=True),
    Row("half an answer", ("half_answer",), (), STREAM, CNC_WORDS),
    Row("ok lost", ("lost_ok",), (), STREAM, CNC_WORDS),
    Row("ok doubled", ("doubled_ok",), (), STREAM, CNC_WORDS),
    Row("silence both ways", ("serial_silent",), ("serial_ok",), SILENT, CNC_WORDS, EVERYWHERE, "status", "status"),
    Row("machine hears nothing", ("serial_deaf",), ("serial_ok",), SILENT, CNC_WORDS, EVERYWHERE, "status", "status"),
    Row("machine says nothing", ("serial_mute",), ("serial_ok",), SILENT, CNC_WORDS, EVERYWHERE, "status", "status"),
)
GRBL = (("firmware", "grbl"),)
CNC = (
    Row(
        "error at a line, latched (grblHAL)",
        ("reject_line 20",),
        (),
        STREAM,
        CNC_WORDS,
        is_gappy=True,
    ),
    Row(
        "error at a line, goes on (grbl)",
        ("reject_line 20",),
        (),
        STREAM,
        CNC_WORDS,
        is_gappy=True,
        cnc=GRBL,
    ),
    Row(
        "firmware reset",
        ("firmware_reset",),
        (),
        _told("cnc_reset", "cnc_alarm"),
        ("CNC",),
        EVERYWHERE,
        "report",
        "report",
    ),
    Row(
        "alarm",
        ("alarm 3",),
        (),
        _told("cnc_alarm", "estop"),
        ("CNC", "lock"),
        EVERYWHERE,
        "report",
        "report",
    ),
    Row(
        "limit hit",
        ("limit_hit",),
        (),
        _told("cnc_alarm"),
        ("CNC", "lock"),
        EVERYWHERE,
        "report",
        "report",
    ),
    Row(
        "feed hold at the machine",
        ("feed_hold",),
        (),
        _told(),
        ("feed hold at the machine",),
        STREAMING,
        "",
        "report",
    ),
    Row("cycle start at the machine", ("cycle_start",), (), _told(), (), frozenset(), "", "report"),
    Row(
        "CNC without power",
        ("cnc_off",),
        ("cnc_on",),
        SILENT | {"cnc_reset"},
        CNC_WORDS,
        EVERYWHERE,
        "status",
        "status",
    ),
)


def _device_rows(device: str, word: str) -> tuple[Row, ...]:
    lit = code = device
    codes = _told(f"{code}_silent", f"{code}_fault")
    words = (word,)

    def row(
        name: str, strike: str, *, must: frozenset[str] = ACTIVE, bound: str = lit, mend: str = f"modbus_ok {device}"
    ) -> Row:
        standing = "laser" if device == "laser" else "request"
        return Row(f"{device} {name}", (strike,), (mend,) if mend else (), codes, words, must, bound, standing)

    whole_line = (("codes", _told("laser_silent", "feeder_silent", "io_silent")), ("words", ()), ("lit", "laser"), ("standing", "laser"))
    return (
        replace(row("gone, connection refused", f"modbus_gone {device}"), shared=whole_line),
        row("silent", f"modbus_silent {device}"),
        row("slow, 0.3 s", f"modbus_slow {device} 0.3"),
        row("slow, 0.05 s", f"modbus_slow {device} 0.05", must=frozenset(), bound=""),
        row("answers exceptions", f"modbus_exception {device}"),
        row("answers the wrong count", f"modbus_wrong_count {device}"),
        row("answers late, three times", f"modbus_stale {device} 0.15 3", must=frozenset(), bound=""),
        replace(row("server restarted", f"modbus_restart {device}", bound="request", mend=""), codes=_told(f"{code}_lost"), words=()),
        replace(row("without power", f"device_off {device}"), mend=(f"device_on {device}",)),
    )


MODBUS = (
    *_device_rows("laser", "laser"),
    *_device_rows("feeder", "feeder"),
    *_device_rows("io", "I/O coupler"),
    Row(
        "laser reads back the wrong power",
        ("modbus_wrong_value laser power_setpoint_readback 1234.5",),
        ("modbus_ok laser",),
        _told("laser_fault"),
        ("laser",),
        frozenset({"depositing"}),
    ),
    Row(
        "feeder reads back the wrong rate",
        ("modbus_wrong_value feeder rate_setpoint_readback 33",),
        ("modbus_ok feeder",),
        _told("feeder_fault", "powder_flow"),
        ("feeder",),
        frozenset({"depositing"}),
    ),
    Row(
        "laser's power register stuck",
        ("modbus_stuck laser power_setpoint",),
        ("modbus_ok laser",),
        _told("laser_fault", "laser_emitting"),
        ("laser",),
    ),
    Row(
        "laser's emission contact stuck",
        ("modbus_stuck laser emission",),
        ("modbus_ok laser",),
        _told("laser_emitting"),
        ("laser",),
    ),
    Row(
        "feeder's rate register stuck",
        ("modbus_stuck feeder rate_setpoint",),
        ("modbus_ok feeder",),
        _told("feeder_fault", "powder_flow", "gas_flow"),
        ("feeder", "owder"),
    ),
    Row(
        "coupler's head output stuck",
        ("modbus_stuck io head_deploy",),
        ("modbus_ok io",),
        _told("io_fault"),
        (),
    ),
    Row(
        "coupler's heartbeat stuck",
        ("modbus_stuck io heartbeat",),
        ("modbus_ok io",),
        _told("io_fault"),
        ("not followed the heartbeat",),
        frozenset({"depositing"}),
    ),
    Row(
        "coupler's door contact stuck, door opened",
        ("modbus_stuck io door_closed", "+0.02 door_open"),
        ("modbus_ok io", "door_close"),
        _told("door", "laser_interlock", "cnc_alarm"),
        ("door",),
        STREAMING,
        "request",
    ),
)

INTERLOCKS = (
    Row(
        "door opened",
        ("door_open",),
        ("door_close",),
        _told("door"),
        ("door",),
        ACTIVE | {"jogging", "homing"},
        "request",
    ),
    Row(
        "E-stop pressed",
        ("estop_press",),
        ("estop_release",),
        _told("estop"),
        ("emergency", "E-stop"),
        EVERYWHERE,
        "request",
    ),
    Row(
        "chiller fails",
        ("chiller_fail",),
        ("chiller_ok",),
        _told("chiller", "laser_interlock"),
        ("chiller",),
        ACTIVE,
        "request",
    ),
    Row("gas pressure low", ("gas_low",), ("gas_ok",), _told("gas_pressure"), ("as pressure",), ACTIVE, "request"),
    Row(
        "fume extraction off",
        ("fume_fail",),
        ("fume_ok",),
        _told("fume_extraction"),
        ("extraction",),
        ACTIVE,
        "request",
    ),
    Row(
        "door opened and closed within a tick",
        ("blink door",),
        (),
        _told("door", "laser_fault", "laser_interlock"),
        ("door", "laser"),
        frozenset({"depositing"}),
        "request",
    ),
    Row(
        "E-stop opened and closed within a tick",
        ("blink estop",),
        (),
        _told("estop", "cnc_alarm", "laser_fault"),
        ("emergency", "CNC", "lock"),
        EVERYWHERE,
        "request",
        "report",
    ),
    Row(
        "chiller opened and closed within a tick",
        ("blink chiller",),
        (),
        _told("chiller", "laser_fault", "laser_interlock"),
        ("laser", "chiller"),
        frozenset({"depositing"}),
        "request",
    ),
    Row(
        "gas low and back within a tick", ("blink gas",), (), _told("gas_pressure", "gas_flow", "powder_flow"), ("as",)
    ),
    Row("extraction off and on within a tick", ("blink fume",), (), _told("fume_extraction"), ("extraction",)),
)

PROCESS = (
    Row("laser fault", ("laser_fault 8",), (), _told("laser_fault"), ("laser",), ACTIVE, "request"),
    Row(
        "fibre open",
        ("fibre_open",),
        ("fibre_close",),
        _told("laser_interlock", "laser_fault"),
        ("laser", "fibre"),
        frozenset({"depositing"}),
        "request",
    ),
    Row("feeder fault", ("feeder_fault 8",), (), _told("feeder_fault"), ("feeder",), ACTIVE, "request"),
    Row(
        "powder empty",
        ("hopper_empty",),
        ("hopper_fill",),
        _told("feeder_fault", "powder_flow"),
        ("hopper", "owder"),
        frozenset({"depositing"}),
        "request",
    ),
    Row(
        "powder clogged",
        ("feeder_clog",),
        ("feeder_clear",),
        _told("feeder_fault", "powder_flow"),
        ("clog", "owder"),
        frozenset({"depositing"}),
        "request",
    ),
    Row("powder late by 3 s", ("powder_late 3",), ("powder_late 0",), _told("powder_flow"), ("owder",)),
    Row(
        "powder late by 20 s", ("powder_late 20",), ("powder_late 0",), _told("powder_flow"), ("owder",)
    ),
    Row(
        "machine powered off",
        ("power_off",),
        ("power_on",),
        SILENT | _told("power", "laser_silent", "feeder_silent", "io_silent", "cnc_reset"),
        (*CNC_WORDS, "laser", "feeder", "I/O"),
        EVERYWHERE,
        "status",
        "status",
    ),
)

HOST = (
    Row("clock set forward by an hour", ("host clock 3600",), (), _told(), ("clock was set",), EVERYWHERE, "", "report"),
    Row("clock set back by a day", ("host clock -86400",), (), _told(), ("clock was set",), EVERYWHERE, "", "report"),
    Row("disk read-only", ("host disk read-only",), ("host disk writable",), _told("store"), (), EVERYWHERE, "", "report"),
    Row("disk slow, 2 s a commit", ("host commit 2",), ("host commit 0",), _told(), (), frozenset(), "", "report"),
)

ROWS = (*SERIAL, *CNC, *MODBUS, *INTERLOCKS, *PROCESS, *HOST)
LATER = (
    "disk full",
    "store locked",
    "cell killed with -9",
    "web killed with -9",
    "planner killed with -9",
    "supervisor killed with -9",
)
"""Rows of the same matrix whose faults are made by wire, in bench_process_faults."""
