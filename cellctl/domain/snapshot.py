"""What the cell process says about itself ten times a second: one struct, the same over the socket, REST and WebSocket."""

from __future__ import annotations

import msgspec


class Lines(msgspec.Struct, frozen=True):
    """The four line counts of the Program (protocols.md: an `ok` says only that a line was parsed), and how many there are."""

    sent: int = 0
    acknowledged: int = 0
    executing: int = 0
    executed: int = 0
    total: int = 0


class LatencyView(msgspec.Struct, frozen=True):
    """Times of one device as learnt while running (s); learnt: samples behind the reaction, 0: the register map's word."""

    request_s: float = 0.0
    on_s: float = 0.0  # from the begin of a write that switches on to half of the output
    off_s: float = 0.0
    transport_s: float = 0.0  # powder: from a new rate to its first change in the rate read back; 0: not yet learnt
    learnt: int = 0


class LaserView(msgspec.Struct, frozen=True):
    """Laser: set-points and read-backs; age_s is the age of the oldest reading (large: stale)."""

    connected: bool = False
    age_s: float = 1e9
    enabled: bool = False
    permitted: bool = False
    emitting: bool = False
    power_setpoint_w: float = 0.0
    power_readback_w: float = 0.0
    faults: list[str] = []
    interlocks: list[str] = []
    latency: LatencyView = LatencyView()


class FeederView(msgspec.Struct, frozen=True):
    """Powder feeder and gas."""

    connected: bool = False
    age_s: float = 1e9
    rate_setpoint_g_min: float = 0.0
    rate_readback_g_min: float = 0.0
    carrier_gas_setpoint_l_min: float = 0.0
    carrier_gas_readback_l_min: float = 0.0
    shield_gas_setpoint_l_min: float = 0.0
    shield_gas_readback_l_min: float = 0.0
    hopper_fraction: float = 0.0
    faults: list[str] = []
    latency: LatencyView = LatencyView()


class IoView(msgspec.Struct, frozen=True):
    """I/O coupler: interlock levels and the head's slide."""

    connected: bool = False
    age_s: float = 1e9
    estop_ok: bool = False
    door_closed: bool = False
    chiller_ok: bool = False
    gas_pressure_ok: bool = False
    fume_extraction_ok: bool = False
    head_deployed: bool = False
    head_parked: bool = False


class CncView(msgspec.Struct, frozen=True):
    """CNC: state as the firmware says it, position, buffers."""

    connected: bool = False
    age_s: float = 1e9
    firmware: str = ""
    state: str = ""
    machine: dict[str, float] = {}
    work: dict[str, float] = {}
    feed_mm_min: float = 0.0
    spindle_rpm: float = 0.0
    tool: int = 0
    planner_free: int = 0
    rx_free: int = 0
    feed_override: int = 100
    planner_fill_percent: float | None = None  # None: not reported
    rx_fill_percent: float | None = None


class Permissive(msgspec.Struct, frozen=True):
    """One condition for laser emission: whether it is met and why not, the level in words, and the age of the oldest reading behind it.

    age_s : s; negative where nothing is read (the cell's own state). stale_s : s, the age from which it counts as unsafe; 0 where nothing is read.
    """

    name: str
    ok: bool
    why: str = ""
    level: str = ""
    age_s: float = -1.0
    stale_s: float = 0.0


class Alarm(msgspec.Struct, frozen=True):
    """A latched fault: cause and remedy in the operator's words. acknowledged_by : who said that it was seen; "": nobody

    at, acknowledged_at : Unix time (s)
    """

    id: int
    at: float
    code: str
    cause: str
    remedy: str
    acknowledged_by: str = ""
    acknowledged_at: float = 0.0


class JobView(msgspec.Struct, frozen=True):
    """The running (or interrupted) job."""

    id: str
    name: str
    layer: int = 0
    layers: int = 0
    operation: int = -1
    operation_kind: str = ""
    progress: float = 0.0
    elapsed_s: float = 0.0
    remaining_s: float = 0.0
    outcome: str = ""  # "", "completed", "aborted", "failed", "interrupted"
    followed_by: str = ""  # what progress rests on: "Ln" or "position"
    arc_mm: float = 0.0  # arc length of the tip's path that is known to be executed
    error_mm: float = -1.0  # how far off the predicted arc length may be, by the follower's own estimate; negative: not known


class Control(msgspec.Struct, frozen=True):
    """Who has control of the cell. client : which console or program of that person; since, seen_at : Unix time (s)

    absent : not heard for so long that it may be gone; taking over stays a person's decision
    """

    holder: str
    client: str
    since: float
    seen_at: float = 0.0
    absent: bool = False


class Table(msgspec.Struct, frozen=True):
    """When the table was last no longer as a person may have found it (Unix time, s), and why."""

    disturbed_at: float = 0.0
    because: str = ""


class OverridesView(msgspec.Struct, frozen=True):
    """Feed, laser and powder in percent of what is programmed, and the percentages that the running job's material window allows.

    Without a job, or where the job uses none of it, least and greatest are 100. laser_window_w, powder_window_g_min : least and greatest
    """

    feed_percent: int = 100
    feed_min: int = 10
    feed_max: int = 200
    laser_percent: int = 100
    laser_min: int = 100
    laser_max: int = 100
    laser_window_w: tuple[float, float] = (0.0, 0.0)
    powder_percent: int = 100
    powder_min: int = 100
    powder_max: int = 100
    powder_window_g_min: tuple[float, float] = (0.0, 0.0)


class HandView(msgspec.Struct, frozen=True):
    """What goes on by hand, and what there is for it. has_pilot : the laser has an aiming beam; places : where the machine can be sent"""

    has_pilot: bool = False
    pilot: bool = False
    pilot_left_s: float = 0.0
    flow_left_s: float = 0.0
    places: list[str] = []


class TickView(msgspec.Struct, frozen=True):
    """The safety tick's own health. longest_ms : longest time between two of the ticks that jitter is stated over

    worst_ms : largest deviation of the time between two ticks from the period, of the last moment, as the trends have it
    """

    count: int = 0
    missed: int = 0
    jitter_p99_ms: float = 0.0
    scheduler: str = ""
    longest_ms: float = 0.0
    worst_ms: float = 0.0


class Snapshot(msgspec.Struct, frozen=True):
    """State of the cell. `at` is Unix time (s); tip and tool_axis are in the build frame (mm, unit vector)."""

    seq: int
    at: float
    cell: str
    mode: str
    state: str
    execution: str
    because: str = ""
    waiting: str = ""
    tip: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tool_axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    tip_speed_mm_s: float = 0.0
    lines: Lines = Lines()
    laser: LaserView = LaserView()
    feeder: FeederView = FeederView()
    io: IoView = IoView()
    cnc: CncView = CncView()
    job: JobView | None = None
    permissives: list[Permissive] = []
    alarms: list[Alarm] = []
    tick: TickView = TickView()
    control: Control | None = None
    table: Table = Table()
    overrides: OverridesView = OverridesView()
    hand: HandView = HandView()
    position: str = ""  # why the machine's position is not to be trusted; empty: it is
