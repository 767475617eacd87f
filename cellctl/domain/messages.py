"""What the processes say to the cell process over its unix socket: 4-byte big-endian length, then one msgpack struct."""

from __future__ import annotations

from typing import Any

import msgspec

from cellctl.domain.snapshot import Snapshot

PROTOCOL = 1


class Hello(msgspec.Struct, frozen=True, tag=True):
    """First message of both sides; another version is refused with a Reply and the socket is closed."""

    protocol: int
    name: str


class Command(msgspec.Struct, frozen=True, tag=True):
    """A verb that names the end state: start hold resume abort stop reset home unlock confirm_position jog override record
    acknowledge, and take_control release_control; jog_keep, jog_end, present and pages are not written down.

    id : chosen by the sender; the same id is carried out once
    args : start: {job, name, program (directory), confirmed_at (Unix time, s; left out: nobody is asked about the table),
    continues (job whose part stands on the table: that was confirmed then, not a clear table)};
    override: {feed_percent (10..200)}; acknowledge: {codes (of the alarms that were seen)};
    jog: {axis, distance, feed}, or {axis, distance (its sign counts), feed, continuous} to be kept up by jog_keep
    pages: {hosts (of pages at other addresses that may read what the STOP listener answers)}
    client : which console, program or service of that person sends it; "": not told
    """

    id: str
    verb: str
    who: str
    because: str
    args: dict[str, Any] = {}
    client: str = ""


class Reply(msgspec.Struct, frozen=True, tag=True):
    """Answer to the Command of the same id. ok: accepted and durable. Otherwise error is one line, hint says what to do.

    kind : of a refusal: "readiness", "control", "table" or ""
    """

    id: str
    ok: bool
    error: str = ""
    hint: str = ""
    data: dict[str, Any] = {}
    kind: str = ""


class Event(msgspec.Struct, frozen=True, tag=True):
    """Something that happened; written to the journal before it is sent. seq increases without gaps, across restarts."""

    seq: int
    at: float
    kind: str
    text: str
    job: str = ""
    data: dict[str, Any] = {}


class Live(msgspec.Struct, frozen=True, tag=True):
    """A snapshot, newest wins."""

    snapshot: Snapshot


Message = Hello | Command | Reply | Event | Live
