"""Errors as problem documents (RFC 9457): one place that maps every exception to a status, a title, one line and a hint."""

from __future__ import annotations

from typing import Any

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException

from cellctl import faults
from cellctl.domain.jobs import WrongJobStateError
from cellctl.domain.trouble import trouble_of
from cellctl.store.idempotency import KeyReusedError
from cellctl.store.pages import CursorError
from cellctl.store.parts import NotFoundError

MEDIA_TYPE = "application/problem+json"
log = structlog.get_logger(__name__)


class Problem(BaseModel):
    """A problem document. `detail` is one line for a person, `hint` says what to do."""

    type: str = "about:blank"
    title: str
    status: int
    detail: str = ""
    hint: str = ""
    instance: str = ""
    errors: list[dict[str, str]] = Field(
        default_factory=list, description="field by field, for a request that breaks its schema"
    )


class ApiError(Exception):
    """A refusal with its status and words."""

    def __init__(
        self, status: int, title: str, detail: str, hint: str = "", headers: dict[str, str] | None = None
    ) -> None:
        super().__init__(detail)
        self.status = status
        self.title = title
        self.detail = detail
        self.hint = hint
        self.headers = headers


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
    )
    return response(problem, error.headers)


async def _http(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    if error.status_code == 400 and trouble_of(error) is not None:  # an upload that the disk has no room for is not the sender's fault
        return await _any(request, error)
    titles = {404: "Not found", 405: "Method not allowed", 400: "Bad request", 413: "Too large"}
    detail = (
        f"there is nothing at {request.url.path}"
        if error.status_code == 404 and error.detail == "Not Found"
        else str(error.detail)
    )
    problem = Problem(
        title=titles.get(error.status_code, str(error.detail)),
        status=error.status_code,
        detail=detail,
        instance=request.url.path,
    )
    return response(problem, dict(error.headers) if error.headers else None)


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
    if isinstance(error, KeyReusedError):
        return Problem(
            title="Idempotency-Key reused", status=422, detail=str(error), hint="use a new key for a new request"
        )
    if isinstance(error, CursorError):
        return Problem(title="The cursor does not fit", status=422, detail=str(error), hint="pass on what `next` said")
    fault = faults.explain(error)
    if fault is None:
        return None
    return Problem(title=fault.title, status=fault.status, detail=fault.detail, hint=fault.hint)


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
        *_packages_errors(),
    ]
    for known in errors:
        app.add_exception_handler(known, _any)
    app.add_exception_handler(Exception, _any)


def _packages_errors() -> list[type[Exception]]:
    from sqlalchemy.exc import DBAPIError

    from cellctl.store import StoreError
    from config import ConfigError
    from planner.errors import PlannerError

    return [ConfigError, PlannerError, StoreError, DBAPIError, OSError]
