"""Materials by name, as the planner will use them."""

from __future__ import annotations

from fastapi import APIRouter

from cellctl.api.models import Named, NamedList
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import Viewer
from config import load_material
from config.base import FACTS_DIR

router = APIRouter(prefix="/api/v1/materials", tags=["facts"], responses=DOCUMENTED)


def material_names() -> list[str]:
    """Names of the shipped materials."""
    return sorted(path.stem for path in (FACTS_DIR / "materials").glob("*.toml"))


@router.get("")
def list_materials(_person: Viewer) -> NamedList:
    """All materials with their facts."""
    return NamedList(
        items=[Named(name=name, facts=load_material(name).model_dump(mode="json")) for name in material_names()]
    )


@router.get("/{name}")
def get_material(_person: Viewer, name: str) -> Named:
    """One material."""
    if name not in material_names():
        raise ApiError(
            404, "Not found", f"there is no material {name[:60]!r}", f"there are: {', '.join(material_names())}"
        )
    return Named(name=name, facts=load_material(name).model_dump(mode="json"))
