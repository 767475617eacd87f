"""Materials and cells as versioned resources. A version never changes; a job keeps the hash of the one that it is made with.

Materials are changed here, by engineers, each change with its reason; the shipped ones are the first versions. A cell is a file that
the cell process reads when it starts, because limits and interlocks must not change under a running machine: it is shown here with its
versions as they were seen at each start, and a new file can be checked, but not put in place.
"""

from __future__ import annotations

import tomllib
from typing import Annotated, Any, TypeVar

import tomli_w
from fastapi import APIRouter, Path, Response
from pydantic import ValidationError
from sqlalchemy import Connection

from cellctl.api.conditional import IfMatch, check_unchanged
from cellctl.api.context import Service
from cellctl.api.idempotent import IdempotencyKey, once
from cellctl.api.models_facts import (
    NAME,
    CellCheck,
    CellDocument,
    CellList,
    CellText,
    CellVersions,
    Difference,
    MaterialChange,
    MaterialDocument,
    MaterialList,
    MaterialVersions,
    NewMaterial,
)
from cellctl.api.parts import Cursor, Limit
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import Engineer, ServiceOf, Viewer
from cellctl.planning.keys import software_version
from cellctl.store import Store, audit, versions
from cellctl.store.parts import NotFoundError
from cellctl.store.versions import CellVersion, MaterialVersion
from config import Cell, Material, load_material
from config.base import FACTS_DIR, Facts
from config.units import faults_of, unit_of

Name = Annotated[str, Path(max_length=60, pattern=NAME)]
Version = Annotated[int, Path(ge=1, le=10**6)]
FIELDS_TOLD = 50
F = TypeVar("F", bound=Facts)
router = APIRouter(prefix="/api/v1", tags=["facts"], responses=DOCUMENTED)


def material_names() -> list[str]:
    """Names of the shipped materials."""
    return sorted(path.stem for path in (FACTS_DIR / "materials").glob("*.toml"))


def toml_of(facts: Facts) -> str:
    """Validated facts as TOML."""
    return tomli_w.dumps(facts.model_dump(mode="json", exclude_none=True))


def see_what_is_shipped(store: Store, cell: Cell, cell_file: str) -> None:
    """At each start: the materials that come with the software, and the cell file that is run, become versions where they are new."""
    shipped = {name: load_material(name) for name in material_names()}
    now = store.clock()
    with store.write() as rows:
        for name, facts in shipped.items():
            versions.see_shipped(rows, name, facts.sha256, toml_of(facts), now, f"came with version {software_version()}")
        versions.see_cell(rows, cell.name, cell.sha256, cell.model_dump(mode="json"), cell_file, now)


def document(row: MaterialVersion) -> MaterialDocument:
    """A version of a material as it is told."""
    fields = {**row.__dict__, "facts": tomllib.loads(row.toml), "shipped": row.created_by == versions.SHIPPED}
    return MaterialDocument(**{name: fields[name] for name in MaterialDocument.model_fields})


def cell_document(service: Service, row: CellVersion) -> CellDocument:
    """A version of a cell as it is told."""
    running = row.name == service.cell.name and row.sha256 == service.cell.sha256
    return CellDocument(**row.__dict__, running=running)


def tag(row: MaterialVersion | CellVersion) -> str:
    """The ETag of a version."""
    return f'"{row.sha256}-{row.version}"'


def validated(model: type[F], facts: dict[str, Any] | None, toml: str | None) -> F:
    """The facts of a request. Raises ApiError 422 that names each field with its value, bound and unit."""
    if (facts is None) == (toml is None):
        raise ApiError(422, "The request does not fit", "give either facts or toml", "leave one of them out")
    try:
        return model.model_validate(tomllib.loads(toml) if toml is not None else facts)
    except tomllib.TOMLDecodeError as error:
        raise ApiError(422, "Not TOML", f"toml: {error}", "correct the line that is named") from None
    except (ValidationError, RecursionError) as error:
        faults = faults_of(error)[:FIELDS_TOLD] if isinstance(error, ValidationError) else [{"field": "facts", "error": "facts: too deep"}]
        more = f"; and {len(faults) - 1} more" if len(faults) > 1 else ""
        raise ApiError(422, "The facts do not fit", faults[0]["error"] + more, "correct the fields that are named", errors=faults) from None


@router.get("/materials", operation_id="list_materials")
def list_materials(_person: Viewer, service: ServiceOf) -> MaterialList:
    """The newest version of every material, with its facts."""
    with service.store.read() as rows:
        return MaterialList(items=[document(row) for row in versions.materials(rows)])


@router.get("/materials/{name}", operation_id="get_material")
def get_material(_person: Viewer, service: ServiceOf, response: Response, name: Name) -> MaterialDocument:
    """The newest version of a material."""
    with service.store.read() as rows:
        row = _newest(rows, name)
    response.headers["ETag"] = tag(row)
    return document(row)


def _newest(rows: Connection, name: str) -> MaterialVersion:
    try:
        return versions.material(rows, name)
    except NotFoundError as error:
        known = ", ".join(row.name for row in versions.materials(rows))
        raise ApiError(404, "Not found", str(error), f"there are: {known}") from None


