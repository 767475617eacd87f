"""How many bodies a 3MF file places, counted from its build items and components alone."""

from __future__ import annotations

import io

import trimesh
from lxml import etree

MAX_PLACED = 10_000
"""Most bodies that a file may place: components of components multiply, ten levels of ten make ten thousand million."""
_MAX_DEPTH = 100
"""Components in components that are followed: far deeper than any assembly, far from Python's limit of recursion."""


def placed_bodies(data: bytes) -> int | None:
    """Count of mesh objects that the build items place, through all components; MAX_PLACED + 1 if there are more.

    data : the 3MF file.  None where that cannot be told from one model part (parts that refer to other files).
    Raises what trimesh and lxml raise for a damaged file.  Source: 3MF Core Specification 1.3, chapters 3.4 and 4.
    """
    entries = trimesh.util.decompress(io.BytesIO(data), file_type="zip")
    models = [entry for name, entry in entries.items() if name.lower().endswith(".model")]
    if len(models) != 1:
        return None
    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True)
    root = etree.parse(models[0], parser).getroot()
    has_mesh: dict[str, bool] = {}
    uses: dict[str, list[str]] = {}
    for item in root.iterfind(".//{*}object"):
        number = item.get("id", "")
        has_mesh[number] = item.find("{*}mesh/{*}triangles/{*}triangle") is not None
        uses[number] = [part.get("objectid", "") for part in item.iterfind("{*}components/{*}component")]
    items = [item.get("objectid", "") for item in root.iterfind("{*}build/{*}item")]
    held: dict[str, int] = {}
    return min(sum(_held(number, has_mesh, uses, held, ()) for number in items), MAX_PLACED + 1)


def _held(
    number: str, has_mesh: dict[str, bool], uses: dict[str, list[str]], held: dict[str, int], around: tuple[str, ...]
) -> int:
    """Bodies in one object, at most MAX_PLACED + 1; an object in itself holds none there."""
    if number in around or number not in has_mesh or len(around) > _MAX_DEPTH:
        return 0
    if number not in held:
        inner = sum(_held(part, has_mesh, uses, held, (*around, number)) for part in uses[number])
        held[number] = min(int(has_mesh[number]) + inner, MAX_PLACED + 1)
    return held[number]
