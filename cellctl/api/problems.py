"""Errors as problem documents (RFC 9457): one place that maps every exception to a status, a title, one line and a hint."""

from __future__ import annotations

import re
from typing import Any

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field, model_validator
from sqlalchemy.exc import DataError
from starlette.exceptions import HTTPException

from cellctl import faults
from cellctl.domain.jobs import WrongJobStateError
from cellctl.domain.trouble import trouble_of
from cellctl.store.dependencies import CycleError
from cellctl.store.idempotency import KeyReusedError
from cellctl.store.pages import CursorError
from cellctl.store.parts import NotFoundError

MEDIA_TYPE = "application/problem+json"
log = structlog.get_logger(__name__)


TYPES = "urn:hybridcell:problem:"


def type_of(title: str) -> str:
    """The stable name (URI) of a kind of problem, from its title: urn:hybridcell:problem:not-found."""
    return TYPES + "-".join(re.findall(r"[a-z0-9]+", title.lower()))


class Problem(BaseModel):
    """A problem document. `type` names the kind for programs and stays; `detail` is one line for a person, `hint` says what to do."""

    type: str = ""
    title: str
    status: int
    detail: str = ""
    hint: str = ""
    instance: str = ""
    errors: list[dict[str, str]] = Field(
        default_factory=list, description="field by field, for a request that breaks its schema: field, error, value, bound, unit"
    )

    @model_validator(mode="after")
    def _named(self) -> Problem:
        self.type = self.type or type_of(self.title)
        return self


class ApiError(Exception):
    """A refusal with its status and words. errors : field by field"""

    def __init__(
        self,
        status: int,
        title: str,
        detail: str,
        hint: str = "",
        headers: dict[str, str] | None = None,
        errors: list[dict[str, str]] | None = None,
    ) -> None:
        super().__init__(detail)
        self.status = status
        self.title = title
        self.detail = detail
        self.hint = hint
        self.headers = headers
        self.errors = errors or []


def response(problem: Problem, headers: dict[str, str] | None = None) -> JSONResponse:
    """The document as an answer."""
    return JSONResponse(problem.model_dump(), problem.status, headers, media_type=MEDIA_TYPE)


REFERENCE = {"$ref": "#/components/schemas/Problem"}
DOCUMENTED: dict[int | str, dict[str, Any]] = {
    "4XX": {
        "description": "Refused: the document says what, where and what to do",
        "content": {MEDIA_TYPE: {"schema": REFERENCE}},
    },
    "5XX": {"description": "Failed: the document says why", "content": {MEDIA_TYPE: {"schema": REFERENCE}}},
}


async def _refused(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, ApiError)
    problem = Problem(
        title=error.title,
        status=error.status,
        detail=faults.one_line(error.detail),
        hint=error.hint,
        instance=request.url.path,
        errors=error.errors,
    )
    return response(problem, error.headers)


