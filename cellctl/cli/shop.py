"""Commands that connect the cell to the shop: mtconnect, opcua."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cellctl.cli import output
from cellctl.cli.input import (
    DEFAULT_CELL,
    DEFAULT_RUN,
    CellName,
    InputFault,
    Json,
    RunFolder,
    Url,
    connect,
    existing_file,
)

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


def opcua(
    cell: CellName = DEFAULT_CELL,
    url: Url = None,
    run: RunFolder = DEFAULT_RUN,
    host: Host = "127.0.0.1",
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Of the server.")] = 4840,
    cert: Annotated[Path | None, typer.Option("--cert", help="Certificate (PEM): sign & encrypt (Basic256Sha256) is offered.")] = None,
    key: Annotated[Path | None, typer.Option("--key", help="Its key (PEM).")] = None,
    plain: Annotated[bool, typer.Option("--plain", help="Beyond loopback also without security: tokens can be read on the network.")] = False,
    anonymous: Annotated[bool, typer.Option("--anonymous", help="Whoever reaches it may read, without a token.")] = False,
) -> None:
    """Tell the shop what the cell does by OPC UA for Machine Tools, read only. Clients sign in with a token of the service as password."""
    import asyncio
    import time

    from cellctl.api.security import is_loopback
    from cellctl.client import Client, ServiceError
    from cellctl.shop.follow import follow
    from cellctl.shop.freshness import Known
    from config.cell import load_cell

    try:
        from cellctl.shop import opcua as shop
    except ModuleNotFoundError:
        raise InputFault("the OPC UA server needs asyncua", "install the extra: pip install 'hybridcell[opcua]'") from None
    if (cert is None) != (key is None):
        raise InputFault("--cert and --key belong together", "give both, as PEM files")
    if cert is not None and key is not None:
        existing_file(cert, "certificate")
        existing_file(key, "key")
    elif not is_loopback(host) and not plain:
        raise InputFault(f"{host} can be reached from other machines", "give --cert and --key, or say --plain on a network that you trust")
    facts = load_cell(cell)
    known = Known(facts.name)
    started = time.monotonic()
    with connect(url, run) as client:

        def may(token: str) -> bool:
            if not token.isascii() or not token.isprintable():
                return False
            try:
                with Client(client.url, token, verify=client.verify) as asking:
                    asking.get("cell/events", limit=1)
            except ServiceError:
                return False
            return True

        wire = shop.Wire(host, port, cert, key, plain or is_loopback(host), anonymous, may)
        follow(known, client, _say)
        try:
            ready = f"OPC UA  opc.tcp://{host}:{port}/cell"
            asyncio.run(shop.run(shop.MachineServer(facts, wire), known, lambda: output.line(f"{ready}  ({time.monotonic() - started:.0f} s)")))
        except OSError as error:
            raise InputFault(f"cannot listen on {host}:{port}: {error.strerror or error}", "choose another port") from None
        except KeyboardInterrupt:
            return
