"""Processes and their pipes are let go of, however often their caller is cancelled."""

from __future__ import annotations

import asyncio
import sys
from asyncio.subprocess import DEVNULL, PIPE

import pytest

from cellctl.planning.ending import kill, to_its_end

TALKER = "import sys\nwhile True: sys.stdout.write('x' * 65536); sys.stdout.flush()"


async def started(code: str) -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(sys.executable, "-c", code, stdin=DEVNULL, stdout=PIPE, limit=1024)


def pipe_of(process: asyncio.subprocess.Process) -> asyncio.ReadTransport:
    transport = process._transport.get_pipe_transport(1)  # type: ignore[attr-defined]
    assert isinstance(transport, asyncio.ReadTransport)
    return transport


async def test_a_killed_process_leaves_no_pipe_open_though_nobody_read_what_it_said() -> None:
    process = await started(TALKER)
    assert process.stdout is not None
    await process.stdout.read(1)
    pipe = pipe_of(process)
    assert pipe._pipe is not None  # type: ignore[attr-defined]
    await kill(process)
    assert process.returncode == -9
    assert pipe._pipe is None, "closed, not left to the garbage collector"  # type: ignore[attr-defined]


async def test_a_process_that_has_ended_is_killed_harmlessly() -> None:
    process = await started("")
    await process.wait()
    await kill(process)
    await kill(process)
    assert process.returncode == 0


async def test_work_is_done_to_its_end_though_its_caller_is_cancelled_again_and_again() -> None:
    may_end, done = asyncio.Event(), []

    async def work() -> str:
        await may_end.wait()
        done.append(True)
        return "done"

    caller = asyncio.create_task(to_its_end(work()))
    for _ in range(5):
        await asyncio.sleep(0)
        caller.cancel()
        await asyncio.sleep(0)
        assert not caller.done()
    may_end.set()
    with pytest.raises(asyncio.CancelledError):
        await caller
    assert done == [True]


async def test_work_that_nobody_cancels_gives_its_result_or_its_error() -> None:
    async def fails() -> None:
        raise ValueError("broken")

    assert await to_its_end(asyncio.sleep(0, "value")) == "value"
    with pytest.raises(ValueError, match="broken"):
        await to_its_end(fails())
