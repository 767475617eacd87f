"""How the scheduler of a planning pool is reached: its address, and the TLS files that all of the pool prove themselves with."""

from __future__ import annotations

import argparse
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from cellctl import tls

PORT = 8786  # of schedulers, unless they are told otherwise
LOOPBACK = ("127.0.0.1", "::1", "localhost")
EXTRA = "pip install 'hybridcell[distributed]'"


class PoolError(Exception):
    """A planning pool that cannot be used as it is given. `message`, `hint` : one line each"""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


@dataclass(frozen=True)
class PoolWire:
    """As the command line says it. address : tls://host:port or tcp://host:port

    cert, key : of this machine; ca : who signed all of the pool's; None: the certificate is its own and the pool's only one
    plain : without TLS also beyond this machine
    """

    address: str
    cert: Path | None = None
    key: Path | None = None
    ca: Path | None = None
    plain: bool = False

    @property
    def is_tls(self) -> bool:
        """Whether all connections of the pool are encrypted, and both ends proven."""
        return self.address.startswith("tls://")

    @property
    def host(self) -> str:
        """The scheduler's host."""
        return urlsplit(self.address).hostname or ""

    def words(self) -> list[str]:
        """As words of a command line of ours."""
        named = {"--planning-cert": self.cert, "--planning-key": self.key, "--planning-ca": self.ca}
        files = [word for option, path in named.items() if path is not None for word in (option, str(path.resolve()))]
        return ["--planning-scheduler", self.address, *files, *(["--planning-plain"] if self.plain else [])]

    def security(self) -> Any:
        """dask's settings for it: certificates are asked for at both ends."""
        from distributed import security

        make: Any = security.Security
        if not self.is_tls:
            return make(require_encryption=False)
        own = {"cert": str(self.cert), "key": str(self.key)}
        files = {f"tls_{who}_{what}": path for who in ("client", "scheduler", "worker") for what, path in own.items()}
        return make(require_encryption=True, tls_ca_file=str(self.ca or self.cert), **files)


def check_pool(wire: PoolWire) -> str:
    """A line of warning, "" if there is nothing to warn of. Raises PoolError, TlsError."""
    try:
        parts = urlsplit(wire.address)
        fits = parts.scheme in ("tls", "tcp") and bool(parts.hostname) and bool(parts.port) and not parts.path.strip("/")
    except ValueError:
        fits = False
    if not fits or any(char.isspace() or not char.isprintable() for char in wire.address):
        raise PoolError(f"{wire.address[:80]}: is no address of a scheduler", f"as in tls://planning.example:{PORT}")
    if wire.is_tls:
        if wire.ca is not None:
            tls.certificate(wire.ca)
        if wire.cert is None or wire.key is None:
            raise PoolError(f"{wire.address}: TLS without a certificate and its key", "give both files of this machine, as PEM")
        return tls.check(wire.cert, wire.key)
    if wire.cert or wire.key or wire.ca:
        raise PoolError(f"{wire.address}: TLS files are given for a connection without TLS", "say tls:// instead of tcp://")
    if wire.host in LOOPBACK:
        return ""
    if not wire.plain:
        raise PoolError(
            f"{wire.address} is without TLS and beyond this machine: whoever reaches it can run code on every machine of the pool",
            "say tls:// with a certificate and its key; or the plain option, on a network where you trust everybody",
        )
    return f"PLANNING WITHOUT TLS: whoever reaches {wire.address} can run code on this machine and on every planning machine"


def check_installed() -> None:
    """Raises PoolError where the extra is not installed. Does not load it."""
    from importlib.util import find_spec

    if find_spec("distributed") is None:
        raise PoolError("planning on other machines needs dask's distributed", f"install the extra: {EXTRA}")


def quiet() -> None:
    """dask's own log tells every connection; what matters of it is told in our words. Loads dask."""
    import distributed  # noqa: F401  (it sets its loggers up as it is loaded)

    for name in [name for name in logging.root.manager.loggerDict if name.partition(".")[0] in ("distributed", "tornado")]:
        logging.getLogger(name).setLevel(logging.CRITICAL)


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of a service's pool, as `PoolWire.words` writes them."""
    parser.add_argument("--planning-scheduler", default="", help="address of the scheduler of a planning pool")
    for name in ("cert", "key", "ca"):
        parser.add_argument(f"--planning-{name}", type=Path, default=None)
    parser.add_argument("--planning-plain", action="store_true")


def wire_of(given: argparse.Namespace) -> PoolWire | None:
    """The pool of a command line, None without one."""
    if not given.planning_scheduler:
        return None
    return PoolWire(given.planning_scheduler, given.planning_cert, given.planning_key, given.planning_ca, given.planning_plain)
