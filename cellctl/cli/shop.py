"""Commands that connect the cell to the shop: mtconnect, opcua."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cellctl.cli import output
from cellctl.cli.input import DEFAULT_CELL, DEFAULT_RUN, CellName, InputFault, Json, RunFolder, Url, connect

Host = Annotated[str, typer.Option("--host", help="Where to listen. Beyond loopback whoever reaches it can read what the cell does.")]
Probe = Annotated[Path | None, typer.Option("--devices", help="Write Devices.xml for an agent of the shop there, and end.")]


def _say(text: str) -> None:
    typer.echo(f"cellctl: {text}", err=True)


def mtconnect(
    cell: CellName = DEFAULT_CELL,
    url: Url = None,
    run: RunFolder = DEFAULT_RUN,
    host: Host = "127.0.0.1",
    adapter_port: Annotated[int, typer.Option("--adapter-port", min=0, max=65535, help="Of the SHDR adapter.")] = 7878,
    agent_port: Annotated[int, typer.Option("--agent-port", min=0, max=65535, help="Of the agent's HTTP answers.")] = 5000,
    no_agent: Annotated[bool, typer.Option("--no-agent", help="Only the adapter: the shop has an agent.")] = False,
    devices: Probe = None,
    json: Json = False,
) -> None:
    """Tell the shop what the cell does by MTConnect: an adapter (SHDR) and a small agent (HTTP). Needs a viewer's token (CELLCTL_TOKEN)."""
    import asyncio
    import time

    from cellctl.shop import mtconnect as shop
    from cellctl.shop.follow import follow
    from cellctl.shop.freshness import Known
    from cellctl.shop.mirror import Mirror
    from cellctl.shop.mtconnect_xml import devices as devices_xml
    from config.cell import load_cell

    facts = load_cell(cell)
    mirror = Mirror(facts, time.time())
    if devices is not None:
        devices.write_bytes(devices_xml(mirror, time.time()))
        output.line(f"{devices}: {len(mirror.items)} data items of {facts.name}")
        return

    def ready(adapter: int, agent: int | None) -> None:
        if json:
            output.as_json({"adapter_port": adapter, "agent_port": agent})
            return
        output.line(f"adapter (SHDR)  {host}:{adapter}")
        if agent is not None:
            output.line(f"agent           http://{host}:{agent}/probe")

    known = Known(facts.name)
    with connect(url, run) as client:
        follow(known, client, _say)
        where = shop.Listening(host, adapter_port, None if no_agent else agent_port)
        try:
            asyncio.run(shop.run(known, mirror, where, ready))
        except OSError as error:
            raise InputFault(f"cannot listen on {host}: {error.strerror or error}", "choose other ports") from None
        except KeyboardInterrupt:
            return
