"""Commands that run things: demo, serve, sim."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellctl.cli import output
from cellctl.cli.input import (
    DEFAULT_CELL,
    DEFAULT_RUN,
    DEFAULT_STORE,
    CellName,
    InputFault,
    Json,
    RunFolder,
    StoreFolder,
)

if TYPE_CHECKING:
    from cellctl.planning.pool.wire import PoolWire
    from cellctl.store.shared import Wanted
    from cellctl.supervise import Address

Port = Annotated[
    int | None,
    typer.Option(
        "--port", min=0, max=65535, help="Of console and REST; 0 for any free one. Default: as the cell file says."
    ),
]


def demo(
    cell: CellName = DEFAULT_CELL,
    time_scale: Annotated[
        float, typer.Option("--time-scale", min=0.1, max=200.0, help="Process time per wall time.")
    ] = 25.0,
    keep: Annotated[bool, typer.Option("--keep", help="Leave everything up afterwards, until Ctrl-C.")] = False,
    out: Annotated[Path, typer.Option("--out", help="Where the demo keeps its store and results.")] = Path(
        ".cellctl/demo"
    ),
    json: Json = False,
) -> None:
    """A simulated cell builds a part: upload, plan, post, prove, approve, run, measured result."""
    from cellctl.demo import Demo

    raise typer.Exit(Demo(cell, time_scale, out, keep=keep, as_json=json).run())


def serve(
    cell: CellName = DEFAULT_CELL,
    store: StoreFolder = DEFAULT_STORE,
    run: RunFolder = DEFAULT_RUN,
    host: Annotated[str | None, typer.Option("--host", help="Default: as the cell file says (loopback).")] = None,
    port: Port = None,
    stop_port: Annotated[
        int | None, typer.Option("--stop-port", min=0, max=65535, help="Of the cell process's STOP listener.")
    ] = None,
    upload_limit_mb: Annotated[float, typer.Option("--upload-limit-mb", min=1.0, help="Largest part file.")] = 200.0,
    worker_memory_mb: Annotated[
        float, typer.Option("--worker-memory-mb", min=512.0, help="Address space of a planning worker.")
    ] = 8192.0,
    tls_cert: Annotated[
        Path | None, typer.Option("--tls-cert", help="Certificate (PEM) of console, REST and STOP; its names are those of the service.")
    ] = None,
    tls_key: Annotated[Path | None, typer.Option("--tls-key", help="Its key (PEM, without passphrase).")] = None,
    plain: Annotated[bool, typer.Option("--plain", help="Serve other machines without TLS: passwords can be read on the network.")] = False,
    behind_proxy: Annotated[
        str, typer.Option("--behind-proxy", metavar="ADDRESS", help="A proxy there does the TLS; its X-Forwarded-For and -Proto are believed.")
    ] = "",
    stop_url: Annotated[str, typer.Option("--stop-url", help="Behind a proxy: where pages reach the STOP listener.")] = "",
    name: Annotated[list[str] | None, typer.Option("--name", help="A host name that the service is called by; again for more.")] = None,
    planning_scheduler: Annotated[
        str, typer.Option("--planning-scheduler", metavar="ADDRESS", help="Plan on the machines of a pool: its scheduler, as in tls://host:8786.")
    ] = "",
    planning_cert: Annotated[Path | None, typer.Option("--planning-cert", help="The service's certificate (PEM) in the pool.")] = None,
    planning_key: Annotated[Path | None, typer.Option("--planning-key", help="Its key (PEM, without passphrase).")] = None,
    planning_ca: Annotated[Path | None, typer.Option("--planning-ca", help="Who signed the pool's certificates. Default: the certificate.")] = None,
    planning_plain: Annotated[
        bool, typer.Option("--planning-plain", help="A pool without TLS beyond this machine: whoever reaches its scheduler can run code here.")
    ] = False,
    shared_database: Annotated[
        str, typer.Option("--shared-database", metavar="URL", help="PostgreSQL database that several cells share; @FILE: its URL is in that file.")
    ] = "",
    shared_files: Annotated[
        Path | None, typer.Option("--shared-files", help="Folder, seen by all hosts, of the files that they share.")
    ] = None,
    json: Json = False,
) -> None:
    """Run the service: the cell process, the web process with the console, and the planning workers."""
    import asyncio

    from cellctl.reach import Wire
    from cellctl.supervise import Options, Supervisor

    wire = Wire(tls_cert, tls_key, plain, behind_proxy, stop_url, tuple(name or ()))
    pool = _pool(planning_scheduler, planning_cert, planning_key, planning_ca, planning_plain)
    shared = _shared(shared_database, shared_files)
    options = Options(cell, store, run, host, port, stop_port, upload_limit_mb, worker_memory_mb, wire, pool, shared)
    asyncio.run(Supervisor(options, _say, partial(_tell_ready, store, run, json)).run())


def _pool(scheduler: str, cert: Path | None, key: Path | None, ca: Path | None, plain: bool) -> PoolWire | None:
    """How a planning pool is reached, None without one. Raises InputFault."""
    from cellctl.planning.pool.wire import PoolWire

    if scheduler:
        return PoolWire(scheduler, cert, key, ca, plain)
    if cert or key or ca or plain:
        raise InputFault("options of a planning pool are given without its scheduler", "give --planning-scheduler ADDRESS")
    return None


def _shared(database: str, files: Path | None) -> Wanted | None:
    """What the store shares by the command line, None if that says nothing. Raises InputFault."""
    from cellctl.store.shared import Wanted

    if bool(database) != (files is not None):
        raise InputFault("a store is shared by its database and its files", "give both --shared-database URL and --shared-files DIR")
    return Wanted(database, files) if files is not None else None


def _say(text: str) -> None:
    typer.echo(f"cellctl: {text}", err=True)


def _tell_ready(store: Path, run: Path, json: bool, address: Address, secret: str | None) -> None:
    """Where the service is, and what is left to do. secret : the first token, on the first start"""
    from cellctl.first_start import has_admin
    from cellctl.store.shared import shared_of

    if json:
        output.as_json({"url": address.url, "stop_port": address.stop_port, "operator_token": secret})
        return
    output.line(f"console and REST  {address.url}")
    output.line(f"store             {store}    run directory  {run}")
    if (shared := shared_of(store)) is not None:
        output.line(f"shared            {shared.database.render_as_string()}    files  {shared.files}")
    if secret is not None:
        output.line(f"operator token    {secret}")
        output.line(f"                  (shown once; for this user also in {store / 'operator.token'})")
    if not has_admin(store):
        output.line("no admin yet      `cellctl user add NAME --role admin` makes one, who makes the others at the console")
    output.line("Ctrl-C stops the service.")


def sim(
    cell: CellName = DEFAULT_CELL,
    run: RunFolder = DEFAULT_RUN,
    time_scale: Annotated[
        float, typer.Option("--time-scale", min=0.01, max=1000.0, help="Process time per wall time.")
    ] = 1.0,
    fault: Annotated[
        list[str] | None, typer.Option("--fault", metavar="TEXT", help="As in 'at=12.5s door_open'; again for more.")
    ] = None,
    stock_cell_mm: Annotated[
        float, typer.Option("--stock-cell-mm", min=0.05, help="Grid of the simulated metal.")
    ] = 0.5,
    mesh: Annotated[
        Path | None, typer.Option("--mesh", help="Part to measure the metal against, in the build frame.")
    ] = None,
    at_baud: Annotated[bool, typer.Option("--at-baud", help="Carry bytes at the pace of the baud rates.")] = False,
) -> None:
    """Run the devices of a simulated cell behind real wires: CNC on a pty, laser, feeder and I/O on Modbus."""
    import os
    import sys

    words = ["--cell", cell, "--run", str(run), "--time-scale", str(time_scale), "--stock-cell-mm", str(stock_cell_mm)]
    words += [word for text in fault or [] for word in ("--fault", text)]
    words += ["--mesh", str(mesh)] if mesh else []
    words += ["--at-baud"] if at_baud else []
    os.execv(sys.executable, [sys.executable, "-m", "sim", *words])
