"""Commands of a planning pool: planner-scheduler, planner-worker."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellctl.cli import output
from cellctl.cli.input import InputFault

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Awaitable, Callable

    from cellctl.planning.pool.wire import PoolWire

DEFAULT_FOLDER = Path(".cellctl/planner")
Cert = Annotated[Path | None, typer.Option("--cert", help="This machine's certificate (PEM). All of the pool prove themselves.")]
Key = Annotated[Path | None, typer.Option("--key", help="Its key (PEM, without passphrase).")]
Ca = Annotated[Path | None, typer.Option("--ca", help="Who signed the certificates of the pool. Default: the certificate, when all have the same.")]
Plain = Annotated[bool, typer.Option("--plain", help="Without TLS also beyond this machine: whoever reaches the scheduler can run code in the pool.")]


def _say(text: str) -> None:
    typer.echo(f"cellctl: {text}", err=True)


def _checked(address: str, cert: Path | None, key: Path | None, ca: Path | None, plain: bool) -> PoolWire:
    """The pool's wire. Raises PoolError, TlsError."""
    from cellctl.planning.pool.wire import PoolWire, check_installed, check_pool, quiet

    wire = PoolWire(address, cert, key, ca, plain)
    if warning := check_pool(wire):
        _say(warning)
    check_installed()
    quiet()
    return wire


def _until_told(serve: Callable[[asyncio.Event], Awaitable[None]]) -> None:
    """Serve until SIGTERM or Ctrl-C."""
    import asyncio
    import signal

    async def run() -> None:
        stop = asyncio.Event()
        for sign in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(sign, stop.set)
        await serve(stop)

    asyncio.run(run())


def planner_scheduler(
    address: Annotated[str, typer.Argument(help="Where to listen, as in tls://planning.example:8786.")],
    cert: Cert = None,
    key: Key = None,
    ca: Ca = None,
    plain: Plain = False,
) -> None:
    """Run the scheduler of a planning pool (dask.distributed). Services and planning machines connect to it."""
    from cellctl.planning.pool import scheduler

    wire = _checked(address, cert, key, ca, plain)
    _until_told(lambda stop: scheduler.serve(wire, stop, lambda at: output.line(f"scheduler         {at}")))


def planner_worker(
    scheduler: Annotated[str, typer.Argument(help="The pool's scheduler, as in tls://planning.example:8786.")],
    places: Annotated[int, typer.Option("--places", min=1, max=256, help="Tasks at once: each may use one core and the memory below.")] = 1,
    memory_mb: Annotated[float, typer.Option("--memory-mb", min=512.0, help="Address space of a task.")] = 8192.0,
    folder: Annotated[Path, typer.Option("--folder", help="Of this machine's cache and scratch files.")] = DEFAULT_FOLDER,
    cache_mb: Annotated[float, typer.Option("--cache-mb", min=1.0, help="Files of earlier tasks that are kept.")] = 4096.0,
    shared: Annotated[
        Path | None, typer.Option("--shared", help="Where this machine sees the files of the service's store (its folder `files`), if it does.")
    ] = None,
    name: Annotated[str, typer.Option("--name", help="What it is called. Default: the machine's name.")] = "",
    host: Annotated[str, typer.Option("--host", help="Where it listens for the scheduler. Default: its address on the way there.")] = "",
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Its port; 0 for any free one.")] = 0,
    cert: Cert = None,
    key: Key = None,
    ca: Ca = None,
    plain: Plain = False,
) -> None:
    """Plan, post and prove for services on other machines: joins the pool of a scheduler, and comes back when that was away."""
    import platform

    from cellctl.planning.pool.machine import Place, PlanningMachine, held

    wire = _checked(scheduler, cert, key, ca, plain)
    if shared is not None and not shared.is_dir():
        raise InputFault(f"--shared {shared}: no such folder", "name the folder of the store's files as this machine sees it")
    if host and not wire.is_tls and not plain:
        from cellctl.api.security import is_loopback

        if not is_loopback(host):
            raise InputFault(f"--host {host} without TLS can be reached from other machines", "say tls://, or --plain on a network that you trust")
    place = Place(
        name or platform.node() or "planner", folder.resolve(), places, int(memory_mb * 2**20), int(cache_mb * 2**20), host, port, shared
    )
    with held(place.folder):
        _until_told(PlanningMachine(wire, place, _say).serve)
