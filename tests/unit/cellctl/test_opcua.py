"""OPC UA for machine tools: read by a client over TCP, in the standard's words; silence is bad quality; nobody can write."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import pytest
import pytest_asyncio

pytest.importorskip("asyncua")
from asyncua import Client, Node, ua

from cellctl.domain.snapshot import Alarm, CncView, IoView, JobView, LaserView, OverridesView, Snapshot
from cellctl.domain.states import State
from cellctl.shop.opcua import DI, MACHINE_TOOL, MACHINERY, OWN_URI, MachineServer, Wire
from cellctl.shop.opcua_words import STATES
from config.cell import load_cell

CELL = load_cell("trunnion_tcp")
TOKEN = "hc_good"
pytestmark = pytest.mark.asyncio(loop_scope="module")


def snapshot(**other: Any) -> Snapshot:
    given: dict[str, Any] = {
        "seq": 1, "at": 1.0, "cell": CELL.name, "mode": "sim", "state": "RUNNING", "execution": "ACTIVE", "job": JobView("job-1", "one block"),
        "overrides": OverridesView(feed_percent=80), "io": IoView(connected=True, age_s=0.1, estop_ok=True, door_closed=True),
        "laser": LaserView(connected=True, age_s=0.1, enabled=True, emitting=True, power_setpoint_w=900.0, power_readback_w=890.0),
        "cnc": CncView(connected=True, age_s=0.1, machine={"X": 1.5}, spindle_rpm=0.0),
    }  # fmt: skip
    return Snapshot(**{**given, **other})


class Reader:
    """A client's view of the machine, found by browsing from the standard's entry point."""

    def __init__(self, made: MachineServer, client: Client) -> None:
        self.made, self.client = made, client
        self.index: dict[str, int] = {}

    async def find(self) -> None:
        uris = await self.client.get_namespace_array()
        self.index = {"": 0, "mt": uris.index(MACHINE_TOOL), "m": uris.index(MACHINERY), "di": uris.index(DI), "own": uris.index(OWN_URI)}
        machines = await self.client.nodes.objects.get_child(f"{self.index['m']}:Machines")
        self.machine = await machines.get_child(f"{self.index['own']}:{CELL.name}")

    async def node(self, path: str) -> Node:
        """As in mt:Monitoring/mt:Channel."""
        names = [f"{self.index[space]}:{name}" for space, name in (part.split(":") for part in path.split("/"))]
        return await self.machine.get_child(names)

    async def value(self, path: str) -> Any:
        return await (await self.node(path)).read_value()

    async def status(self, path: str) -> str:
        found = await (await self.node(path)).read_data_value(raise_on_bad_status=False)
        assert found.StatusCode is not None
        return found.StatusCode.name


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def reader() -> AsyncIterator[Reader]:
    made = MachineServer(CELL, Wire("127.0.0.1", 0, None, None, plain=True, anonymous=False, may=lambda token: token == TOKEN))
    await made.build()
    async with made.server:
        client = Client(url_of(made))
        client.set_user("shop")
        client.set_password(TOKEN)
        async with client:
            found = Reader(made, client)
            await found.find()
            yield found


def url_of(made: MachineServer) -> str:
    assert made.server.bserver is not None and made.server.bserver._server is not None
    return f"opc.tcp://127.0.0.1:{made.server.bserver._server.sockets[0].getsockname()[1]}/cell"


async def test_the_machine_is_a_machine_tool_with_identification(reader: Reader) -> None:
    kind = await reader.machine.read_type_definition()
    assert (await reader.client.get_node(kind).read_browse_name()) == ua.QualifiedName("MachineToolType", reader.index["mt"])
    assert await reader.value("di:Identification/di:SerialNumber") == CELL.name


async def test_values_are_those_of_the_cell(reader: Reader) -> None:
    await reader.made.update(snapshot())
    assert await reader.value("mt:Monitoring/mt:MachineTool/mt:OperationMode") == 1
    assert await reader.value("mt:Monitoring/mt:Channel/mt:ChannelState") == 0
    assert await reader.value("mt:Monitoring/mt:Channel/mt:FeedOverride") == 80.0
    assert await reader.value("mt:Monitoring/mt:Laser/mt:LaserState") == 2
    assert await reader.value("mt:Monitoring/mt:Spindle/mt:IsRotating") is False
    assert await reader.value("mt:Production/mt:ActiveProgram/mt:Name") == "one block"
    assert (await reader.value("mt:Production/mt:ActiveProgram/mt:State/:CurrentState")).Text == "Running"
    assert await reader.value("own:Process/own:LaserPowerReadback_W") == 890.0
    assert await reader.value("own:Process/own:AxisX") == 1.5


async def test_a_silent_cell_is_of_bad_quality_everywhere_and_comes_back(reader: Reader) -> None:
    await reader.made.update(snapshot())
    await reader.made.update(None)
    for path in ("mt:Monitoring/mt:Channel/mt:ChannelState", "mt:Production/mt:ActiveProgram/mt:State/:CurrentState", "own:Process/own:State"):
        assert await reader.status(path) == "BadNoCommunication"
    await reader.made.update(snapshot())
    assert await reader.status("own:Process/own:State") == "Good"


async def test_a_silent_device_makes_its_own_variables_bad(reader: Reader) -> None:
    await reader.made.update(snapshot(laser=LaserView(connected=True, age_s=3.0)))
    assert await reader.status("own:Process/own:LaserPowerReadback_W") == "BadNoCommunication"
    assert await reader.status("own:Process/own:DoorClosed") == "Good"


async def test_an_alarm_is_an_alert_with_its_code(reader: Reader) -> None:
    class Heard:
        def __init__(self) -> None:
            self.events: asyncio.Queue[Any] = asyncio.Queue()

        def event_notification(self, event: Any) -> None:
            self.events.put_nowait(event)

    heard = Heard()
    subscription = await reader.client.create_subscription(50, heard)
    kind = reader.client.get_node(ua.NodeId(39, reader.index["mt"]))
    await subscription.subscribe_events(await reader.node("mt:Notification/mt:Messages"), kind)
    await reader.made.update(snapshot(state="FAULT", alarms=[Alarm(7, 1.0, "door", "The door was opened", "Close it")]))
    async with asyncio.timeout(5):
        event = await heard.events.get()
    await subscription.delete()
    assert (event.ErrorCode, event.Message.Text, event.Severity) == ("door", "The door was opened. Close it", 800)
    assert await reader.value("own:Process/own:Alarms") == ["door: The door was opened"]


async def test_nobody_can_write(reader: Reader) -> None:
    await reader.made.update(snapshot())
    for path in ("mt:Monitoring/mt:Channel/mt:FeedOverride", "own:Process/own:LaserPowerSetpoint_W"):
        with pytest.raises(ua.UaStatusCodeError):
            await (await reader.node(path)).write_value(10.0)


@pytest.mark.parametrize(("user", "password"), [(None, None), ("shop", "wrong"), ("admin", "")])
async def test_without_a_token_of_the_service_nobody_reads(reader: Reader, user: str | None, password: str | None) -> None:
    client = Client(url_of(reader.made))
    if user is not None:
        client.set_user(user)
        client.set_password(password or "")
    with pytest.raises((ua.UaStatusCodeError, ua.UaError)):
        async with client:
            pass


async def test_every_state_has_its_row() -> None:
    assert set(STATES) == set(State)
