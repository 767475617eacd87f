"""The client's side of the stream of server-sent events: reads messages, and comes back where it was when the line breaks."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import httpx

SILENCE_S = 15.0  # the service says something every few seconds
AGAIN_S = 1.0
PATH = "/api/v1/events/stream"


@dataclass(frozen=True)
class LiveMessage:
    """One message. kind : event, job, snapshot or heartbeat; document : {"type": kind, kind: …}; place : to go on from after it"""

    kind: str
    document: dict[str, Any]
    place: str


def messages(lines: Iterator[str], place: str) -> Iterator[LiveMessage]:
    """The messages in the lines of a stream; one without an id leaves the place as it was, one of nothing but an id has no kind.

    Source: WHATWG HTML, 9.2.
    """
    kind, data, told = "", "", place
    for line in lines:
        name, _, value = line.partition(":")
        value = value.removeprefix(" ")
        if name == "id":
            place = value
        elif name == "event":
            kind = value
        elif name == "data":
            data += value
        elif not line and (data or place != told):
            yield LiveMessage(kind, json.loads(data or "{}"), place)
            kind, data, told = "", "", place


def read_stream(
    http: httpx.Client, place: str, snapshots: bool, check: Callable[[httpx.Response], None]
) -> Iterator[LiveMessage]:
    """Messages for ever. check : raises for an answer that is a refusal; a line that breaks is made again."""
    while True:
        headers = {"Last-Event-ID": place} if place else {}
        timeout = httpx.Timeout(SILENCE_S)
        try:
            with http.stream("GET", PATH, params={"snapshots": snapshots}, headers=headers, timeout=timeout) as answer:
                if answer.is_error:
                    answer.read()
                    if answer.status_code < 500:
                        check(answer)
                else:
                    for message in messages(answer.iter_lines(), place):
                        place = message.place
                        if message.kind:
                            yield message
        except httpx.TransportError:
            pass  # the service restarts, or the network is away
        time.sleep(AGAIN_S)
