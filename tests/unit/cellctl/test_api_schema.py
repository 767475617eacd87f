"""Every operation of the interface, asked by schemathesis with what its schema allows and what it does not: no 5xx, no breach of the schema."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import requests
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.errors import Unsatisfiable
from schemathesis.checks import not_a_server_error
from schemathesis.core.failures import FailureGroup
from schemathesis.generation.modes import GenerationMode
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from tests.unit.cellctl.asked_in_process import URL, InProcess, in_process

CHECKS = [not_a_server_error, status_code_conformance, content_type_conformance, response_headers_conformance, response_schema_conformance]
# each starts a process or hashes by argon2
COSTLY = frozenset({"upload_part", "estimate_part", "get_part_thumbnail", "sign_in", "create_user", "set_password", "change_password"})
schemathesis.serializer.alias("application/offset+octet-stream", "application/octet-stream")
GENTLE = settings(
    database=None, derandomize=True, deadline=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck), max_examples=2
)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory, empty_store: Path) -> Iterator[InProcess]:
    with in_process(tmp_path_factory.mktemp("schema"), empty_store) as made:
        yield made


def operations(served: InProcess) -> list[Any]:
    """Every operation of the document."""
    return [found.ok() for found in schemathesis.openapi.from_dict(served.app.openapi()).get_all_operations()]


def known(served: InProcess, operation: Any) -> dict[str, str]:
    """Path parameters of an operation that name what is there."""
    there = {"job_id": served.job_id, "part_id": served.part_id, "layer": "0", "verb": "hold"}
    if "/materials/" in operation.path or "/cells/" in operation.path:
        there |= {"name": "316L" if "/materials/" in operation.path else served.service.cell.name, "version": "1"}
    return {name: value for name, value in there.items() if "{" + name + "}" in operation.path}


def asked(served: InProcess, operation: Any, mode: GenerationMode, there: dict[str, str], examples: int) -> list[str]:
    """Ask one operation; what is wrong with its answers."""
    wrong: list[str] = []

    @settings(GENTLE, max_examples=examples)
    @given(case=operation.as_strategy(generation_mode=mode, path_parameters=there or None))
    def ask(case: Any) -> None:
        kwargs = case.as_transport_kwargs(base_url=URL, headers={"Authorization": f"Bearer {served.token}"})
        kwargs.pop("timeout", None)
        cookies = kwargs.pop("cookies", None)
        answer = served.ask(requests.Request(**kwargs, cookies=cookies).prepare())
        try:
            case.validate_response(answer, checks=CHECKS)
        except FailureGroup as group:  # every operation is looked at before the test ends
            wrong.append(f"{operation.label} {mode.value}: {answer.status_code} {'; '.join(map(str, group.exceptions))}")

    ask()
    return wrong


def all_asked(served: InProcess, examples: int) -> list[str]:
    """Ask every operation; what is wrong."""
    wrong: list[str] = []
    for operation in operations(served):
        ident = operation.definition.raw["operationId"]
        there = known(served, operation)
        rounds = [(GenerationMode.POSITIVE, there, examples), (GenerationMode.NEGATIVE, there, examples // 2)]
        for mode, fixed, count in rounds + ([(GenerationMode.POSITIVE, {}, examples // 2)] if there else []):
            try:
                wrong += asked(served, operation, mode, fixed, 1 if ident in COSTLY else count)
            except Unsatisfiable:
                continue  # an operation without input has nothing to be wrong
            except Exception as error:  # noqa: BLE001  every operation is looked at before the test ends
                wrong.append(f"{operation.label} {mode.value}: {type(error).__name__}: {error}")
    return wrong


def test_no_operation_fails_or_breaks_its_schema(served: InProcess) -> None:
    wrong = all_asked(served, examples=2)
    assert not wrong, "\n\n".join(wrong)


@pytest.mark.slow
def test_no_operation_fails_or_breaks_its_schema_however_often_it_is_asked(served: InProcess) -> None:
    wrong = all_asked(served, examples=60)
    assert not wrong, "\n\n".join(wrong)
