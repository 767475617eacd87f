"""Who asks: a bearer token, or the cookie of a session; what each role may do is said at the routes."""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Annotated
from urllib.parse import urlsplit

from fastapi import APIRouter, Depends, Request, Response
from fastapi.security import APIKeyCookie, HTTPBearer
from starlette.requests import HTTPConnection

from cellctl.api.context import Service, service_of
from cellctl.api.models import Session, SignIn
from cellctl.api.problems import ApiError
from cellctl.store import audit, tokens
from cellctl.store.audit import Deed
from cellctl.store.tokens import Role, TokenRow

COOKIE = "cellctl_session"
CLIENT_HEADER = "X-Client-Id"
CLIENT_ID = re.compile(r"[A-Za-z0-9._@-]{1,64}")
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})

# Only for the OpenAPI document: the schemes are read by `person_of`.
bearer_scheme = HTTPBearer(auto_error=False, description="a token made by `cellctl token create`")
cookie_scheme = APIKeyCookie(name=COOKIE, auto_error=False, description="set by POST /api/v1/session")


@dataclass(frozen=True)
class Person:
    """Somebody who was let in. origin : address; client : which console or program of that person asks"""

    name: str
    role: Role
    origin: str
    client: str = ""

    def deed(self, verb: str, target: str, because: str = "") -> Deed:
        """What this person does, for the audit trail."""
        return Deed(self.name, self.role.value, self.origin, verb, target, because)


def is_same_origin(connection: HTTPConnection) -> bool:
    """Whether a page of this service sent it: Origin, where there is one, names our own host."""
    origin = connection.headers.get("origin")
    try:
        return origin is None or urlsplit(origin).netloc == connection.headers.get("host", "")
    except ValueError:  # no address at all
        return False


def token_of(connection: HTTPConnection, service: Service) -> TokenRow | None:
    """The valid token behind a request, None without one. A cookie counts only for requests of our own pages."""
    scheme, _, secret = connection.headers.get("authorization", "").partition(" ")
    now = service.store.clock()
    if scheme:
        if scheme.lower() != "bearer":
            return None
        with service.store.read() as rows:
            return tokens.find(rows, secret.strip(), now)
    cookie = connection.cookies.get(COOKIE)
    if cookie is None or not is_same_origin(connection):
        return None
    with service.store.read() as rows:
        return tokens.find_by_session(rows, cookie, now)


def person_of(connection: HTTPConnection, service: Service) -> Person | None:
    """Who asks, None if nobody that is known."""
    token = token_of(connection, service)
    if token is None:
        return None
    return Person(token.name, token.role, connection.client.host if connection.client else "", client_of(connection, token))


def client_of(connection: HTTPConnection, token: TokenRow) -> str:
    """Which client of a person asks: what it calls itself, else its token. Raises ApiError 422 for a name that is none."""
    given = connection.headers.get(CLIENT_HEADER, "")
    if given and not CLIENT_ID.fullmatch(given):
        raise ApiError(422, "The request does not fit", f"{CLIENT_HEADER} is no name", "letters, digits and . _ @ -, at most 64")
    return f"{token.name}/{given or f'token-{token.id[-6:]}'}"


def is_let_in(connection: HTTPConnection, service: Service, role: Role) -> bool:
    """Whether somebody with this role, or one above it, asks."""
    person = person_of(connection, service)
    return person is not None and person.role.includes(role)


def needs(role: Role) -> Callable[..., Awaitable[Person]]:
    """A dependency that lets in this role and those above it. Raises ApiError 401 or 403.

    The row is read in the event loop: that takes less than the way to a thread and back, which may be long while others compute.
    """

    async def let_in(
        request: Request,
        _bearer: Annotated[object, Depends(bearer_scheme)] = None,
        _cookie: Annotated[object, Depends(cookie_scheme)] = None,
    ) -> Person:
        person = person_of(request, service_of(request))
        if person is None:
            raise ApiError(
                401,
                "Not signed in",
                "this needs a valid token",
                "sign in with a token from `cellctl token create`",
                {"WWW-Authenticate": "Bearer"},
            )
        if not person.role.includes(role):
            raise ApiError(
                403,
                "Not allowed",
                f"this needs the role {role.value}; {person.name} is {person.role.value}",
                "ask for another token",
            )
        return person

    return let_in


async def the_service(connection: HTTPConnection) -> Service:
    """`service_of` as a dependency that needs no thread."""
    return service_of(connection)


Viewer = Annotated[Person, Depends(needs(Role.VIEWER))]
Operator = Annotated[Person, Depends(needs(Role.OPERATOR))]
Admin = Annotated[Person, Depends(needs(Role.ADMIN))]
ServiceOf = Annotated[Service, Depends(the_service)]
router = APIRouter(prefix="/api/v1/session", tags=["session"])


@router.post("", status_code=200)
def sign_in(body: SignIn, request: Request, response: Response, service: ServiceOf) -> Session:
    """Exchange a token for a session cookie (HttpOnly, SameSite=Strict)."""
    if not is_same_origin(request):
        raise ApiError(403, "Not allowed", "the request comes from another site", "open the console itself")
    store, now = service.store, service.store.clock()
    origin = request.client.host if request.client else ""
    with store.write() as rows:
        token = tokens.find(rows, body.token, now)
        if token is not None:
            secret = tokens.open_session(rows, token, now)
            audit.add(rows, Deed(token.name, token.role.value, origin, "sign in", token.id, ""), now, "ok")
    if token is None:
        raise ApiError(
            401,
            "Not signed in",
            "this token is not valid",
            "make one with `cellctl token create`",
            {"WWW-Authenticate": "Bearer"},
        )
    response.set_cookie(
        COOKIE,
        secret,
        max_age=int(tokens.SESSION_S),
        httponly=True,
        samesite="strict",
        secure=request.url.scheme == "https",
        path="/",
    )
    return Session(name=token.name, role=token.role, stop_url=service.stop_url(request))


@router.get("")
def session(person: Viewer, request: Request, service: ServiceOf) -> Session:
    """Who is signed in."""
    return Session(name=person.name, role=person.role, stop_url=service.stop_url(request))


@router.delete("", status_code=204)
def sign_out(request: Request, service: ServiceOf) -> Response:
    """End the session; twice is harmless."""
    cookie = request.cookies.get(COOKIE)
    if cookie is not None and is_same_origin(request):
        with service.store.write() as rows:
            tokens.close_session(rows, cookie)
    response = Response(status_code=204)
    response.delete_cookie(COOKIE, path="/", httponly=True, samesite="strict")
    return response
