"""Why a Modbus device is not heard in time: it is silent or slow itself, or another one is that shares its line."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.errors import LinkError
from drivers.modbus.device import DeviceClient

SLOW = 3.0  # times what the register map says of a request


def why_late(role: str, clients: Mapping[str, DeviceClient]) -> tuple[str, str]:
    """(role, why) of the device that is at fault when `role` is not heard, or does not hear, in time; "" where nothing is known.

    clients : every device of the cell, by role
    """
    own = clients[role]
    sharing = {other: client for other, client in clients.items() if client.turn is own.turn}
    if own.last_error is not None:
        if own.link.connected or len(sharing) == 1:
            return role, own.last_error.message
        names = ", ".join(client.device.name for client in sharing.values())
        return next(iter(sharing)), f"{own.last_error.message}; it is the line of {names}"
    for other, client in sharing.items():
        if isinstance(client.last_error, LinkError):
            return other, f"{client.last_error.message}; {own.device.name} waits for it on the line that they share"
    slowest = max(sharing, key=lambda other: _slowness(sharing[other]))
    if _slowness(sharing[slowest]) < SLOW:
        return role, ""
    text = f"{sharing[slowest].device.name} takes {1e3 * _takes_s(sharing[slowest]):.0f} ms for an answer"
    return slowest, text if slowest == role else f"{text}; {own.device.name} waits for it on the line that they share"


def _takes_s(client: DeviceClient) -> float:
    return max(client.latency.read.longest_s, client.latency.write.longest_s)


def _slowness(client: DeviceClient) -> float:
    """Its longest request of late, in what its register map says of one."""
    return _takes_s(client) / client.device.latency_s
