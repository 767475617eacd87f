"""Who asks: a bearer token, or the cookie of a session; what each role may do is said at the routes, what a token is good for here."""

from __future__ import annotations

import asyncio
import hmac
import re
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Annotated
from urllib.parse import urlsplit

from fastapi import Depends, Request
from fastapi.security import APIKeyCookie, HTTPBearer
from sqlalchemy import Connection
from sqlalchemy.exc import SQLAlchemyError
from starlette.requests import HTTPConnection

from cellctl.api.acquaintance import ASKED_S
from cellctl.api.context import Service, service_of
from cellctl.api.problems import ApiError
from cellctl.domain.trouble import trouble_of
from cellctl.store import sessions, tokens
from cellctl.store.audit import Deed
from cellctl.store.sessions import Account
from cellctl.store.tokens import ALL_SCOPES, Role, Scope

COOKIE = "cellctl_session"
CLIENT_HEADER = "X-Client-Id"
CSRF_HEADER = "X-CSRF-Token"
SESSION_CHANGED = {"X-Session-Changed": "1"}  # tells the page to ask again who is signed in
CLIENT_ID = re.compile(r"[A-Za-z0-9._@-]{1,64}")
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
STOP_PATH = "/api/v1/cell/stop"  # the page's last way to STOP, which is not refused for want of a word of the page
CELL_PATH = "/api/v1/cell/"
PEOPLE_PATHS = ("/api/v1/users", "/api/v1/tokens")
SESSION_PATH = "/api/v1/session"

# Only for the OpenAPI document: the schemes are read by `person_of`.
bearer_scheme = HTTPBearer(auto_error=False, description="a token made by `cellctl token create`")
cookie_scheme = APIKeyCookie(
    name=COOKIE, auto_error=False, description=f"set by POST {SESSION_PATH}; what changes something needs {CSRF_HEADER} beside it"
)


@dataclass(frozen=True)
class Person:
    """Somebody who was let in. origin : address; client : which console or program of that person asks"""

    name: str
    role: Role
    origin: str
    client: str = ""
    scopes: tuple[Scope, ...] = ALL_SCOPES
    account: Account | None = None

    def deed(self, verb: str, target: str, because: str = "") -> Deed:
        """What this person does, for the audit trail."""
        return Deed(self.name, self.role.value, self.origin, verb, target, because)


def is_same_origin(connection: HTTPConnection) -> bool:
    """Whether a page of this service sent it: Origin, where there is one, names our own host, and the browser says no other site."""
    if connection.headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none"):
        return False
    origin = connection.headers.get("origin")
    try:
        return origin is None or urlsplit(origin).netloc == connection.headers.get("host", "")
    except ValueError:  # no address at all
        return False


def account_of(connection: HTTPConnection, service: Service) -> Account | None:
    """The account behind a request, None without one. A cookie counts only for requests of our own pages. May block on a shared database."""
    scheme, _, secret = connection.headers.get("authorization", "").partition(" ")
    now = service.store.clock()
    if scheme:
        if scheme.lower() != "bearer":
            return None

        def by_token(rows: Connection) -> Account | None:
            token = tokens.find(rows, secret.strip(), now)
            return sessions.of_token(token) if token is not None else None

        return _looked_up(service, secret.strip(), by_token, now)
    cookie = connection.cookies.get(COOKIE)
    if cookie is None or not is_same_origin(connection):
        return None
    heard_at = service.presence.heard_at(cookie)
    account = _looked_up(service, cookie, lambda rows: sessions.find(rows, cookie, now, heard_at), now)
    if account is not None:
        service.presence.heard(account.session, now)
    return account


def _looked_up(service: Service, secret: str, find: Callable[[Connection], Account | None], now: float) -> Account | None:
    """Who the store says this is; while a shared one is away, who it said this was."""
    store, seen = service.store, service.acquaintance
    if store.is_shared and seen.is_away and (account := seen.recall(secret, now)) is not None:
        return account
    try:
        with store.read() as rows:
            account = find(rows)
    except SQLAlchemyError as error:
        if not store.is_shared or trouble_of(error) is None:
            raise
        seen.went_away()
        if (account := seen.recall(secret, now)) is None:
            raise
        return account
    if store.is_shared:
        seen.told(secret, account, now)
    return account


async def person_soon(connection: HTTPConnection, service: Service) -> Person | None:
    """`person_of` in the event loop: a row of a file takes less than the way to a thread and back, which may be long while others compute.

    A shared database is asked in a thread; who is known already waits for it for ASKED_S at most.
    """
    seen = service.acquaintance
    if not service.store.is_shared:
        return person_of(connection, service)
    asked = asyncio.ensure_future(asyncio.to_thread(person_of, connection, service))
    await asyncio.wait({asked}, timeout=ASKED_S)
    if asked.done():
        return asked.result()
    asked.add_done_callback(lambda late: late.exception() if not late.cancelled() else None)
    seen.went_away()
    return await asyncio.to_thread(person_of, connection, service)


