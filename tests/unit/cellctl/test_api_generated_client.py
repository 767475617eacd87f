"""A client generated from /openapi.json by openapi-python-client is imported and asks the application."""

from __future__ import annotations

import collections
import importlib
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from openapi_python_client import Config, MetaType, generate
from openapi_python_client.config import ConfigFile

from cellctl.store.tokens import Role
from tests.unit.cellctl.conftest import URL
from tests.unit.cellctl.test_store import part_in

NAME = "generated_cell_client"
BYTES = ("application/offset+octet-stream", "application/vnd.hybridcell.view", "application/x-hdf5", "image/png", "model/stl")


@pytest.fixture
def generated(web: Any, tmp_path: Path) -> Iterator[str]:
    """The name of the package that was generated."""
    document = tmp_path / "openapi.json"
    document.write_text(json.dumps(web.app.openapi()), encoding="utf-8")
    settings = ConfigFile(post_hooks=[], content_type_overrides=dict.fromkeys(BYTES, "application/octet-stream"))
    config = Config.from_sources(settings, MetaType.NONE, document, "utf-8", overwrite=True, output_path=tmp_path / NAME)
    told = generate(config=config)
    assert not told, "\n".join(f"{one.header} {one.detail}" for one in told)
    sys.path.insert(0, str(tmp_path))
    yield NAME
    sys.path.remove(str(tmp_path))
    for name in [name for name in sys.modules if name.partition(".")[0] == NAME]:
        del sys.modules[name]


async def test_client_generated_from_the_document_works(web: Any, generated: str) -> None:
    part_id = part_in(web.service.store)
    web.service.queue._slots = 0
    package, models = importlib.import_module(generated), importlib.import_module(f"{generated}.models")

    def operation(path: str) -> Any:
        return importlib.import_module(f"{generated}.api.{path}")

    transport = {"transport": httpx.ASGITransport(web.app)}
    async with package.AuthenticatedClient(URL, web.secrets[Role.ENGINEER], httpx_args=transport, raise_on_unexpected_status=True) as client:
        part = await operation("parts.get_part").asyncio(part_id, client=client)
        assert (part.id, part.facets, part.units) == (part_id, 12, "mm")
        body = models.NewJob.from_dict({"part_id": part_id, "name": "generated"})
        job = await operation("jobs.submit_job").asyncio(client=client, body=body, idempotency_key="once")
        again = await operation("jobs.submit_job").asyncio(client=client, body=body, idempotency_key="once")
        assert job.id == again.id and job.state == "submitted"
        listed = await operation("jobs.list_jobs").asyncio(client=client, limit=5)
        assert [one.id for one in listed.items] == [job.id]
        steel = await operation("facts.get_material").asyncio("316L", client=client)
        assert steel.version == 1 and steel.facts.to_dict()
        refused = await operation("parts.get_part").asyncio_detailed("part_none", client=client)
        assert refused.status_code == 404 and refused.parsed.type_ == "urn:hybridcell:problem:not-found"


def test_document_names_groups_and_refusals_of_every_operation(web: Any) -> None:
    document = web.app.openapi()
    found = [(path, operation) for path, operations in document["paths"].items() for operation in operations.values()]
    names = [operation["operationId"] for _, operation in found]
    assert [name for name, count in collections.Counter(names).items() if count > 1] == []
    assert [name for name in names if not re.fullmatch(r"[a-z]+(_[a-z]+)+", name)] == []
    groups = {tag["name"] for tag in document["tags"]}
    for path, operation in found:
        assert set(operation["tags"]) <= groups and operation["tags"], path
        assert operation["description"], path
        assert {"4XX", "5XX"} <= set(operation["responses"]), path
        assert any(status.startswith("2") for status in operation["responses"]), path
