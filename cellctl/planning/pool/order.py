"""What goes between the service, its link and the planning machines: structs as JSON, files by name, size and hash."""

from __future__ import annotations

import re
from typing import Any

import msgspec

from cellctl.planning.task import (
    MESH_FILE,
    PICTURE_FILE,
    PLAN_FILE,
    PROGRAM_FOLDER,
    PROOF_FILE,
    REPORT_FILE,
    SURFACE_FILE,
    VIEW_FOLDER,
    Done,
    Failed,
    Task,
)

CHUNK_BYTES = 1 << 20  # of a file in one message: no process on the way holds more of it
RESULT_FILES_MAX = 100_000
RESULT_BYTES_MAX = 16 << 30  # of one task: more is a machine gone mad
LIVE_FOLDER = VIEW_FOLDER  # its files are fetched while the task still runs
RESULTS = frozenset({
    PLAN_FILE, VIEW_FOLDER, PROGRAM_FOLDER, f"{PROGRAM_FOLDER}.form", f"{PROGRAM_FOLDER}.track",
    PROOF_FILE, PICTURE_FILE, REPORT_FILE, SURFACE_FILE, MESH_FILE,
})  # fmt: skip
"""What the stages write into a task's folder: first words of the names of results."""
_WORD = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,199}")
_HASH = re.compile(r"[0-9a-f]{64}")


class OrderError(Exception):
    """What came from the other end does not fit. One line."""


class Away(OrderError):
    """A task that is not, or not any more, at the machine that was asked."""


class File(msgspec.Struct, frozen=True):
    """A file. name : its place in the task's folder   sha256 : hex   size : bytes   shared : its place in the store's files, "" if it has none"""

    name: str
    sha256: str
    size: int
    shared: str = ""


class Order(msgspec.Struct, frozen=True):
    """A task for a planning machine. topic : under which it tells what happens   key : the name of this attempt at the scheduler

    software, version : of the service: hash of the code that plans, and in words
    task : its paths are names of `files`   cell_sha256, twin_sha256 : of its cell, "" without one
    """

    id: str
    key: str
    topic: str
    software: str
    version: str
    task: Task
    files: list[File]
    cell_sha256: str = ""
    twin_sha256: str = ""


class End(msgspec.Struct, frozen=True):
    """How a task ended at a planning machine. files : of its results   is_lost : its process ended without a word   log : last lines of its stderr"""

    report: Done | Failed
    files: list[File] = []
    is_lost: bool = False
    log: str = ""


class Machine(msgspec.Struct, frozen=True):
    """What a planning machine says of itself when it joins. places : tasks at once"""

    name: str
    version: str
    software: str
    places: int


class Costs(msgspec.Struct, frozen=True):
    """Where the time of a task went, s, and what was moved, bytes.

    pack_s : hashing its files   wait_s : until a machine took it   send_s : until its files were there   work_s : at the machine
    fetch_s : of results after the work   attempts : machines that began it
    """

    pack_s: float = 0.0
    wait_s: float = 0.0
    send_s: float = 0.0
    work_s: float = 0.0
    fetch_s: float = 0.0
    sent_bytes: int = 0
    fetched_bytes: int = 0
    attempts: int = 0
    machine: str = ""


class Asked(msgspec.Struct, frozen=True, tag="asked"):
    """To the link: carry this task out."""

    id: str
    task: Task


class Cancelled(msgspec.Struct, frozen=True, tag="cancelled"):
    """To the link: nobody wants this task any more."""

    id: str


class Going(msgspec.Struct, frozen=True, tag="going"):
    """From the link: how far a task is."""

    id: str
    stage: str
    fraction: float


class Waiting(msgspec.Struct, frozen=True, tag="waiting"):
    """From the link: why nothing is done for a task, "" once it goes on."""

    id: str
    why: str


class Ended(msgspec.Struct, frozen=True, tag="ended"):
    """From the link: a task's end; its files are in its folder. No file is written to it any more."""

    id: str
    report: Done | Failed
    costs: Costs
    log: str = ""


class PoolState(msgspec.Struct, frozen=True, tag="pool"):
    """From the link: how many tasks the pool takes at once, on how many machines; why none, "" if it takes some."""

    places: int
    machines: int
    why: str = ""


ToLink = Asked | Cancelled
FromLink = Going | Waiting | Ended | PoolState


def resource_of(software: str) -> str:
    """Name of what a machine with this software has a place of: tasks go only to machines that plan exactly as the service would."""
    return f"cellctl-{software[:24]}"


def check_name(name: str) -> str:
    """The name of a file, if it stays inside its folder. Raises OrderError."""
    words = name.split("/")
    if not 1 <= len(words) <= 4 or not all(_WORD.fullmatch(word) for word in words):
        raise OrderError(f"{name[:80]!r} is no name of a file of a task")
    return name


def check_file(file: File) -> File:
    """A file that was announced. Raises OrderError."""
    check_name(file.name)
    if not _HASH.fullmatch(file.sha256) or not 0 <= file.size <= RESULT_BYTES_MAX:
        raise OrderError(f"{file.name}: its hash or size is none")
    return file


def check_results(files: list[File]) -> list[File]:
    """Files that a machine says it made, all of them among those that stages make. Raises OrderError."""
    if len(files) > RESULT_FILES_MAX or sum(check_file(file).size for file in files) > RESULT_BYTES_MAX:
        raise OrderError(f"{len(files)} files are more than a task makes")
    for file in files:
        if file.name.split("/")[0] not in RESULTS:
            raise OrderError(f"{file.name} is nothing that a task makes")
    return files


def as_json(struct: Any) -> bytes:
    """A struct as JSON."""
    return msgspec.json.encode(struct)
