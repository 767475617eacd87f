"""Tells receivers outside what happened: signed, in order, again until they take it. One receiver that is slow or away delays no other.

Letters are as the Standard Webhooks specification (1.0.0) says: `webhook-id` is the same whenever a letter is sent again, `webhook-timestamp`
is the time of sending (Unix, s), `webhook-signature` is `v1,` and the base64 of HMAC-SHA256 over `id.timestamp.body` with the secret.
Whoever receives checks the signature and the age of the timestamp, and takes an id that it knows as told already.
"""

from __future__ import annotations

import asyncio
import base64
import hashlib
import hmac
import json
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime

import httpx
import structlog

from cellctl.domain.trouble import trouble_of
from cellctl.store import Store, webhooks
from cellctl.store.webhooks import SECRET_PREFIX, Hook, Letter

PERIOD_S = 1.0
ANSWER_S = 5.0  # a receiver that has not answered within this refuses
FIRST_WAIT_S, LAST_WAIT_S = 2.0, 600.0  # between tries, twice as long each time
GIVEN_UP_S = 3 * 86400.0  # of refusals and nothing else: it is paused, and goes on from there when somebody resumes it
AT_ONCE = 50  # letters read from the store
HELD_S = 30.0  # a host that takes no letter further for so long has died: another one tells the receiver
GONE = 410  # a receiver's word for: tell me nothing more
log = structlog.get_logger(__name__)


def signature(secret: str, ident: str, timestamp: int, body: bytes) -> str:
    """Of one letter."""
    key = base64.b64decode(secret.removeprefix(SECRET_PREFIX))
    return "v1," + base64.b64encode(hmac.digest(key, f"{ident}.{timestamp}.".encode() + body, hashlib.sha256)).decode()


def body_of(letter: Letter) -> bytes:
    """What is sent: type, timestamp (ISO 8601) and data."""
    at = datetime.fromtimestamp(letter.at, UTC).isoformat()
    return json.dumps({"type": letter.topic, "timestamp": at, "data": letter.data}, separators=(",", ":"), ensure_ascii=False).encode()


