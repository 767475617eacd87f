"""The web process: `python -m cellctl.api --cell FILE --run DIR --store DIR --host HOST --port PORT`; started by `cellctl serve`."""

from __future__ import annotations

import argparse
import asyncio
import gc
import signal
import sys
from pathlib import Path

import structlog
import uvicorn
from fastapi import FastAPI

from cellctl import faults
from cellctl.allocator import keep_little
from cellctl.api.app import build_service, make_app
from cellctl.api.context import UPLOAD_LIMIT_BYTES, WORKER_MEMORY_BYTES, Settings
from cellctl.api.fleet_telling import host_url_of
from cellctl.api.wire import options
from cellctl.planning.pool.wire import add_options, wire_of
from cellctl.planning.worker import end_with
from cellctl.store import StoreError
from cellctl.store.owner import only_server
from cellctl.tls import TlsError
from config import ConfigError, load_cell

SWITCH_S = 0.001  # how long a thread that computes may keep the event loop waiting


def arguments(words: list[str]) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m cellctl.api", description=__doc__)
    parser.add_argument("--cell", type=Path, required=True)
    parser.add_argument("--run", type=Path, required=True)
    parser.add_argument("--store", type=Path, required=True)
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=8000)
    parser.add_argument("--stop-port", type=int, default=None, help="where the cell process listens for STOP")
    parser.add_argument("--parent", type=int, default=0, help="process to end with")
    parser.add_argument("--upload-limit-bytes", type=int, default=UPLOAD_LIMIT_BYTES)
    parser.add_argument("--worker-memory-bytes", type=int, default=WORKER_MEMORY_BYTES)
    parser.add_argument("--tls-cert", type=Path, default=None)
    parser.add_argument("--tls-key", type=Path, default=None)
    parser.add_argument("--behind-proxy", default="", help="address of a proxy whose X-Forwarded-For and -Proto are believed")
    parser.add_argument("--stop-url", default="", help="where pages reach the stop listener, if not on their own host")
    parser.add_argument("--name", action="append", default=[], help="a host that the service is called by")
    add_options(parser)
    return parser.parse_args(words)


async def serve(given: argparse.Namespace) -> None:
    """Serve until a signal says stop. Raises StoreError, ConfigError."""
    if given.parent:
        end_with(given.parent, signal.SIGTERM)
    settings = Settings(
        store=given.store,
        run=given.run,
        cell_file=given.cell,
        stop_port=given.stop_port,
        upload_limit_bytes=given.upload_limit_bytes,
        worker_memory_bytes=given.worker_memory_bytes,
        tls_cert=given.tls_cert,
        stop_url=given.stop_url,
        names=tuple(given.name),
        host_url=host_url_of("https" if given.tls_cert else "http", given.host, given.port, tuple(given.name)),
        pool=wire_of(given),
    )
    with only_server(given.store, load_cell(given.cell).name):
        await listen(given, make_app(build_service(settings), given.host))


async def listen(given: argparse.Namespace, app: FastAPI) -> None:
    """Answer requests until a signal says stop."""
    config = uvicorn.Config(
        app,
        host=given.host,
        port=given.port,
        log_level="warning",
        timeout_graceful_shutdown=3,
        ssl_certfile=given.tls_cert,
        ssl_keyfile=given.tls_key,
        **options(given.behind_proxy),
    )
    sys.setswitchinterval(SWITCH_S)
    gc.collect()
    gc.freeze()  # what is there now stays; collecting it again and again would only keep requests waiting
    await uvicorn.Server(config).serve()


def configure_log() -> None:
    """JSON lines on stderr; tracebacks without the values of variables, which may be secrets."""
    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso"),
            structlog.processors.format_exc_info,
            structlog.processors.JSONRenderer(),
        ],
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
    )


def main() -> int:
    """Run; 2 for facts or a store that cannot be used."""
    configure_log()
    keep_little()
    try:
        asyncio.run(serve(arguments(sys.argv[1:])))
    except (StoreError, ConfigError, TlsError) as error:
        fault = faults.explain(error)
        if fault is not None:
            faults.report(fault)
        return 2
    except KeyboardInterrupt:
        return 0
    return 0


if __name__ == "__main__":
    sys.exit(main())
