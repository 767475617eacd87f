"""A service that takes over from one that was killed, and processes whose input is bad for a while only."""

from __future__ import annotations

import asyncio
import socket
from pathlib import Path

import pytest

from cellctl.cell.ipc import IpcServer
from cellctl.domain.messages import Command, Reply
from cellctl.first_start import ServeError
from cellctl.supervise import ADDRESS_FILE, Keeper, port_left

LOCAL = "127.0.0.1"


def keeper(tmp_path: Path, script: str, said: list[str]) -> Keeper:
    return Keeper("cell", ["/bin/sh", "-c", script], tmp_path / "cell.log", said.append)


async def test_process_whose_input_is_bad_at_its_first_start_ends_the_service_with_its_line(tmp_path: Path) -> None:
    one = keeper(tmp_path, "echo no such cell; exit 2", [])
    await asyncio.wait_for(one.keep(), 20.0)
    assert one.failure == "no such cell" and one.starts == 1


async def test_process_that_has_worked_is_started_again_though_the_store_refuses_it_for_now(tmp_path: Path) -> None:
    said: list[str] = []
    one = keeper(tmp_path, f"test -e {tmp_path}/free && exec sleep 60; echo store locked; exit 2", said)
    one.has_worked = True
    keeping = asyncio.create_task(one.keep())
    while not said:
        await asyncio.sleep(0.01)
    (tmp_path / "free").touch()
    while one.starts < 2 or one.process is None or one.process.returncode is not None:
        await asyncio.sleep(0.01)
    await one.end()
    await keeping
    assert not one.failure and "store locked" in said[0]


async def test_port_of_a_service_that_was_killed_is_waited_for_and_another_ones_is_refused_at_once(tmp_path: Path) -> None:
    with socket.socket() as other:
        other.bind((LOCAL, 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(ServeError):
            await port_left(tmp_path, LOCAL, port)
        (tmp_path / ADDRESS_FILE).write_text("{}")
        waiting = asyncio.create_task(port_left(tmp_path, LOCAL, port))
        await asyncio.sleep(0.05)
        assert not waiting.done()
    assert await waiting == port and not (tmp_path / ADDRESS_FILE).exists()


async def test_of_two_cell_processes_that_start_at_once_one_has_the_wires(tmp_path: Path) -> None:
    async def refuse(command: Command) -> Reply:
        return Reply(command.id, False)

    first, second = IpcServer(refuse, "a"), IpcServer(refuse, "b")
    await first.start(tmp_path / "cell.sock")
    (tmp_path / "cell.sock").unlink()  # as the other one finds it before the first has bound it
    with pytest.raises(FileExistsError, match="another cell process"):
        await second.start(tmp_path / "cell.sock")
    await first.close()
    await second.start(tmp_path / "cell.sock")
    await second.close()


async def test_keeper_that_is_ended_while_its_process_is_being_started_leaves_none_behind(tmp_path: Path) -> None:
    one = keeper(tmp_path, "exec sleep 60", [])
    keeping = asyncio.create_task(one.keep())
    while not one.starts:
        await asyncio.sleep(0)
    await one.end()
    await asyncio.wait_for(keeping, 20.0)
    assert one.process is not None and one.process.returncode is not None
