"""Users: made, listed and changed by an admin."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import Any

from fastapi import APIRouter
from sqlalchemy import Connection

from cellctl import passwords
from cellctl.api.idempotent import IdempotencyKey, once
from cellctl.api.models_people import FreshPassword, NewUser, User, UserChange, Users
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import Admin, ServiceOf
from cellctl.store import audit, users
from cellctl.store.users import UserRow

router = APIRouter(prefix="/api/v1/users", tags=["users"], responses=DOCUMENTED)


def document(row: UserRow) -> User:
    """A user as it is told: without the password's hash."""
    return User(name=row.name, role=row.role, created_at=row.created_at, password_at=row.password_at, disabled_at=row.disabled_at)


@router.get("")
def list_users(_person: Admin, service: ServiceOf) -> Users:
    """All users by name, disabled ones too."""
    with service.store.read() as rows:
        return Users(items=[document(row) for row in users.every(rows)])


@router.post("", status_code=201)
async def create_user(person: Admin, service: ServiceOf, body: NewUser, idempotency_key: IdempotencyKey = None) -> User:
    """A new user. 409 if there is one of this name. No hash of the password goes into the memory of the Idempotency-Key."""
    passwords.check(body.password, body.name)
    kept = await service.turnstile.pass_through(partial(passwords.hashed, body.password))

    def make(rows: Connection) -> dict[str, Any]:
        now = service.store.clock()
        if users.find(rows, name=body.name) is not None:
            raise ApiError(409, "The name is taken", f"there is a user {users.plain_name(body.name)} already", "take another name")
        row = users.create(rows, body.name, body.role, kept, now)
        audit.add(rows, person.deed("create user", row.name), now, f"ok: {row.role.value}")
        return document(row).model_dump(mode="json")

    answer, _ = await asyncio.to_thread(once, service, person, idempotency_key, ("user", body.name, body.role.value), make)
    return User(**answer)


@router.get("/{name}")
def get_user(_person: Admin, service: ServiceOf, name: str) -> User:
    """One user."""
    with service.store.read() as rows:
        return document(users.get(rows, name))


@router.patch("/{name}")
def change_user(person: Admin, service: ServiceOf, name: str, body: UserChange) -> User:
    """Another role, or disabled (its sessions end) or enabled again; at once. The last admin stays one."""
    now = service.store.clock()
    with service.store.write() as rows:
        row = users.get(rows, name)
        if body.role is not None:
            row = users.set_role(rows, name, body.role)
            audit.add(rows, person.deed("change role", row.name, body.because), now, f"ok: {row.role.value}")
        if body.disabled is not None:
            row = users.set_disabled(rows, name, body.disabled, now)
            audit.add(rows, person.deed("disable user" if body.disabled else "enable user", row.name, body.because), now, "ok")
    return document(row)


@router.post("/{name}/password", status_code=204)
async def set_password(person: Admin, service: ServiceOf, name: str, body: FreshPassword) -> None:
    """Set somebody's password; every session of that user ends. The own one is changed at /api/v1/session/password."""
    account = person.account
    if account is not None and account.is_user and account.name == users.plain_name(name):
        raise ApiError(409, "Your own password", "it is changed with the old one", "POST /api/v1/session/password")

    def known() -> UserRow:
        with service.store.read() as rows:
            return users.get(rows, name)

    row = await asyncio.to_thread(known)
    passwords.check(body.password, row.name)
    kept = await service.turnstile.pass_through(partial(passwords.hashed, body.password))

    def write() -> None:
        now = service.store.clock()
        with service.store.write() as rows:
            users.set_password(rows, row.name, kept, now)
            audit.add(rows, person.deed("set password", row.name, body.because), now, "ok")

    await asyncio.to_thread(write)
