"""Asks the preview process, one question at a time, the newest of each person first; starts it when it is needed and ends it."""

from __future__ import annotations

import asyncio
import os
import sys
from typing import Any, Literal

import msgspec

from cellctl.planning.ending import kill, to_its_end
from cellctl.planning.process import WorkerError
from cellctl.planning.task import Failed

LINE_LIMIT = 16 << 20  # bytes of one answer
ANSWER_S = 300.0  # longer, and the process is ended; on a new machine the first answer waits until the planner's kernels are compiled
MODULE = "cellctl.planning.preview_worker"


class Ask(msgspec.Struct, frozen=True):
    """One question. file : mesh or plan   target : where a file is written to   recipe_toml, cell, material_toml : for an estimate

    material_toml : facts that the recipe's material stands for
    """

    kind: Literal["estimate", "picture", "figures"]
    file: str
    target: str = ""
    recipe_toml: str = ""
    cell: str = ""
    material_toml: str = ""


class Answer(msgspec.Struct, frozen=True):
    """What it came to, or why not."""

    summary: dict[str, Any]
    failed: Failed | None = None


class Superseded(Exception):
    """The same person asked something newer of the same thing while this question waited."""


class Previews:
    """The process behind previews. A question that is cancelled, or takes too long, ends it; the next one starts it anew."""

    def __init__(self, memory_bytes: int) -> None:
        self._memory_bytes = memory_bytes
        self._process: asyncio.subprocess.Process | None = None
        self._lock = asyncio.Lock()
        self._newest: dict[str, int] = {}
        self._asked = 0

    async def ask(self, ask: Ask, of: str = "") -> dict[str, Any]:
        """The answer to a question.  of : who asks about what; of several that wait, only the newest is answered.

        Raises WorkerError; Superseded if a newer one came.
        """
        self._asked += 1
        number = self._asked
        if of:
            self._newest[of] = number
        try:
            async with self._lock:
                if of and self._newest.get(of) != number:
                    raise Superseded
                return await self._answer(ask)
        finally:
            if self._newest.get(of) == number:
                del self._newest[of]

    async def _answer(self, ask: Ask) -> dict[str, Any]:
        process = await self._started()
        assert process.stdin is not None and process.stdout is not None
        try:
            async with asyncio.timeout(ANSWER_S):
                process.stdin.write(msgspec.json.encode(ask) + b"\n")
                await process.stdin.drain()
                text = await process.stdout.readline()
        except TimeoutError:
            await self._end()
            detail = f"no answer within {ANSWER_S:.0f} s: the part is too large for a preview, or the machine too busy"
            raise WorkerError(Failed("It takes too long", detail, "submit it: its plan has the figures", 503)) from None
        except asyncio.CancelledError:
            await self._end()
            raise
        except (BrokenPipeError, ConnectionResetError):
            text = b""
        if not text:
            await self._end()
            raise WorkerError(Failed("The preview ended", "the process behind previews ended without an answer", "ask for it again", 503))
        answer = msgspec.json.decode(text, type=Answer)
        if answer.failed is not None:
            raise WorkerError(answer.failed)
        return answer.summary

    async def _started(self) -> asyncio.subprocess.Process:
        if self._process is None or self._process.returncode is not None:
            command = [sys.executable, "-m", MODULE, str(os.getpid()), str(self._memory_bytes)]
            pipe = asyncio.subprocess.PIPE
            starting = asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe, limit=LINE_LIMIT)
            task = asyncio.ensure_future(starting)
            try:
                self._process = await to_its_end(task)
            except asyncio.CancelledError:
                if not task.cancelled() and task.exception() is None:
                    await to_its_end(kill(task.result()))
                raise
        return self._process

    async def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            await to_its_end(kill(process))

    async def close(self) -> None:
        """End the process. Whoever waits for its answer reads its end first: two cannot read one pipe."""
        if self._process is not None and self._process.returncode is None:
            self._process.kill()
        async with self._lock:
            await self._end()
