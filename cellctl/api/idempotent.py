"""One way for every POST that makes something: the same Idempotency-Key gets the first answer again, and nothing is made twice."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, NoReturn

from fastapi import Header
from sqlalchemy import Connection

from cellctl.api.context import Service
from cellctl.api.problems import ApiError
from cellctl.api.sign_in import Person
from cellctl.store import idempotency

IdempotencyKey = Annotated[
    str | None, Header(max_length=200, min_length=1, description="the same key gets the first answer again")
]


def once(
    service: Service,
    person: Person,
    key: str | None,
    asked: tuple[Any, ...],
    make: Callable[[Connection], dict[str, Any]],
) -> tuple[dict[str, Any], bool]:
    """(the answer, whether it was made now): `make` runs in one transaction with the memory of its answer.

    asked : what the request asks for; the same key with something else raises KeyReusedError
    """
    digest = idempotency.request_digest(*asked)
    with service.store.write() as rows:
        earlier = idempotency.answered(rows, person.name, key, digest)
        if earlier is not None:
            return earlier, False
        answer = make(rows)
        idempotency.remember(rows, person.name, key, digest, answer, service.store.clock())
    return answer, True


def refuse_secret_again(what: str, ident: str) -> NoReturn:
    """Raise ApiError 409 for a repeated request whose answer held a secret: it is not kept, so it cannot be told again."""
    raise ApiError(
        409,
        "Made already",
        f"this Idempotency-Key made {what} {ident}; its secret was in the first answer and is kept nowhere",
        f"if that answer was lost, take {ident} back and make another with a new key",
    )
