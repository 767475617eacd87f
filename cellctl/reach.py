"""How a service that other machines can reach is reached: by TLS, behind a proxy that does it, or in plain sight if that is said."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from cellctl import tls
from cellctl.api.security import is_loopback
from cellctl.first_start import ServeError


@dataclass(frozen=True)
class Wire:
    """As the command line says it. behind_proxy : address of the proxy; stop_url, names : as pages call the service"""

    cert: Path | None = None
    key: Path | None = None
    plain: bool = False
    behind_proxy: str = ""
    stop_url: str = ""
    names: tuple[str, ...] = ()

    @property
    def scheme(self) -> str:
        """Of console, REST and STOP."""
        return "https" if self.cert is not None else "http"

    def files(self) -> list[str]:
        """The words that both processes are started with."""
        if self.cert is None or self.key is None:
            return []
        return ["--tls-cert", str(self.cert.resolve()), "--tls-key", str(self.key.resolve())]

    def for_web(self) -> list[str]:
        """The words that the web process is started with."""
        named = {"--behind-proxy": self.behind_proxy, "--stop-url": self.stop_url}
        words = [word for option, value in named.items() if value for word in (option, value)]
        return words + [word for name in self.names for word in ("--name", name)]


def check_wire(wire: Wire, host: str) -> list[str]:
    """Lines of warning. Raises TlsError for files that cannot be used, ServeError for what a careful shop does not do unsaid."""
    warnings = []
    if wire.cert is not None or wire.key is not None:
        warnings.append(tls.check(wire.cert, wire.key))
    if wire.stop_url:
        _check_stop_url(wire)
    elif wire.behind_proxy and wire.cert is None:
        warnings.append("--behind-proxy without --stop-url: pages that came by https cannot post STOP by http and use the web process for it")
    if not is_loopback(host) and wire.cert is None and not wire.behind_proxy:
        if not wire.plain:
            raise ServeError(
                f"{host} can be reached from other machines, and without TLS passwords and tokens can be read on the way",
                "give --tls-cert and --tls-key, or --behind-proxy ADDRESS, or say --plain on a network that you trust",
            )
        warnings.append(f"WITHOUT TLS: whoever listens on the network of {host} can read passwords and tokens and act as their owner")
    return [warning for warning in warnings if warning]


def _check_stop_url(wire: Wire) -> None:
    try:
        parts = urlsplit(wire.stop_url)
        fits = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.path == "/stop" and not parts.query
    except ValueError:
        fits = False
    if not fits or any(char.isspace() or char in ";,'\"" for char in wire.stop_url):
        raise ServeError(f"--stop-url {wire.stop_url[:80]}: is no address of a STOP listener", "as in https://cell.example:8001/stop")
