"""The unix socket: versioned, private, newest snapshot wins, events in order."""

from __future__ import annotations

import asyncio
import stat
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from cellctl.cell.answers import Answers as KeptAnswers
from cellctl.cell.ipc import HEADER, IpcServer, encode, read_message
from cellctl.domain.messages import PROTOCOL, Command, Event, Hello, Live, Reply
from cellctl.domain.snapshot import Snapshot

WAIT_S = 60.0


class Answers:
    """Answers to commands; the one to `slow` comes when it may."""

    def __init__(self) -> None:
        self.may_end = asyncio.Event()

    async def __call__(self, command: Command) -> Reply:
        if command.verb == "slow":
            await self.may_end.wait()
        return Reply(command.id, True, data={"verb": command.verb})


@pytest.fixture
def answer() -> Answers:
    return Answers()


@pytest.fixture
async def server(tmp_path: Path, answer: Answers) -> AsyncIterator[IpcServer]:
    one = IpcServer(answer, "test cell")
    await one.start(tmp_path / "cell.sock")
    yield one
    await one.close()


class Client:
    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer

    @classmethod
    async def connect(cls, path: Path, protocol: int = PROTOCOL) -> Client:
        client = cls(*await asyncio.open_unix_connection(path))
        client.writer.write(encode(Hello(protocol, "test")))
        return client

    async def read(self) -> object:
        return await asyncio.wait_for(read_message(self.reader), WAIT_S)

    async def close(self) -> None:
        self.writer.close()
        await self.writer.wait_closed()


def snapshot(seq: int) -> Snapshot:
    return Snapshot(seq=seq, at=0.0, cell="c", mode="sim", state="IDLE", execution="READY", because="x" * 2000)


async def test_the_socket_is_private_and_greets_with_its_version(server: IpcServer, tmp_path: Path) -> None:
    assert stat.S_IMODE((tmp_path / "cell.sock").stat().st_mode) == 0o600
    client = await Client.connect(tmp_path / "cell.sock")
    assert await client.read() == Hello(PROTOCOL, "test cell")
    await client.close()


async def test_another_version_is_refused_with_one_line(server: IpcServer, tmp_path: Path) -> None:
    client = await Client.connect(tmp_path / "cell.sock", protocol=PROTOCOL + 1)
    reply = await client.read()
    assert isinstance(reply, Reply) and not reply.ok and "protocol" in reply.error
    assert await client.reader.read() == b""
    await client.close()


@pytest.mark.parametrize("frame", [HEADER.pack(1 << 30), HEADER.pack(3) + b"\xff\xff\xff"])
async def test_a_frame_that_is_too_long_or_not_ours_is_refused_and_the_server_lives(
    server: IpcServer, tmp_path: Path, frame: bytes
) -> None:
    client = await Client.connect(tmp_path / "cell.sock")
    await client.read()
    client.writer.write(frame)
    reply = await client.read()
    assert isinstance(reply, Reply) and not reply.ok
    await client.close()
    other = await Client.connect(tmp_path / "cell.sock")
    assert isinstance(await other.read(), Hello)
    await other.close()


async def test_a_stop_overtakes_a_command_that_takes_long(
    server: IpcServer, answer: Answers, tmp_path: Path
) -> None:
    client = await Client.connect(tmp_path / "cell.sock")
    await client.read()
    client.writer.write(encode(Command("1", "slow", "me", "")) + encode(Command("2", "stop", "me", "")))
    stopped = await client.read()
    assert isinstance(stopped, Reply) and stopped.id == "2"
    answer.may_end.set()
    late = await client.read()
    assert isinstance(late, Reply) and late.id == "1"
    await client.close()


async def test_a_slow_client_gets_the_newest_snapshot_and_delays_nobody(server: IpcServer, tmp_path: Path) -> None:
    slow, quick = await Client.connect(tmp_path / "cell.sock"), await Client.connect(tmp_path / "cell.sock")
    await slow.read()
    await quick.read()
    last = 3000
    for seq in range(1, last + 1):
        server.publish(snapshot(seq))
        if seq % 50 == 0:
            await asyncio.sleep(0)
    seen: list[int] = []
    while not seen or seen[-1] != last:
        message = await quick.read()
        assert isinstance(message, Live)
        seen.append(message.snapshot.seq)
    late: list[int] = []
    while not late or late[-1] != last:
        message = await slow.read()
        assert isinstance(message, Live)
        late.append(message.snapshot.seq)
    assert late == sorted(late) and len(late) < last / 2
    await slow.close()
    await quick.close()


async def test_events_come_complete_and_in_order_between_snapshots(server: IpcServer, tmp_path: Path) -> None:
    client = await Client.connect(tmp_path / "cell.sock")
    await client.read()
    for seq in range(1, 101):
        server.broadcast([Event(seq, 0.0, "state", "x")])
        server.publish(snapshot(seq))
    numbers: list[int] = []
    while len(numbers) < 100:
        message = await client.read()
        if isinstance(message, Event):
            numbers.append(message.seq)
    assert numbers == list(range(1, 101))
    await client.close()


async def test_a_second_cell_process_on_the_same_socket_is_refused_and_a_stale_one_is_replaced(tmp_path: Path) -> None:
    first, second = IpcServer(Answers(), "a"), IpcServer(Answers(), "b")
    await first.start(tmp_path / "s")
    with pytest.raises(FileExistsError, match="another cell process"):
        await second.start(tmp_path / "s")
    await first.close()
    (tmp_path / "s").touch()
    await second.start(tmp_path / "s")
    await second.close()
    assert not (tmp_path / "s").exists()


async def test_connections_that_are_open_at_the_end_leave_no_words_in_the_log(tmp_path: Path, answer: Answers) -> None:
    said: list[str] = []
    asyncio.get_running_loop().set_exception_handler(lambda loop, context: said.append(str(context["message"])))
    one = IpcServer(answer, "test cell")
    await one.start(tmp_path / "other.sock")
    reader, writer = await asyncio.open_unix_connection(tmp_path / "other.sock")
    writer.write(encode(Hello(PROTOCOL, "test")))
    await read_message(reader)
    await one.close()
    await asyncio.sleep(0)
    writer.close()
    assert said == []


def test_answers_are_kept_as_many_as_a_restart_finds_and_the_oldest_goes_first() -> None:
    kept = KeptAnswers(3)
    for k in range(5):
        kept[f"c{k}"] = Reply(f"c{k}", True)
    kept["c3"] = Reply("c3", False)
    assert [*kept] == ["c2", "c3", "c4"] and not kept["c3"].ok