@router.post("/materials", status_code=201, operation_id="create_material")
def create_material(person: Engineer, service: ServiceOf, body: NewMaterial, idempotency_key: IdempotencyKey = None) -> MaterialDocument:
    """A material of the shop's own, from its facts or as a copy of another one."""
    if body.copy_of is not None and (body.facts is not None or body.toml is not None):
        raise ApiError(422, "The request does not fit", "copy_of stands beside facts or toml", "leave one of them out")
    given = validated(Material, body.facts, body.toml) if body.copy_of is None else None

    def make(rows: Connection) -> dict[str, Any]:
        try:
            versions.material(rows, body.name)
        except NotFoundError:
            pass
        else:
            raise ApiError(409, "There already", f"there is a material {body.name}", f"change it by PUT /api/v1/materials/{body.name}")
        facts = given if given is not None else Material.model_validate(tomllib.loads(_newest(rows, body.copy_of or "").toml))
        now = service.store.clock()
        row = versions.add_material(rows, body.name, facts.sha256, toml_of(facts), body.because, person.name, now)
        audit.add(rows, person.deed("create material", body.name, body.because), now, "ok")
        return document(row).model_dump()

    answer, _ = once(service, person, idempotency_key, ("material", body.model_dump()), make)
    return MaterialDocument(**answer)


@router.put("/materials/{name}", operation_id="change_material")
def change_material(
    person: Engineer, service: ServiceOf, response: Response, name: Name, body: MaterialChange, if_match: IfMatch = None
) -> MaterialDocument:
    """The next version of a material. If-Match (the ETag that was read) is needed: nobody overwrites what another changed meanwhile.

    Jobs that were submitted keep the version that they have. The same facts again change nothing.
    """
    facts = validated(Material, body.facts, body.toml)
    with service.store.write() as rows:
        newest = _newest(rows, name)
        if if_match is None:
            raise ApiError(428, "If-Match is needed", f"which version of {name} do you change?", "read it, and send its ETag as If-Match")
        check_unchanged(if_match, tag(newest), f"material {name} (version {newest.version})")
        if newest.sha256 != facts.sha256:
            now = service.store.clock()
            newest = versions.add_material(rows, name, facts.sha256, toml_of(facts), body.because, person.name, now)
            audit.add(rows, person.deed(f"change material to version {newest.version}", name, body.because), now, "ok")
    response.headers["ETag"] = tag(newest)
    return document(newest)


@router.get("/materials/{name}/versions", operation_id="list_material_versions")
def list_material_versions(_person: Viewer, service: ServiceOf, name: Name, cursor: Cursor = None, limit: Limit = 50) -> MaterialVersions:
    """All versions of a material, newest first."""
    with service.store.read() as rows:
        _newest(rows, name)
        found, following = versions.material_page(rows, name, cursor, limit)
    return MaterialVersions(items=[document(row) for row in found], next=following)


@router.get("/materials/{name}/versions/{version}", operation_id="get_material_version")
def get_material_version(_person: Viewer, service: ServiceOf, response: Response, name: Name, version: Version) -> MaterialDocument:
    """One version of a material; it never changes."""
    with service.store.read() as rows:
        row = versions.material(rows, name, version)
    response.headers["ETag"] = tag(row)
    return document(row)


@router.get("/cells", operation_id="list_cells")
def list_cells(_person: Viewer, service: ServiceOf) -> CellList:
    """The newest version of every cell file that a service on this store ran."""
    with service.store.read() as rows:
        return CellList(items=[cell_document(service, row) for row in versions.cells(rows)])


@router.get("/cells/{name}", operation_id="get_cell_file")
def get_cell(_person: Viewer, service: ServiceOf, name: Name) -> CellDocument:
    """A cell file as it was last seen."""
    with service.store.read() as rows:
        return cell_document(service, versions.cell(rows, name))


@router.put("/cells/{name}", operation_id="change_cell_file", response_model=None)
def change_cell(_person: Engineer, service: ServiceOf, name: Name, body: CellText) -> Response:
    """Always refused, and told why: a cell is a file that the cell process reads when it starts."""
    validated(Cell, None, body.toml)
    with service.store.read() as rows:
        seen = versions.cell(rows, name)
    raise ApiError(
        409,
        "A cell is a file",
        f"{name} is read from {seen.file} when its process starts: limits and interlocks do not change under a running machine",
        "the text is valid: write it to that file while the machine stands, then start the service again",
    )


@router.post("/cells/{name}/check", operation_id="check_cell_file")
def check_cell(_person: Viewer, service: ServiceOf, name: Name, body: CellText) -> CellCheck:
    """Whether a cell file is valid, and in what it differs from the one that was last seen. Nothing is changed."""
    given = validated(Cell, None, body.toml)
    with service.store.read() as rows:
        seen = versions.cell(rows, name)
    before, after = dict(leaves(seen.facts)), dict(leaves(given.model_dump(mode="json")))
    fields = sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
    differences = [
        Difference(field=field, unit=unit_of(tuple(field.split("."))), running=before.get(field), given=after.get(field)) for field in fields
    ]
    return CellCheck(sha256=given.sha256, differences=differences)


def leaves(facts: Any, path: str = "") -> list[tuple[str, Any]]:
    """Every value of nested facts with its path: ("axes.0.max_mm", 400.0)."""
    if isinstance(facts, dict | list) and facts:
        items = facts.items() if isinstance(facts, dict) else enumerate(facts)
        return [leaf for key, value in items for leaf in leaves(value, f"{path}.{key}" if path else str(key))]
    return [(path, facts)]


@router.get("/cells/{name}/versions", operation_id="list_cell_versions")
def list_cell_versions(_person: Viewer, service: ServiceOf, name: Name, cursor: Cursor = None, limit: Limit = 50) -> CellVersions:
    """All versions of a cell file as they were seen at starts of the service, newest first."""
    with service.store.read() as rows:
        versions.cell(rows, name)
        found, following = versions.cell_page(rows, name, cursor, limit)
    return CellVersions(items=[cell_document(service, row) for row in found], next=following)
