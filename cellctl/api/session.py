"""Signing in and out, by password or token, and the own password."""

from __future__ import annotations

import asyncio
import math
from functools import partial
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from cellctl import passwords
from cellctl.api.context import Service
from cellctl.api.models_people import OwnPassword, Session, SignIn
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import (
    COOKIE,
    Person,
    ServiceOf,
    Viewer,
    account_of,
    address_of,
    is_of_page,
    is_same_origin,
    not_signed_in,
)
from cellctl.store import audit, sessions, tokens, tries, users
from cellctl.store.audit import Deed
from cellctl.store.sessions import Account
from cellctl.store.tries import Try

router = APIRouter(prefix="/api/v1/session", tags=["session"], responses=DOCUMENTED)
UNKNOWN = "unknown"  # a name that is nobody's is not written down: it may be a password in the wrong field
WRONG = "name and password, or the token, are not right"


async def _begin(service: Service, one: Try) -> None:
    """Count the try. Raises ApiError 429 if it has to wait."""

    def begin() -> float:
        with service.store.write() as rows:
            return tries.begin(rows, one, service.store.clock())

    wait_s = await asyncio.to_thread(begin)
    if wait_s > 0:
        seconds = math.ceil(wait_s)
        hint = f"try again in {seconds} s; STOP needs no sign-in"
        raise ApiError(429, "Too many tries", "too many sign-ins failed", hint, {"Retry-After": str(seconds)})


async def _by_password(service: Service, name: str, password: str) -> Account | None:
    """The user, None for an unknown or disabled one or another password, all in the same time."""

    def found() -> users.UserRow | None:
        with service.store.read() as rows:
            return users.find(rows, name=name)

    user = await asyncio.to_thread(found)
    kept = user.password_hash if user is not None and user.disabled_at is None else None
    if not await service.turnstile.pass_through(partial(passwords.verified, kept, password)) or user is None:
        return None
    if passwords.is_outdated(user.password_hash):
        await _rehash(service, user, password)
    return sessions.of_user(user)


async def _rehash(service: Service, user: users.UserRow, password: str) -> None:
    renewed = await service.turnstile.pass_through(partial(passwords.hashed, password))

    def write() -> None:
        with service.store.write() as rows:
            users.rehash(rows, user, renewed)

    await asyncio.to_thread(write)


async def _by_token(service: Service, secret: str) -> Account | None:
    def found() -> tokens.TokenRow | None:
        with service.store.read() as rows:
            return tokens.find(rows, secret, service.store.clock())

    token = await asyncio.to_thread(found)
    return sessions.of_token(token) if token is not None else None


def _refuse(service: Service, one: Try, origin: str) -> None:
    with service.store.write() as rows:
        known = users.find(rows, name=one.account) if one.account else None
        who, role = (known.name, known.role.value) if known is not None else (UNKNOWN, "")
        audit.add(rows, Deed(who, role, origin, "sign in", "session", ""), service.store.clock(), "refused: wrong password or token")


def _open(service: Service, one: Try, account: Account, origin: str) -> str:
    now = service.store.clock()
    with service.store.write() as rows:
        tries.succeeded(rows, one, now)
        secret = sessions.open_for(rows, account, now)
        audit.add(rows, Deed(account.name, account.role.value, origin, "sign in", account.id, ""), now, "ok")
    return secret


def _document(service: Service, account: Account, request: Request, secret: str) -> Session:
    return Session(
        name=account.name,
        role=account.role,
        scopes=list(account.scopes),
        is_user=account.is_user,
        csrf=sessions.csrf_of(secret) if secret else "",
        stop_url=service.stop_url(request),
    )


@router.post("", status_code=200)
async def sign_in(body: SignIn, request: Request, response: Response, service: ServiceOf) -> Session:
    """Exchange a user's name and password, or a token, for a session cookie (HttpOnly, SameSite=Strict).

    Tries that fail are counted by account and address: after a few, each further one is waited for longer (429, Retry-After).
    """
    if not is_same_origin(request):
        raise ApiError(403, "Not allowed", "the request comes from another site", "open the console itself")
    origin = address_of(request)
    one = Try(users.plain_name(body.user or ""), origin)
    await _begin(service, one)
    if body.token is not None:
        account = await _by_token(service, body.token)
    else:
        account = await _by_password(service, body.user or "", body.password or "")
    if account is None:
        await asyncio.to_thread(_refuse, service, one, origin)
        raise not_signed_in(WRONG, "an admin can set a new password; `cellctl token create` makes a token")
    secret = await asyncio.to_thread(_open, service, one, account, origin)
    response.set_cookie(
        COOKIE,
        secret,
        max_age=int(sessions.SESSION_S),
        httponly=True,
        samesite="strict",
        secure=request.url.scheme == "https",
        path="/",
    )
    response.headers["Cache-Control"] = "no-store"
    return _document(service, account, request, secret)


@router.get("")
def session(person: Viewer, request: Request, response: Response, service: ServiceOf) -> Session:
    """Who is signed in."""
    account = _account(person)
    response.headers["Cache-Control"] = "no-store"
    return _document(service, account, request, request.cookies.get(COOKIE, "") if account.session else "")


def _account(person: Person) -> Account:
    assert person.account is not None  # let in by one
    return person.account


@router.delete("", status_code=204)
def sign_out(
    request: Request,
    service: ServiceOf,
    everywhere: Annotated[bool, Query(description="end every session of this user or token, at other browsers too")] = False,
) -> Response:
    """End the session; twice is harmless."""
    cookie, account = request.cookies.get(COOKIE), account_of(request, service)
    if account is not None and not is_of_page(request, account, request.method):
        raise ApiError(403, "Not allowed", "the request does not come from the session's own page", "load the page again")
    now = service.store.clock()
    if account is not None:
        with service.store.write() as rows:
            if cookie is not None:
                sessions.close(rows, cookie)
            if everywhere:
                sessions.close_all(rows, account)
            verb = "sign out everywhere" if everywhere else "sign out"
            audit.add(rows, Deed(account.name, account.role.value, address_of(request), verb, account.id, ""), now, "ok")
    response = Response(status_code=204)
    response.delete_cookie(COOKIE, path="/", httponly=True, samesite="strict")
    return response


@router.post("/password", status_code=204)
async def change_password(person: Viewer, body: OwnPassword, service: ServiceOf) -> None:
    """Change the own password. Every other session of this user ends."""
    account = _account(person)
    if not account.is_user:
        raise ApiError(409, "No password", f"{person.name} is a token", "tokens are made anew, they have no password")
    one = Try(account.name, person.origin)
    await _begin(service, one)
    if await _by_password(service, account.name, body.password) is None:
        await asyncio.to_thread(_refuse, service, one, person.origin)
        raise ApiError(403, "Not allowed", "the old password is not right", "an admin can set a new one")
    passwords.check(body.new_password, account.name)
    renewed = await service.turnstile.pass_through(partial(passwords.hashed, body.new_password))

    def write() -> None:
        now = service.store.clock()
        with service.store.write() as rows:
            tries.succeeded(rows, one, now)
            users.set_password(rows, account.name, renewed, now, account.session)
            audit.add(rows, person.deed("change own password", account.id), now, "ok")

    await asyncio.to_thread(write)
