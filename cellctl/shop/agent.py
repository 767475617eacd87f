"""The agent's answers over HTTP: /probe, /current, /sample, /asset. Reads the mirror, changes nothing."""

from __future__ import annotations

from collections.abc import Callable

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from cellctl.shop import mtconnect_xml as xml
from cellctl.shop.mirror import Mirror

COUNT = 100  # of the standard
COUNT_MAX = 10_000
NOT_OFFERED = ("at", "path", "interval", "heartbeat")


class Asked(Exception):
    """A request that cannot be met. code : of the standard; status : of HTTP"""

    def __init__(self, code: str, text: str, status: int = 400) -> None:
        super().__init__(text)
        self.code, self.text, self.status = code, text, status


def whole(request: Request, name: str, default: int, least: int, most: int) -> int:
    """A whole number of the query. Raises Asked."""
    given = request.query_params.get(name)
    if given is None:
        return default
    if not given.isdecimal() or len(given) > 18:
        raise Asked("INVALID_REQUEST", f"{name}={given[:40]}: is no whole number")
    if not least <= int(given) <= most:
        raise Asked("OUT_OF_RANGE", f"{name}={given}: must be between {least} and {most}")
    return int(given)


class Agent:
    """Makes the documents. wall : clock, Unix time (s)"""

    def __init__(self, mirror: Mirror, wall: Callable[[], float]) -> None:
        self.mirror, self.wall = mirror, wall

    def app(self) -> Starlette:
        """The application."""
        kinds = {"probe": self.probe, "current": self.current, "sample": self.sample}
        routes = [Route(path, self._answering(make)) for kind, make in kinds.items() for path in (f"/{kind}", f"/{{device}}/{kind}")]
        assets = [Route(path, self._answering(self.asset)) for path in ("/asset", "/assets", "/asset/{ids}", "/assets/{ids}")]
        rest = [Route("/", self._answering(self.probe)), Route("/{device}", self._answering(self.probe))]
        return Starlette(routes=[*routes, *assets, *rest, Route("/{rest:path}", self._answering(self.nothing))])

    def probe(self, _request: Request) -> bytes:
        """The device."""
        return xml.devices(self.mirror, self.wall())

    def current(self, _request: Request) -> bytes:
        """The newest observation of everything."""
        return xml.streams(self.mirror, self.wall(), self.mirror.newest(), self.mirror.next_sequence)

    def sample(self, request: Request) -> bytes:
        """Observations from a number on. Raises Asked."""
        first, following = self.mirror.first_sequence, self.mirror.next_sequence
        count = whole(request, "count", COUNT, 1, COUNT_MAX)
        start = whole(request, "from", first, first, following)
        told = self.mirror.sample(start, count)
        return xml.streams(self.mirror, self.wall(), told, told[-1].sequence + 1 if told else following)

    def asset(self, request: Request) -> bytes:
        """Assets: the cutters. Raises Asked."""
        wanted = [one for one in request.path_params.get("ids", "").split(";") if one]
        known = xml.tool_assets(self.mirror.cell)
        for one in wanted:
            if one not in known:
                raise Asked("ASSET_NOT_FOUND", f"{one[:80]}: there is no such asset", 404)
        return xml.assets(self.mirror, self.wall(), wanted)

    def nothing(self, request: Request) -> bytes:
        """What there is not. Raises Asked."""
        raise Asked("INVALID_URI", f"{request.url.path[:80]}: is neither probe, current, sample nor asset", 404)

    def _answering(self, make: Callable[[Request], bytes]) -> Callable[[Request], Response]:
        async def answer(request: Request) -> Response:
            status = 200
            try:
                self._check(request)
                body = make(request)
            except Asked as asked:
                status, body = asked.status, xml.error(self.mirror, self.wall(), asked.code, asked.text)
            return Response(body, status, media_type="text/xml", headers={"Cache-Control": "no-store"})

        return answer  # type: ignore[return-value]  # Starlette takes both, by what it finds

    def _check(self, request: Request) -> None:
        device = request.path_params.get("device")
        if device is not None and device not in (self.mirror.cell.name, xml.uuid_of(self.mirror.cell)):
            raise Asked("NO_DEVICE", f"{device[:80]}: there is no such device; it is {self.mirror.cell.name}", 404)
        for name in NOT_OFFERED:
            if name in request.query_params:
                raise Asked("UNSUPPORTED", f"{name}: this agent does not offer it; ask without it")
