"""The OPC UA process: the official type model (nodesets of the OPC Foundation), one machine of MachineToolType, read only."""

from __future__ import annotations

import asyncio
import gzip
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from asyncua import ua
from asyncua.common.node import Node
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.server import Server
from asyncua.ua.status_codes import StatusCodes

from cellctl.domain.snapshot import Snapshot
from cellctl.shop.freshness import Known
from cellctl.shop.opcua_words import OWN, STANDARD, Plain, Variable, axes, program_state
from config.cell import Cell

OWN_URI = "urn:hybridcell:opcua:cell"
APPLICATION_URI = "urn:hybridcell:opcua:server"
MACHINE_TOOL, MACHINERY, DI = (f"http://opcfoundation.org/UA/{name}/" for name in ("MachineTool", "Machinery", "DI"))
MACHINES = 1001  # of Machinery
TYPES = {"MachineTool": 13, "Channel": 16, "Spindle": 22, "Laser": 36, "Messages": 5, "StateMachine": 24, "Alert": 39}  # of MachineTool
EMPTY: dict[str, Plain] = {"Boolean": False, "Double": 0.0, "UInt32": 0, "String": "", "String[]": []}  # for the node's type; never told
LOOK_S = 0.1
SEVERITY = 800  # of a latched fault; 1 to 1000


def node_id(identifier: int | str, namespace: int) -> ua.NodeId:
    """A node's id, numeric or by name."""
    return ua.NodeId(ua.Int32(identifier) if isinstance(identifier, int) else ua.String(identifier), ua.Int16(namespace))


@dataclass(frozen=True)
class Wire:
    """How it is reached. cert, key : PEM, then sign & encrypt is offered; plain : without security too; may : whether a token is good"""

    host: str
    port: int
    cert: Path | None
    key: Path | None
    plain: bool
    anonymous: bool
    may: Callable[[str], bool]


class People:
    """Who may read: the service's tokens as password (the user name does not matter), or anybody where that is said."""

    def __init__(self, wire: Wire) -> None:
        self.wire = wire

    def get_user(self, iserver: Any, username: str | None = None, password: str | None = None, certificate: Any = None) -> User | None:
        """A reader, or None: refused."""
        if username is None:
            return User(role=UserRole.User, name="anonymous") if self.wire.anonymous else None
        return User(role=UserRole.User, name=username) if password and self.wire.may(password) else None