async def _http(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    if error.status_code == 400 and trouble_of(error) is not None:  # an upload that the disk has no room for is not the sender's fault
        return await _any(request, error)
    titles = {404: "Not found", 405: "Method not allowed", 400: "Bad request", 413: "Too large"}
    status, detail, headers = error.status_code, str(error.detail), dict(error.headers or {})
    if status in (404, 405):
        allowed = allowed_at(request)
        status = 405 if allowed and request.method not in allowed else 404
        detail = f"there is nothing at {request.url.path}" if status == 404 else f"{request.url.path} has no {request.method}"
        headers = {"Allow": ", ".join(allowed)} if status == 405 else {}
    problem = Problem(title=titles.get(status, detail), status=status, detail=detail, instance=request.url.path)
    return response(problem, headers or None)


def allowed_at(request: Request) -> list[str]:
    """Methods of everything that the interface has at the request's path; the pages outside of /api/ can be read."""
    found: set[str] = set()
    for pattern, methods in _patterns(request.app):
        if pattern.fullmatch(request.url.path):
            found |= methods
    if not found and not request.url.path.startswith("/api/"):
        found = {"GET", "HEAD"}
    return sorted(found)


def _patterns(app: FastAPI) -> list[tuple[re.Pattern[str], set[str]]]:
    """What the interface describes: a pattern of each path and its methods. Who can be read can be asked for without its body."""
    if not hasattr(app.state, "path_patterns"):
        known = []
        for template, operations in app.openapi()["paths"].items():
            methods = {name.upper() for name in operations if name.upper() in METHODS}
            pattern = re.compile("".join(PARAMETER if piece[:1] == "{" else re.escape(piece) for piece in BRACES.split(template)))
            known.append((pattern, methods | ({"HEAD"} if "GET" in methods else set())))
        app.state.path_patterns = known
    patterns: list[tuple[re.Pattern[str], set[str]]] = app.state.path_patterns
    return patterns


METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
BRACES = re.compile(r"(\{[^}]*\})")
PARAMETER = "[^/]+"


async def _invalid(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    errors = []
    for item in error.errors()[:20]:
        where = ".".join(str(step) for step in item["loc"] if step != "body") or "body"
        errors.append({"field": where, "error": faults.one_line(str(item["msg"]))})
    first = errors[0]
    more = f"; and {len(errors) - 1} more" if len(errors) > 1 else ""
    problem = Problem(
        title="The request does not fit",
        status=422,
        detail=f"{first['field']}: {first['error']}{more}",
        hint="the schema is in /openapi.json",
        instance=request.url.path,
        errors=errors,
    )
    return response(problem)


def _known(error: Exception) -> Problem | None:
    """Errors of the domain and of the other packages, None for those that are ours."""
    if isinstance(error, NotFoundError):
        return Problem(title="Not found", status=404, detail=str(error))
    if isinstance(error, WrongJobStateError):
        return Problem(title="Not in this state", status=409, detail=str(error), hint="look at the job's state")
    if isinstance(error, CycleError):
        return Problem(title="A circle of dependencies", status=409, detail=str(error), hint="leave one of them out")
    if isinstance(error, KeyReusedError):
        return Problem(
            title="Idempotency-Key reused", status=422, detail=str(error), hint="use a new key for a new request"
        )
    if isinstance(error, CursorError):
        return Problem(title="The cursor does not fit", status=422, detail=str(error), hint="pass on what `next` said")
    fault = faults.explain(error)
    if fault is None:
        return _unfit(error)
    return Problem(title=fault.title, status=fault.status, detail=fault.detail, hint=fault.hint)


def _unfit(error: Exception) -> Problem | None:
    """A text or number that PostgreSQL cannot keep, such as one with a NUL in it."""
    if not isinstance(error, DataError):
        return None
    return Problem(title="The request does not fit", status=422, detail=faults.one_line(str(error.orig)), hint="leave out what cannot be kept")


async def _any(request: Request, error: Exception) -> JSONResponse:
    problem = _known(error)
    if problem is None:
        log.error("request failed", path=request.url.path, exc_info=error)
        problem = Problem(
            title="Internal fault",
            status=500,
            detail=f"{type(error).__name__} in the service",
            hint="the service's log has the details",
        )
    problem.instance = request.url.path
    return response(problem)


def install(app: FastAPI) -> None:
    """Put every handler in place."""
    app.add_exception_handler(ApiError, _refused)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(RequestValidationError, _invalid)
    errors: list[type[Exception]] = [
        NotFoundError,
        WrongJobStateError,
        KeyReusedError,
        CursorError,
        CycleError,
        *_packages_errors(),
    ]
    for known in errors:
        app.add_exception_handler(known, _any)
    app.add_exception_handler(Exception, _any)


def _packages_errors() -> list[type[Exception]]:
    from sqlalchemy.exc import SQLAlchemyError

    from cellctl.passwords import PasswordError
    from cellctl.store import StoreError
    from cellctl.store.users import LastAdminError, UserNameError
    from config import ConfigError
    from planner.errors import PlannerError

    return [ConfigError, PlannerError, StoreError, PasswordError, LastAdminError, UserNameError, SQLAlchemyError, OSError]
