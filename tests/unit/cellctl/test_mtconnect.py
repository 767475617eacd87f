"""MTConnect: each state's words, SHDR read by a plain socket, the agent's XML read with lxml, and what a silent cell is told as."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Any

import httpx
import msgspec
import pytest
from lxml import etree

from cellctl.client_events import LiveMessage
from cellctl.domain.snapshot import (
    Alarm,
    CncView,
    FeederView,
    IoView,
    JobView,
    LaserView,
    Lines,
    OverridesView,
    Snapshot,
)
from cellctl.domain.states import State
from cellctl.shop.adapter import Adapter
from cellctl.shop.agent import Agent
from cellctl.shop.follow import take
from cellctl.shop.freshness import Known
from cellctl.shop.mirror import Mirror
from cellctl.shop.mtconnect import Listening, run
from cellctl.shop.mtconnect_words import condition_of
from cellctl.shop.shdr import clean
from config.cell import load_cell

CELL = load_cell("trunnion_tcp")
WALL = 1_700_000_000.0
JOB = JobView("job-1", "one | block")

# Words of MTConnect Part 2 and 3, version 2.0: type -> (category, units, subtypes, values or None for a number or text)
STANDARD: dict[str, tuple[str, set[str], set[str], set[str] | None]] = {
    "AVAILABILITY": ("EVENT", set(), set(), {"AVAILABLE", "UNAVAILABLE"}),
    "EXECUTION": ("EVENT", set(), set(), {
        "READY", "ACTIVE", "INTERRUPTED", "WAIT", "FEED_HOLD", "STOPPED", "OPTIONAL_STOP", "PROGRAM_STOPPED", "PROGRAM_COMPLETED"}),
    "CONTROLLER_MODE": ("EVENT", set(), set(), {"AUTOMATIC", "MANUAL", "MANUAL_DATA_INPUT", "SEMI_AUTOMATIC", "EDIT"}),
    "EMERGENCY_STOP": ("EVENT", set(), set(), {"ARMED", "TRIGGERED"}),
    "DOOR_STATE": ("EVENT", set(), set(), {"OPEN", "CLOSED", "UNLATCHED"}),
    "MESSAGE": ("EVENT", set(), set(), None),
    "PROGRAM": ("EVENT", set(), {"SCHEDULE", "MAIN", "ACTIVE"}, None),
    "LINE_NUMBER": ("EVENT", set(), {"ABSOLUTE", "INCREMENTAL"}, None),
    "TOOL_NUMBER": ("EVENT", set(), set(), None),
    "PART_COUNT": ("EVENT", set(), {"ALL", "GOOD", "BAD", "TARGET", "REMAINING", "COMPLETE", "FAILED", "ABORTED"}, None),
    "PATH_FEEDRATE_OVERRIDE": ("EVENT", set(), {"JOG", "PROGRAMMED", "RAPID"}, None),
    "PATH_FEEDRATE": ("SAMPLE", {"MILLIMETER/SECOND"}, {"ACTUAL", "COMMANDED", "JOG", "PROGRAMMED", "RAPID"}, None),
    "POSITION": ("SAMPLE", {"MILLIMETER"}, {"ACTUAL", "COMMANDED", "PROGRAMMED", "TARGET"}, None),
    "ANGLE": ("SAMPLE", {"DEGREE"}, {"ACTUAL", "COMMANDED", "PROGRAMMED"}, None),
    "ROTARY_VELOCITY": ("SAMPLE", {"REVOLUTION/MINUTE"}, {"ACTUAL", "COMMANDED", "PROGRAMMED"}, None),
    "WATTAGE": ("SAMPLE", {"WATT"}, {"ACTUAL", "TARGET"}, None),
    "FLOW": ("SAMPLE", {"LITER/SECOND"}, {"ACTUAL", "COMMANDED", "TARGET"}, None),
    "FILL_LEVEL": ("SAMPLE", {"PERCENT"}, set(), None),
    "SYSTEM": ("CONDITION", set(), set(), None),
    "LOGIC_PROGRAM": ("CONDITION", set(), set(), None),
    "COMMUNICATIONS": ("CONDITION", set(), set(), None),
    "x:MASS_FLOW": ("SAMPLE", {"x:GRAM_PER_MINUTE"}, {"ACTUAL", "TARGET"}, None),
}  # fmt: skip


def snapshot(at: float = 1.0, **other: Any) -> Snapshot:
    """A cell of which everything is heard."""
    given: dict[str, Any] = {
        "seq": 1, "at": at, "cell": CELL.name, "mode": "sim", "state": "RUNNING", "execution": "ACTIVE", "job": JOB,
        "lines": Lines(5, 4, 3, 2, 9), "tip_speed_mm_s": 10.0, "overrides": OverridesView(feed_percent=80),
        "laser": LaserView(connected=True, age_s=0.1, power_setpoint_w=900.0, power_readback_w=895.5),
        "feeder": FeederView(connected=True, age_s=0.1, rate_setpoint_g_min=6.0, rate_readback_g_min=5.9, hopper_fraction=0.5,
                             carrier_gas_readback_l_min=6.0),
        "io": IoView(connected=True, age_s=0.1, estop_ok=True, door_closed=True),
        "cnc": CncView(connected=True, age_s=0.1, machine={"X": 1.5, "Y": 2.0, "Z": -3.0, "A": 45.0, "C": 90.0}, spindle_rpm=8000.0, tool=2),
    }  # fmt: skip
    return Snapshot(**{**given, **other})


@dataclass
class Shop:
    """A mirror that is fed by hand, in time of its own."""

    mirror: Mirror = field(default_factory=lambda: Mirror(CELL, WALL))
    known: Known = field(default_factory=lambda: Known(CELL.name))
    now: float = 0.0

    def tell(self, **given: Any) -> dict[str, Any]:
        """Two snapshots, so that the cell is known to live; what changed."""
        for _ in range(2):
            self.now += 0.1
            self.known.take(snapshot(at=self.now, **given), self.now)
        return self.look()

    def look(self, later: float = 0.0) -> dict[str, Any]:
        self.now += later
        return self.mirror.update(self.known, self.now, WALL + self.now)


@pytest.fixture
def shop() -> Shop:
    return Shop()


@pytest.fixture
async def http(shop: Shop) -> AsyncIterator[httpx.AsyncClient]:
    transport = httpx.ASGITransport(Agent(shop.mirror, lambda: WALL + shop.now).app())
    async with httpx.AsyncClient(transport=transport, base_url="http://agent") as client:
        yield client


@pytest.mark.parametrize(
    ("state", "execution", "mode"),
    [
        ("OFFLINE", "STOPPED", None), ("UNHOMED", "STOPPED", "MANUAL"), ("IDLE", "READY", "AUTOMATIC"), ("HOMING", "ACTIVE", "MANUAL"),
        ("JOGGING", "ACTIVE", "MANUAL"), ("PURGING", "ACTIVE", "MANUAL"), ("PREPARING", "WAIT", "AUTOMATIC"), ("RUNNING", "ACTIVE", "AUTOMATIC"),
        ("HOLDING", "FEED_HOLD", "AUTOMATIC"), ("HELD", "FEED_HOLD", "AUTOMATIC"), ("RESUMING", "WAIT", "AUTOMATIC"),
        ("ABORTING", "INTERRUPTED", "AUTOMATIC"), ("FAULT", "INTERRUPTED", "AUTOMATIC"), ("STOPPED", "STOPPED", "AUTOMATIC"),
        ("RESETTING", "STOPPED", "MANUAL"),
    ],
)  # fmt: skip
def test_each_state_has_its_execution_and_mode(shop: Shop, state: str, execution: str, mode: str | None) -> None:
    shop.tell(state=state)
    assert (shop.mirror.values["execution"], shop.mirror.values["mode"]) == (execution, mode)


def test_the_rows_are_all_states() -> None:
    rows = test_each_state_has_its_execution_and_mode.pytestmark[0].args[1]
    assert {row[0] for row in rows} == set(State)


def test_an_idle_cell_after_a_completed_job_says_program_completed(shop: Shop) -> None:
    shop.tell(state="IDLE", job=JobView("job-1", "w", outcome="completed"))
    assert shop.mirror.values["execution"] == "PROGRAM_COMPLETED"


def test_values_are_those_of_the_cell_in_the_standards_units(shop: Shop) -> None:
    shop.tell()
    shown = {name: shop.mirror.values[name] for name in (
        "x_position", "c_angle", "feed", "feed_override", "laser_power", "laser_target", "powder", "carrier_gas", "hopper",
        "spindle_speed", "tool", "line", "estop", "door_state", "avail")}  # fmt: skip
    assert shown == {
        "x_position": "1.5", "c_angle": "90", "feed": "10", "feed_override": "80", "laser_power": "895.5", "laser_target": "900",
        "powder": "5.9", "carrier_gas": "0.1", "hopper": "50", "spindle_speed": "8000", "tool": "2", "line": "3", "estop": "ARMED",
        "door_state": "CLOSED", "avail": "AVAILABLE"}  # fmt: skip


def test_a_silent_cell_is_unavailable_within_two_seconds_and_comes_back(shop: Shop) -> None:
    shop.tell()
    shop.look(1.4)
    assert shop.mirror.values["avail"] == "AVAILABLE"
    shop.look(0.2)
    assert set(shop.mirror.values.values()) == {None}
    shop.known.take(shop.known.snapshot or snapshot(), shop.now)  # the service came back with what it last knew
    shop.look()
    assert shop.mirror.values["avail"] is None
    shop.tell()
    assert shop.mirror.values["avail"] == "AVAILABLE"


def test_the_first_snapshot_alone_says_nothing(shop: Shop) -> None:
    shop.known.take(snapshot(), 0.0)
    shop.look()
    assert shop.mirror.values["avail"] is None


def test_another_cells_snapshot_is_not_told(shop: Shop) -> None:
    shop.tell()
    shop.tell(cell="another")
    assert shop.mirror.values["avail"] is None


def test_a_silent_device_makes_its_own_items_unavailable_and_warns(shop: Shop) -> None:
    shop.tell(io=IoView(connected=True, age_s=3.0, estop_ok=True, door_closed=True))
    values = shop.mirror.values
    assert (values["estop"], values["door_state"], values["laser_power"]) == (None, None, "895.5")
    assert [(one.level, one.code) for one in values["communications"] or ()] == [("WARNING", "io_silent")]  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("code", "kind"),
    [("door", "SYSTEM"), ("laser_silent", "COMMUNICATIONS"), ("offline", "COMMUNICATIONS"), ("cnc_alarm", "LOGIC_PROGRAM"), ("estop", "SYSTEM")],
)
def test_each_alarm_belongs_to_one_condition(code: str, kind: str) -> None:
    assert condition_of(code) == kind


def test_completed_jobs_of_this_cell_are_counted_once(shop: Shop) -> None:
    shop.known.completed = {"job-0"}
    for job_id, state, cell in [("job-1", "completed", CELL.name)] * 2 + [("job-2", "running", CELL.name), ("job-3", "completed", "other")]:
        take(shop.known, LiveMessage("job", {"job": {"id": job_id, "state": state, "cell": cell}}, ""), 0.0)
    shop.tell()
    assert shop.mirror.values["parts"] == "2"


def test_a_snapshot_message_is_understood_as_the_service_sends_it(shop: Shop) -> None:
    for at in (1.0, 1.1):
        document = msgspec.json.decode(msgspec.json.encode({"type": "snapshot", "snapshot": snapshot(at)}))
        take(shop.known, LiveMessage("snapshot", document, ""), at)
    assert shop.known.fresh(1.2) == snapshot(1.1)


async def test_every_data_item_of_probe_is_in_the_standards_words(shop: Shop, http: httpx.AsyncClient) -> None:
    root = etree.fromstring((await http.get("/probe")).content)
    ns = {"m": "urn:mtconnect.org:MTConnectDevices:2.0"}
    items = root.findall(".//m:DataItem", ns)
    assert len(items) == len(shop.mirror.items) == len({item.get("id") for item in items})
    for item in items:
        category, units, sub_types, _ = STANDARD[item.get("type")]
        assert item.get("category") == category
        assert item.get("units") in (units or {None})
        assert item.get("subType") is None or item.get("subType") in sub_types
    axes = root.find(".//m:Axes/m:Components", ns)
    assert [(etree.QName(axis).localname, axis.get("name")) for axis in axes] == [
        ("Linear", "X"), ("Linear", "Y"), ("Linear", "Z"), ("Rotary", "A"), ("Rotary", "C"), ("Rotary", "S"),
    ]  # fmt: skip


async def test_current_has_one_observation_of_every_item_with_a_value_of_the_standard(shop: Shop, http: httpx.AsyncClient) -> None:
    shop.known.completed = set()
    shop.tell(alarms=[Alarm(1, 1.0, "door", "The <door> was opened \x07", "close it"), Alarm(2, 2.0, "gas_pressure", "Gas", "open it")])
    root = etree.fromstring((await http.get("/current")).content)
    ns = {"m": "urn:mtconnect.org:MTConnectStreams:2.0"}
    told = root.findall(".//*[@dataItemId]")
    assert {one.get("dataItemId") for one in told} == set(shop.mirror.by_id)
    for one in told:
        item = shop.mirror.by_id[one.get("dataItemId")]
        values = STANDARD[item.type][3]
        assert item.category == "CONDITION" or values is None or one.text in values
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", one.get("timestamp"))
        if item.category == "SAMPLE":
            float(one.text)
    faults = root.findall(".//m:Condition/m:Fault", ns)
    assert [(one.get("nativeCode"), one.get("type"), (one.text or "").strip()) for one in faults] == [
        ("door", "SYSTEM", "The <door> was opened"), ("gas_pressure", "SYSTEM", "Gas"),
    ]  # fmt: skip
    assert root.find(".//m:PathFeedrate", ns).text == "10"
    assert root.find(".//{urn:hybridcell:mtconnect:1}MassFlow[@subType='ACTUAL']").text == "5.9"


async def test_sample_goes_on_where_it_was_and_loses_nothing(shop: Shop, http: httpx.AsyncClient) -> None:
    shop.tell()
    seen: list[int] = []
    following = 1
    while True:
        root = etree.fromstring((await http.get(f"/{CELL.name}/sample", params={"from": following, "count": 7})).content)
        numbers = sorted(int(one.get("sequence")) for one in root.findall(".//*[@dataItemId]"))
        following = int(root[0].get("nextSequence"))
        if not numbers:
            break
        assert len(numbers) <= 7
        seen += numbers
    assert seen == list(range(1, shop.mirror.next_sequence))
    assert following == shop.mirror.next_sequence


@pytest.mark.parametrize(
    ("path", "status", "code"),
    [
        ("/sample?from=99999999", 400, "OUT_OF_RANGE"), ("/sample?count=0", 400, "OUT_OF_RANGE"), ("/sample?from=x", 400, "INVALID_REQUEST"),
        ("/sample?interval=100", 400, "UNSUPPORTED"), ("/other/current", 404, "NO_DEVICE"), ("/asset/none", 404, "ASSET_NOT_FOUND"),
        ("/a/b/c", 404, "INVALID_URI"),
    ],
)  # fmt: skip
async def test_what_cannot_be_answered_is_refused_in_an_error_document(http: httpx.AsyncClient, path: str, status: int, code: str) -> None:
    answer = await http.get(path)
    root = etree.fromstring(answer.content)
    found = root.find(".//{urn:mtconnect.org:MTConnectError:2.0}Error")
    assert (answer.status_code, found.get("errorCode")) == (status, code)


async def test_the_cutters_are_assets(http: httpx.AsyncClient) -> None:
    root = etree.fromstring((await http.get("/asset")).content)
    ns = {"m": "urn:mtconnect.org:MTConnectAssets:2.0"}
    cutters = [tool for tool in CELL.tools if tool.kind != "deposition"]
    assert [one.text for one in root.findall(".//m:CuttingDiameterMax", ns)] == [f"{tool.diameter_mm:g}" for tool in cutters]


def read_shdr(line: str) -> dict[str, tuple[str, ...]]:
    """One line as the protocol's text has it: time, then key and value; an item's own form gives the rest."""
    at, key, *rest = re.split(r"(?<!\\)\|", line)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", at)
    return {key: tuple(rest)}


async def test_an_agent_on_a_plain_socket_gets_everything_then_changes_and_pongs(shop: Shop) -> None:
    shop.tell()
    adapter = Adapter(shop.mirror, lambda: WALL + shop.now)
    server = await asyncio.start_server(adapter.serve, "127.0.0.1", 0)
    async with asyncio.timeout(5), server:
        reader, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
        writer.write(b"* PING\r\n")
        greeting = []
        while (line := (await reader.readline()).decode().rstrip("\n")) != "* PONG 10000":
            greeting.append(line)
        asset = next(index for index, line in enumerate(greeting) if "|@ASSET@|" in line)
        tag = greeting[asset].split("|")[-1]
        end = greeting.index(tag, asset + 1)
        assert etree.fromstring("\n".join(greeting[asset + 1 : end])).tag == "CuttingTool"
        plain = [line for line in greeting if line.startswith("2023-") and "@ASSET@" not in line]
        told = {key: rest for line in plain for key, rest in read_shdr(line).items()}
        assert set(told) == set(shop.mirror.by_id)
        assert (told["execution"], told["logic"], told["program"]) == (("ACTIVE",), ("NORMAL", "", "", "", ""), (r'"one \| block"',))
        adapter.tell(shop.tell(alarms=[Alarm(1, 1.0, "door", "The door\nwas opened", "close")], state="FAULT"))
        news = [read_shdr((await reader.readline()).decode().rstrip("\n")) for _ in range(2)]
        assert {"system": ("FAULT", "door", "", "", "The door was opened")} in news
        assert {"execution": ("INTERRUPTED",)} in news
        adapter.tell(shop.look(1.6))
        gone = {key: rest for _ in shop.mirror.items[:-1] for key, rest in read_shdr((await reader.readline()).decode().rstrip()).items()}
        assert {rest[0] or rest[1] for rest in gone.values()} == {"UNAVAILABLE"}
        writer.close()
        await writer.wait_closed()
        adapter.close()


@pytest.mark.parametrize("text", ["a|b", "a\nb", "\x00", "line\r\n* PONG 1", "x\u2028y"])
def test_text_ends_neither_its_field_nor_its_line(text: str) -> None:
    line = clean(text)
    assert len(line.splitlines()) <= 1
    assert not re.search(r"(?<!\\)\|", line)


async def test_the_process_listens_on_both_ports_and_leaves_nothing(shop: Shop) -> None:
    ports: asyncio.Future[tuple[int, int | None]] = asyncio.get_running_loop().create_future()
    task = asyncio.create_task(run(shop.known, shop.mirror, Listening("127.0.0.1", 0, 0), lambda a, b: ports.set_result((a, b))))
    async with asyncio.timeout(10):
        adapter, agent = await ports
        async with httpx.AsyncClient(trust_env=False) as client:
            answer = await client.get(f"http://127.0.0.1:{agent}/current")
        assert b"UNAVAILABLE" in answer.content
        reader, writer = await asyncio.open_connection("127.0.0.1", adapter)
        assert (await reader.readline()).startswith(b"* shdrVersion")
        writer.close()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
