"""Tokens: made, listed and revoked by an admin; the secret is shown once."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter
from sqlalchemy import Connection

from cellctl.api.idempotent import IdempotencyKey, once, refuse_secret_again
from cellctl.api.models_people import FreshToken, NewToken, Token, Tokens
from cellctl.api.problems import DOCUMENTED
from cellctl.api.sign_in import Admin, ServiceOf
from cellctl.store import audit, tokens
from cellctl.store.tokens import TokenRow

router = APIRouter(prefix="/api/v1/tokens", tags=["tokens"], responses=DOCUMENTED)


def document(row: TokenRow) -> Token:
    """A token as it is told."""
    return Token(**{**row.__dict__, "scopes": list(row.scopes)})


@router.get("")
def list_tokens(_person: Admin, service: ServiceOf) -> Tokens:
    """All tokens, oldest first, without their secrets."""
    with service.store.read() as rows:
        return Tokens(items=[document(row) for row in tokens.every(rows)])


@router.post("", status_code=201)
def create_token(person: Admin, service: ServiceOf, body: NewToken, idempotency_key: IdempotencyKey = None) -> FreshToken:
    """A new token. 409 if the Idempotency-Key made one already: its secret was told once."""
    told: list[str] = []

    def make(rows: Connection) -> dict[str, Any]:
        now = service.store.clock()
        row, secret = tokens.create(rows, body.name, body.role, now, body.lifetime_s, body.scopes)
        audit.add(rows, person.deed("create token", row.id), now, f"ok: {row.role.value} for {row.name}, good for {', '.join(row.scopes)}")
        told.append(secret)
        return document(row).model_dump(mode="json")

    answer, is_new = once(service, person, idempotency_key, ("token", body.model_dump(mode="json")), make)
    if not is_new:
        refuse_secret_again("the token", answer["id"])
    return FreshToken(**answer, secret=told[0])


@router.delete("/{token_id}")
def revoke_token(person: Admin, service: ServiceOf, token_id: str) -> Token:
    """End a token and its sessions. Twice is harmless."""
    now = service.store.clock()
    with service.store.write() as rows:
        row = tokens.revoke(rows, token_id, now)
        audit.add(rows, person.deed("revoke token", token_id), now, "ok")
    return document(row)