class MachineServer:
    """The server with its one machine."""

    def __init__(self, cell: Cell, wire: Wire) -> None:
        self.cell, self.wire = cell, wire
        self.server = Server(user_manager=People(wire))  # type: ignore[arg-type]
        self.variables: dict[Variable, Node] = {}
        self._told: dict[Variable, Plain] = {}
        self._program: str | None = ""
        self._alarms: set[int] = set()

    async def build(self) -> None:
        """Load the type model and make the machine; everything is of bad quality until the cell is heard."""
        server = self.server
        await server.init()
        server.set_endpoint(f"opc.tcp://{self.wire.host}:{self.wire.port}/cell")
        server.set_server_name("hybrid metal cell")
        await server.set_application_uri(APPLICATION_URI)
        await self._secure()
        await load_types(server)
        self.own = await server.register_namespace(OWN_URI)
        self.mt, self.machinery, self.di = [await server.get_namespace_index(uri) for uri in (MACHINE_TOOL, MACHINERY, DI)]
        await self._make()
        await self.update(None)

    async def _secure(self) -> None:
        policies = [ua.SecurityPolicyType.NoSecurity] if self.wire.plain else []
        if self.wire.cert is not None and self.wire.key is not None:
            await self.server.load_certificate(self.wire.cert)
            await self.server.load_private_key(self.wire.key)
            policies.append(ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt)
        self.server.set_security_policy(policies)
        tokens = [ua.UserNameIdentityToken, *([ua.AnonymousIdentityToken] if self.wire.anonymous else [])]
        self.server.set_identity_tokens(tokens)

    async def _object(self, parent: Node, name: str, kind: str) -> Node:
        type_id = node_id(TYPES[kind], self.mt)
        return await parent.add_object(ua.NodeId(), ua.QualifiedName(name, self.mt), type_id, instantiate_optional=False)

    async def _make(self) -> None:
        """The machine with the parts of the standard that it fills, and what is its own."""
        machines = self.server.get_node(node_id(MACHINES, self.machinery))
        type_id = node_id(TYPES["MachineTool"], self.mt)
        named = ua.QualifiedName(self.cell.name, self.own)
        self.machine = await machines.add_object(node_id(self.cell.name, self.own), named, type_id, instantiate_optional=False)
        monitoring = await self.child("Monitoring")
        for name in ("Channel", "Spindle", "Laser"):
            made = await self._object(monitoring, name, name)
            await (await made.get_child(f"{self.mt}:Name")).write_value(name)
        program = await self.child("Production/ActiveProgram")
        await program.add_variable(ua.NodeId(), ua.QualifiedName("JobIdentifier", self.mt), "", ua.VariantType.String)
        self.messages = await self._object(await self.child("Notification"), "Messages", "Messages")
        name = self.cell.name
        identity = {"Manufacturer": ua.LocalizedText("hybrid cell"), "ProductInstanceUri": f"{OWN_URI}:{name}", "SerialNumber": name}
        for name, value in identity.items():
            await (await self.machine.get_child([f"{self.di}:Identification", f"{self.di}:{name}"])).write_value(value)
        for one in STANDARD:
            self.variables[one] = await self.child(one.path)
        process = await self.machine.add_object(ua.NodeId(), ua.QualifiedName("Process", self.own))
        for one in (*OWN, *axes(self.cell.letters)):
            kind = ua.VariantType[one.kind.removesuffix("[]")]
            named = ua.QualifiedName(one.path.split("/")[1], self.own)
            self.variables[one] = await process.add_variable(ua.NodeId(), named, ua.Variant(EMPTY[one.kind], kind), kind)
        states = self.server.get_node(node_id(TYPES["StateMachine"], self.mt))
        names = ("Initializing", "Running", "Interrupted", "Aborted", "Ended")
        self.states = {name: (await states.get_child(f"{self.mt}:{name}")).nodeid for name in names}
        self.current = await (await self.child("Production/ActiveProgram/State")).get_child("0:CurrentState")
        self.current_id = await self.current.get_child("0:Id")
        self.alert = await self.server.get_event_generator(node_id(TYPES["Alert"], self.mt), self.messages.nodeid)

    async def child(self, path: str) -> Node:
        """A node of the standard below the machine."""
        names = [f"0:{name}" if name == "NumberInList" else f"{self.mt}:{name}" for name in path.split("/")]
        return await self.machine.get_child(names)

    async def update(self, snapshot: Snapshot | None) -> None:
        """Tell what changed; None: nothing is known, everything is of bad quality."""
        for one, node in self.variables.items():
            value = None if snapshot is None else one.read(snapshot)
            if one not in self._told or self._told[one] != value:
                self._told[one] = value
                await self._write(node, value, ua.VariantType[one.kind.removesuffix("[]")])
        state = None if snapshot is None else program_state(snapshot)
        if state != self._program:
            self._program = state
            await self._write(self.current, None if state is None else ua.LocalizedText(state), ua.VariantType.LocalizedText)
            await self._write(self.current_id, None if state is None else self.states[state], ua.VariantType.NodeId)
        await self._alert(snapshot)

    async def _alert(self, snapshot: Snapshot | None) -> None:
        """An event for every alarm that is new."""
        if snapshot is None:
            return
        for one in snapshot.alarms:
            if one.id not in self._alarms:
                self.alert.event.add_property("ErrorCode", one.code, ua.VariantType.String)
                self.alert.event.add_property("Severity", SEVERITY, ua.VariantType.UInt16)
                await self.alert.trigger(message=f"{one.cause}. {one.remedy}")
        self._alarms = {one.id for one in snapshot.alarms}

    async def _write(self, node: Node, value: Any, kind: ua.VariantType) -> None:
        status = StatusCodes.Good if value is not None else StatusCodes.BadNoCommunication
        told = ua.DataValue(ua.Variant(value, kind) if value is not None else ua.Variant(), ua.StatusCode(ua.UInt32(status)))
        await self.server.write_attribute_value(node.nodeid, told)


async def load_types(server: Server) -> None:
    """The OPC Foundation's nodesets, in the order in which one needs the other."""
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # it tells of references that these nodesets leave open
    for file in sorted(resources.files("cellctl.shop").joinpath("nodesets").iterdir(), key=lambda one: one.name):
        if file.name.endswith(".gz"):
            await server.import_xml(xmlstring=gzip.decompress(file.read_bytes()).decode("utf-8-sig"), strict_mode=False)


async def run(made: MachineServer, known: Known, ready: Callable[[], None]) -> None:
    """Serve until cancelled. Raises OSError for a port that is taken."""
    await made.build()
    async with made.server:
        ready()
        while True:
            await made.update(known.fresh(time.monotonic()))
            await asyncio.sleep(LOOK_S)
