"""Webhooks: who outside is told what happens here; for admins."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any
from urllib.parse import urlsplit

import httpx
from fastapi import APIRouter, Response
from pydantic import BaseModel, Field
from sqlalchemy import Connection

from cellctl.api.idempotent import IdempotencyKey, once, refuse_secret_again
from cellctl.api.models import Strict
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import Admin, Person, ServiceOf
from cellctl.api.webhook_delivery import ANSWER_S, send
from cellctl.store import audit, history, webhooks
from cellctl.store.webhooks import TOPICS, Hook, Letter

router = APIRouter(prefix="/api/v1/webhooks", tags=["webhooks"], responses=DOCUMENTED)
HOOKS_MAX = 50


class NewWebhook(Strict):
    """A receiver. topics: such as job.completed, job.*, cell.alarm; https, or http where nobody else listens on the way."""

    url: str = Field(min_length=1, max_length=500)
    topics: list[Annotated[str, Field(max_length=60)]] = Field(min_length=1, max_length=60)


class Webhook(BaseModel):
    """A receiver without its secret. failing_since: Unix s, null while it takes; paused: why it is told nothing more"""

    id: str
    url: str
    topics: list[str]
    created_at: float
    created_by: str
    delivered_at: float | None
    failing_since: float | None
    failures: int
    last_error: str
    paused: str


class FreshWebhook(Webhook):
    """A receiver with the secret that its letters are signed with (Standard Webhooks), which is shown this once."""

    secret: str


class Webhooks(BaseModel):
    """All receivers, and what there is to be told of."""

    items: list[Webhook]
    topics: list[str]


class TestLetter(BaseModel):
    """What came of a test. error: empty if the receiver took it"""

    taken: bool
    error: str


def _document(hook: Hook) -> Webhook:
    return Webhook(**{name: getattr(hook, name) for name in Webhook.model_fields if name != "topics"}, topics=list(hook.topics))


def _check(body: NewWebhook) -> tuple[str, ...]:
    """The topics, each once. Raises ApiError 422."""
    try:
        parts = urlsplit(body.url)
        is_fine = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.username is None and parts.port != 0
        httpx.URL(body.url)
    except (ValueError, httpx.InvalidURL):
        is_fine = False
    if not is_fine:
        raise ApiError(422, "The request does not fit", f"url: {body.url[:80]!r} is no address of http or https without a password", "https://host/path")
    unknown = [topic for topic in body.topics if topic not in TOPICS]
    if unknown:
        raise ApiError(422, "The request does not fit", f"topics: there is no {unknown[0][:60]!r}", f"one of {', '.join(TOPICS)}")
    return tuple(dict.fromkeys(body.topics))


def _note(person: Person, verb: str, hook: Hook) -> audit.Deed:
    return person.deed(verb, hook.id, hook.url)


@router.get("")
def list_webhooks(_person: Admin, service: ServiceOf) -> Webhooks:
    """All receivers, how each does, and the topics."""
    with service.store.read() as rows:
        return Webhooks(items=[_document(hook) for hook in webhooks.every(rows)], topics=list(TOPICS))


@router.post("", status_code=201)
def add_webhook(person: Admin, service: ServiceOf, body: NewWebhook, idempotency_key: IdempotencyKey = None) -> FreshWebhook:
    """Add a receiver. It is told of what happens from now on: in order, signed, and again until it answers with 2xx."""
    topics, told = _check(body), []

    def make(rows: Connection) -> dict[str, Any]:
        if len(webhooks.every(rows)) >= HOOKS_MAX:
            raise ApiError(409, "Too many webhooks", f"there are {HOOKS_MAX} already", "remove one that nobody needs")
        now = service.store.clock()
        with service.store.read_cell() as cell_rows:
            newest = history.last_seq(cell_rows)
        hook, secret = webhooks.create(rows, body.url, topics, now, person.name, newest)
        audit.add(rows, _note(person, "add webhook", hook), now, "ok")
        told.append(secret)
        return _document(hook).model_dump()

    answer, is_new = once(service, person, idempotency_key, ("webhook", body.url, list(topics)), make)
    if not is_new:
        refuse_secret_again("the webhook", answer["id"])
    return FreshWebhook(**answer, secret=told[0])


@router.get("/{hook_id}")
def get_webhook(_person: Admin, service: ServiceOf, hook_id: str) -> Webhook:
    """One receiver."""
    with service.store.read() as rows:
        return _document(webhooks.get(rows, hook_id))


@router.delete("/{hook_id}", status_code=204)
def remove_webhook(person: Admin, service: ServiceOf, hook_id: str) -> Response:
    """Tell it nothing more."""
    now = service.store.clock()
    with service.store.write() as rows:
        hook = webhooks.get(rows, hook_id)
        webhooks.remove(rows, hook_id)
        audit.add(rows, _note(person, "remove webhook", hook), now, "ok")
    return Response(status_code=204)


@router.post("/{hook_id}/resume")
def resume_webhook(person: Admin, service: ServiceOf, hook_id: str) -> Webhook:
    """Tell a receiver that was paused, or that refuses, again: now, and from where it stopped."""
    now = service.store.clock()
    with service.store.write() as rows:
        hook = webhooks.resume(rows, hook_id)
        audit.add(rows, _note(person, "resume webhook", hook), now, "ok")
    return _document(hook)


@router.post("/{hook_id}/test")
async def test_webhook(_person: Admin, service: ServiceOf, hook_id: str) -> TestLetter:
    """Send one letter of the topic `test` now."""

    def look() -> tuple[Hook, str]:
        with service.store.read() as rows:
            return webhooks.get(rows, hook_id), webhooks.secret_of(rows, hook_id)

    hook, secret = await asyncio.to_thread(look)
    now = service.store.clock()
    letter = Letter(f"test-{hook.id}-{now:.3f}", "test", now, {"webhook": hook.id})
    async with httpx.AsyncClient(timeout=ANSWER_S, follow_redirects=False, trust_env=False) as client:
        error, _ = await send(client, hook.url, secret, letter, now)
    return TestLetter(taken=not error, error=error)
