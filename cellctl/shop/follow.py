"""Follows the service over its own interface, for ever: a thread that reads the stream and puts what came where the others look."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import msgspec

from cellctl.client import Client, ServiceError
from cellctl.client_events import LiveMessage
from cellctl.domain.snapshot import Snapshot
from cellctl.shop.freshness import Known

AGAIN_S = 5.0  # after a refusal, as of a token that has expired


def take(known: Known, message: LiveMessage, now: float) -> None:
    """Put one message into what is known. now : s, monotonic    Raises msgspec.ValidationError for a snapshot of another shape."""
    if message.kind == "snapshot":
        known.take(msgspec.convert(message.document["snapshot"], Snapshot), now)
    elif message.kind == "job":
        job = message.document["job"]
        if known.completed is not None and job["state"] == "completed" and job["cell"] == known.cell:
            known.completed.add(str(job["id"]))


def count_completed(known: Known, client: Client) -> None:
    """Ask which jobs were completed on this cell. Raises ServiceError."""
    known.completed = {str(job["id"]) for job in client.jobs("completed") if job["cell"] == known.cell}


def _follow(known: Known, client: Client, say: Callable[[str], None]) -> None:
    """Raises ServiceError when the service refuses."""
    said = ""
    messages = client.events(snapshots=True)
    count_completed(known, client)
    for message in messages:
        take(known, message, time.monotonic())
        if known.other_cell != said:
            said = known.other_cell
            if said:
                say(f"the service runs cell {said}, not {known.cell}: everything is told as unavailable; name the right one with --cell")


def _for_ever(known: Known, client: Client, say: Callable[[str], None]) -> None:
    said = ""
    while True:
        try:
            _follow(known, client, say)
        except ServiceError as error:
            told = f"{error.message}; {error.hint}"
        except (msgspec.ValidationError, KeyError, TypeError, ValueError) as error:
            told = f"the service speaks another version: {error}"
        if told != said:
            say(told)
            said = told
        time.sleep(AGAIN_S)


def follow(known: Known, client: Client, say: Callable[[str], None]) -> threading.Thread:
    """Start following. The thread ends with the process. say : told of what keeps it from following, once"""
    thread = threading.Thread(target=_for_ever, args=(known, client, say), name="follow", daemon=True)
    thread.start()
    return thread