class Deliveries:
    """Call `run` as one task. cell : whose events are told; transport : how receivers are reached, for tests"""

    def __init__(self, store: Store, cell: str = "", transport: Callable[[], httpx.AsyncBaseTransport | None] = lambda: None) -> None:
        self._store = store
        self._cell = cell if store.is_shared else ""
        self._transport = transport
        self._under_way: dict[str, asyncio.Task[None]] = {}

    async def run(self) -> None:
        """Tell, for ever."""
        async with self._client() as client:
            try:
                while True:
                    try:
                        await self._look(client)
                    except Exception as error:
                        if trouble_of(error) is None:
                            log.exception("webhooks")
                    await asyncio.sleep(PERIOD_S)
            finally:
                await self._leave()

    def _client(self) -> httpx.AsyncClient:
        return httpx.AsyncClient(timeout=ANSWER_S, follow_redirects=False, trust_env=False, transport=self._transport())

    async def _look(self, client: httpx.AsyncClient) -> None:
        """Start a task for each receiver that has none under way and may have something to be told."""
        self._under_way = {key: task for key, task in self._under_way.items() if not task.done()}
        for hook in await asyncio.to_thread(self._due):
            if hook.id not in self._under_way:
                self._under_way[hook.id] = asyncio.create_task(self._tell(client, hook))

    async def tell_all(self) -> None:
        """Tell every receiver that is due what there is, once."""
        async with self._client() as client:
            await asyncio.gather(*(self._tell(client, hook) for hook in await asyncio.to_thread(self._due)))

    async def _leave(self) -> None:
        for task in self._under_way.values():
            task.cancel()
        await asyncio.gather(*self._under_way.values(), return_exceptions=True)

    def _due(self) -> list[Hook]:
        now = self._store.clock()
        with self._store.read() as rows:
            return [hook for hook in webhooks.every(rows) if not hook.paused and hook.next_at <= now]

    async def _tell(self, client: httpx.AsyncClient, hook: Hook) -> None:
        """One receiver's letters in order, until it has them all or refuses one; where hosts share, while no other one tells it."""
        try:
            if not self._store.is_shared:
                await self._tell_all(client, hook)
                return
            has_news = bool((await asyncio.to_thread(self._letters, hook))[0])
            taken = await asyncio.to_thread(self._take, hook) if has_news else None
            if taken is not None and await self._tell_all(client, taken):
                await asyncio.to_thread(self._passed, taken, {}, 0.0)
        except Exception as error:
            if trouble_of(error) is None:
                log.exception("webhook", hook=hook.id)

    async def _tell_all(self, client: httpx.AsyncClient, hook: Hook) -> bool:
        """Whether it has them all, and refused none."""
        while True:
            letters, secret = await asyncio.to_thread(self._letters, hook)
            if not letters:
                return True
            place: dict[str, int] = {}
            for letter in letters:
                reached = {**place, **({"step_seq": letter.step_seq} if letter.step_seq else {"event_seq": letter.event_seq})}
                if hook.wants(letter.topic):
                    refusal, is_gone = await send(client, hook.url, secret, letter, self._store.clock())
                    if refusal:
                        await asyncio.to_thread(self._refused, hook, refusal, is_gone)
                        return False
                    await asyncio.to_thread(self._taken, hook, reached)
                place = reached
            hook = await asyncio.to_thread(self._passed, hook, place, self._held_until())

    def _held_until(self) -> float:
        """Until when no other host tells this receiver; 0 where there is none."""
        return self._store.clock() + HELD_S if self._store.is_shared else 0.0

    def _take(self, hook: Hook) -> Hook | None:
        with self._store.write() as rows:
            return webhooks.take(rows, hook.id, self._store.clock(), self._held_until())

    def _letters(self, hook: Hook) -> tuple[list[Letter], str]:
        with self._store.read() as rows, self._store.read_cell() as cell_rows:
            place = webhooks.event_place(cell_rows, hook, self._store.is_shared)
            return webhooks.letters(rows, cell_rows, hook, place, AT_ONCE, self._cell), webhooks.secret_of(rows, hook.id)

    def _keep_place(self, hook: Hook, place: dict[str, int]) -> dict[str, int]:
        """Write down how far it was told of this host's events; what is left is for the shared tables."""
        if "event_seq" in place:
            with self._store.write_cell() as cell_rows:
                webhooks.set_event_place(cell_rows, hook.id, place["event_seq"])
        return {name: seq for name, seq in place.items() if name != "event_seq"}

    def _passed(self, hook: Hook, place: dict[str, int], next_at: float) -> Hook:
        """Nothing up to here is to be told to it any more; how it stands."""
        steps = self._keep_place(hook, place)
        with self._store.write() as rows:
            webhooks.change(rows, hook.id, **steps, next_at=next_at)
            return webhooks.get(rows, hook.id)

    def _taken(self, hook: Hook, place: dict[str, int]) -> None:
        """Durable before the next letter is sent: after a kill at most this one is told again."""
        steps = self._keep_place(hook, place)
        told = {"delivered_at": self._store.clock(), "failing_since": None, "failures": 0, "next_at": self._held_until(), "last_error": ""}
        with self._store.write() as rows:
            webhooks.change(rows, hook.id, **steps, **told)

    def _refused(self, hook: Hook, refusal: str, is_gone: bool) -> None:
        now = self._store.clock()
        since = hook.failing_since if hook.failing_since is not None else now
        paused = "the receiver said that it is gone (410)" if is_gone else ""
        if now - since > GIVEN_UP_S:
            paused = f"it took nothing for {GIVEN_UP_S / 86400:.0f} days: {refusal}"
        wait = min(FIRST_WAIT_S * 2.0 ** min(hook.failures, 20), LAST_WAIT_S)
        values = {"failing_since": since, "failures": hook.failures + 1, "next_at": now + wait, "last_error": refusal, "paused": paused}
        with self._store.write() as rows:
            webhooks.change(rows, hook.id, **values)
        log.warning("webhook refused", hook=hook.id, error=refusal, paused=bool(paused))


async def send(client: httpx.AsyncClient, url: str, secret: str, letter: Letter, now: float) -> tuple[str, bool]:
    """(why it was not taken, empty if it was; whether the receiver wants nothing more). A redirect is not followed: it is no yes."""
    body, timestamp = body_of(letter), int(now)
    headers = {
        "Content-Type": "application/json",
        "User-Agent": "hybridcell-webhooks",
        "webhook-id": letter.id,
        "webhook-timestamp": str(timestamp),
        "webhook-signature": signature(secret, letter.id, timestamp, body),
    }
    try:
        async with asyncio.timeout(2.0 * ANSWER_S), client.stream("POST", url, content=body, headers=headers) as answer:
            status = answer.status_code
    except (httpx.HTTPError, httpx.InvalidURL, TimeoutError) as error:
        said = ""
        with suppress(Exception):
            said = str(error).splitlines()[0][:200] if str(error) else ""
        return f"{type(error).__name__}: {said}".rstrip(": "), False
    return ("", False) if 200 <= status < 300 else (f"answered {status}", status == GONE)