def person_of(connection: HTTPConnection, service: Service) -> Person | None:
    """Who asks, None if nobody that is known. Raises ApiError 422 for a client's name that is none."""
    account = account_of(connection, service)
    if account is None:
        return None
    return Person(account.name, account.role, address_of(connection), client_of(connection, account), account.scopes, account)


def address_of(connection: HTTPConnection) -> str:
    """Where a request comes from."""
    return connection.client.host if connection.client else ""


def client_of(connection: HTTPConnection, account: Account) -> str:
    """Which client of a person asks: what it calls itself, else its token. Raises ApiError 422 for a name that is none."""
    given = connection.headers.get(CLIENT_HEADER, "")
    if given and not CLIENT_ID.fullmatch(given):
        raise ApiError(422, "The request does not fit", f"{CLIENT_HEADER} is no name", "letters, digits and . _ @ -, at most 64")
    own = f"{'user' if account.is_user else 'token'}-{account.id[-6:]}"
    return f"{account.name}/{given or own}"


def is_of_page(connection: HTTPConnection, account: Account, method: str) -> bool:
    """Whether what rides on a cookie and changes something brings the word of the session's own page."""
    if not account.session or method in SAFE_METHODS or connection.scope["path"] == STOP_PATH:
        return True
    expected = sessions.csrf_of(connection.cookies.get(COOKIE, ""))
    return hmac.compare_digest(connection.headers.get(CSRF_HEADER, "").encode("utf-8", "replace"), expected.encode())


def scope_of(method: str, path: str) -> Scope | None:
    """What a token must be good for to ask this; None for what concerns the own session only."""
    if path == SESSION_PATH or path.startswith(f"{SESSION_PATH}/"):
        return None
    if path.startswith(PEOPLE_PATHS):
        return Scope.ADMIN
    if method in SAFE_METHODS:
        return Scope.READ
    return Scope.CELL if path.startswith(CELL_PATH) else Scope.JOBS


def is_let_in(connection: HTTPConnection, service: Service, role: Role) -> bool:
    """Whether somebody with this role, or one above it, asks for what it may have."""
    try:
        person = person_of(connection, service)
    except ApiError:
        return False  # the route says why
    if person is None or person.account is None or not person.role.includes(role):
        return False
    method = connection.scope.get("method", "GET")
    return scope_of(method, connection.scope["path"]) in (None, *person.scopes) and is_of_page(connection, person.account, method)


def needs(role: Role) -> Callable[..., Awaitable[Person]]:
    """A dependency that lets in this role and those above it. Raises ApiError 401 or 403."""

    async def let_in(
        request: Request,
        _bearer: Annotated[object, Depends(bearer_scheme)] = None,
        _cookie: Annotated[object, Depends(cookie_scheme)] = None,
    ) -> Person:
        person = await person_soon(request, service_of(request))
        if person is None or person.account is None:
            raise not_signed_in("this needs a valid token or session", "sign in, or send a token from `cellctl token create`")
        _check(person, person.account, request, role)
        return person

    return let_in


def not_signed_in(detail: str, hint: str) -> ApiError:
    """401."""
    return ApiError(401, "Not signed in", detail, hint, {"WWW-Authenticate": "Bearer"})


def _check(person: Person, account: Account, request: Request, role: Role) -> None:
    """Raises ApiError 403."""
    if not is_of_page(request, account, request.method):
        raise ApiError(
            403,
            "Not allowed",
            f"the request lacks the {CSRF_HEADER} of its session",
            "load the page again; programs send a token instead of the cookie",
            SESSION_CHANGED,
        )
    if not person.role.includes(role):
        raise ApiError(
            403,
            "Not allowed",
            f"this needs the role {role.value}; {person.name} is {person.role.value}",
            "ask an admin for another role or token",
        )
    scope = scope_of(request.method, request.scope["path"])
    if scope is not None and scope not in person.scopes:
        detail = f"this needs a token good for {scope.value}; {person.name}'s is good for {', '.join(person.scopes)}"
        raise ApiError(403, "Not allowed", detail, "use another token")


async def the_service(connection: HTTPConnection) -> Service:
    """`service_of` as a dependency that needs no thread."""
    return service_of(connection)


Viewer = Annotated[Person, Depends(needs(Role.VIEWER))]
Operator = Annotated[Person, Depends(needs(Role.OPERATOR))]
Engineer = Annotated[Person, Depends(needs(Role.ENGINEER))]
Admin = Annotated[Person, Depends(needs(Role.ADMIN))]
ServiceOf = Annotated[Service, Depends(the_service)]
