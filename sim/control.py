"""The control socket of a simulated cell: JSON lines in, JSON lines out, for tests, scripts and the demo."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any

from sim.fault_kinds import KINDS
from sim.faults import Faults, FaultScriptError
from sim.world import World

LOG = logging.getLogger(__name__)
SOCKET_PATH_MAX = 107  # sun_path holds 108 bytes
HANDS = ("open_door", "close_door", "press_estop", "release_estop")

Answer = dict[str, Any]
Extra = Callable[[dict[str, Any]], Awaitable[Answer]]


class CommandError(Exception):
    """A control command that cannot be carried out; the text is one line."""


class Control:
    """Serves `path`. Commands: {"do": "state"}, "fault" (with "fault": text), the HANDS, and those of `extras`."""

    def __init__(self, world: World, path: Path, extras: Mapping[str, Extra]) -> None:
        self._world, self._path, self._extras = world, path, extras
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[Any]] = set()

    async def open(self) -> None:
        """Open the socket, readable by its owner only."""
        self._path.unlink(missing_ok=True)
        self._server = await asyncio.start_unix_server(self._serve, str(self._path))
        self._path.chmod(0o600)

    async def close(self) -> None:
        """Close the socket and remove it."""
        if self._server is None:
            return
        self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._path.unlink(missing_ok=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        if task is not None:
            self._tasks.add(task)
        try:
            while line := await reader.readline():
                writer.write(json.dumps(await self._answer(line)).encode() + b"\n")
                await writer.drain()
        except ConnectionError:
            return
        finally:
            writer.close()
            if task is not None:
                self._tasks.discard(task)

    async def _answer(self, line: bytes) -> Answer:
        try:
            command = json.loads(line)
            if not isinstance(command, dict):
                raise CommandError("a command is a JSON object with 'do'")
            return {"ok": True, **await self._carry_out(command)}
        except json.JSONDecodeError as error:
            return {"ok": False, "error": f"not JSON: {error}"}
        except FaultScriptError as error:
            return {"ok": False, "error": error.message, "hint": error.hint}
        except CommandError as error:
            return {"ok": False, "error": str(error)}
        except (ValueError, TypeError, KeyError) as error:
            return {"ok": False, "error": f"a value cannot be used: {error}"}
        except Exception as error:  # a connection's edge: the cell goes on, the asker is told
            LOG.exception("control command failed")
            return {"ok": False, "error": f"{type(error).__name__}: {error}"}

    async def _carry_out(self, command: dict[str, Any]) -> Answer:
        do = str(command.get("do"))
        world = self._world
        if do == "state":
            return state_of(world)
        if do == "fault":
            fault = world.faults.add(str(command.get("fault", "")))
            if fault.at_s is None and fault.line is None:
                world.faults.strike(world)
            return {"fault": str(fault)}
        if do in HANDS:
            getattr(world, do)()
            return {}
        if do in self._extras:
            return await self._extras[do](command)
        known = ", ".join(["state", "fault", *HANDS, *self._extras])
        raise CommandError(f"do={do!r} is unknown; known: {known}")


def state_of(world: World) -> Answer:
    """What one would see standing before the cell, in plain numbers."""
    cnc, machine = world.cnc, world.cnc.machine
    name, substate = cnc.state
    faults: Faults = world.faults
    return {
        "time_s": world.time_s,
        "time_scale": world.time_scale,
        "cnc": {
            "state": name if substate is None else f"{name}:{substate}",
            "joints": world.joints.tolist(),
            "line": machine.motion.line,
            "tool": machine.tool,
            "spindle_rpm": machine.spindle_rpm,
        },
        "tip_mm": world.tip_position.tolist(),
        "tip_speed_mm_s": world.tip_speed_mm_s,
        "laser": {**world.laser.values, "emission_w": world.laser.emission_w, "pilot_lit": world.laser.is_pilot_lit, "faults": world.laser.faults},
        "feeder": {**world.feeder.values, "rate_at_nozzle_g_min": world.feeder.rate_at_nozzle_g_min},
        "io": dict(world.io.values),
        "faults_pending": [str(fault) for fault in faults.pending],
        "faults_past": [str(fault) for fault in faults.past],
        "fault_kinds": sorted(KINDS),
    }
