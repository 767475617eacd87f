"""Paths of another cell's interface: `/cells/NAME/api/v1/…`, read from the bytes that were sent, so that nothing hides in an encoding."""

from __future__ import annotations

import re
from dataclasses import dataclass
from urllib.parse import quote, unquote

PREFIX = "/cells/"
API = "/api/v1/"
TARGET_LIMIT = 2048  # bytes of path and query: a host vouches for them in a header
SEGMENT = re.compile(r"(?:[A-Za-z0-9._~!$&'()*+,;=:@-]|%(?!2[fF]|5[cC]|00|[01][0-9A-Fa-f])[0-9A-Fa-f]{2})+")
DOTS = re.compile(r"(?:\.|%2[eE]){1,2}")
QUERY = re.compile(r"[\x21-\x7e]*")
OF_CELL = re.compile(r"/cells/[^/]+(?=/api/)")


class CellPathError(Exception):
    """A path that is passed on to nobody. The message is one line."""


@dataclass(frozen=True)
class CellPath:
    """cell : its name; rest : the path at its own host, "" for its page"""

    cell: str
    rest: str


def read(raw: bytes) -> CellPath:
    """The parts of a path as it was sent, without its query. Raises CellPathError."""
    try:
        text = raw.decode("ascii")
    except UnicodeDecodeError:
        raise CellPathError("the path has bytes that are not ASCII") from None
    if not text.startswith(PREFIX):
        raise CellPathError(f"the path does not begin with {PREFIX}")
    name, slash, rest = text.removeprefix(PREFIX).partition("/")
    if not _is_plain(name):
        raise CellPathError("the name of the cell is none")
    if not rest:
        return CellPath(unquote(name), slash)
    if not all(_is_plain(segment) for segment in rest.removesuffix("/").split("/")):
        raise CellPathError("the path has empty segments, dots, or characters that may hide a slash")
    if not f"/{rest}".startswith(API):
        raise CellPathError(f"only {API}… of a cell is passed on")
    return CellPath(unquote(name), f"/{rest}")


def target_of(rest: str, query: bytes) -> str:
    """Path and query to ask the cell's own host for. Raises CellPathError."""
    text = query.decode("latin-1")
    if not QUERY.fullmatch(text):
        raise CellPathError("the query has spaces, control characters, or bytes that are not ASCII")
    target = f"{rest}?{text}" if text else rest
    if len(target) > TARGET_LIMIT:
        raise CellPathError(f"path and query are longer than {TARGET_LIMIT} bytes")
    return target


def cell_of(path: str) -> str:
    """The name in a path that was decoded already, whatever else is wrong with it."""
    return path.removeprefix(PREFIX).partition("/")[0]


def page_of(cell: str) -> str:
    """Path of a cell's page."""
    return f"{PREFIX}{quote(cell, safe='')}/"


def at_own_host(path: str) -> str:
    """The path that a request has at the cell's own host: what middleware knows uploads and commands by."""
    return OF_CELL.sub("", path, count=1)


def _is_plain(segment: str) -> bool:
    return SEGMENT.fullmatch(segment) is not None and DOTS.fullmatch(segment) is None
