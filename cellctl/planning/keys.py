"""What a plan, program or proof was made from, as one hash: the same inputs and the same software give the same key."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import config
from config import Cell

ROOT = Path(config.__file__).resolve().parent.parent
PACKAGES = ("planner", "sim", "config")


def software_version() -> str:
    """Version of this software, in words."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("hybridcell")
    except PackageNotFoundError:
        return "0"


@cache
def software() -> str:
    """Hash (hex) of the code that plans and proves, and of the Python and NumPy that run it."""
    from importlib.metadata import version

    digest = hashlib.sha256(f"{platform.python_version()} {version('numpy')}".encode())
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*")):
            if path.suffix in (".py", ".toml"):
                digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def _key(*inputs: str) -> str:
    return hashlib.sha256(json.dumps([software(), *inputs]).encode()).hexdigest()


def _own(material_sha256: str) -> list[str]:
    """What a version of a material that is not the shipped one adds to a key; the shipped ones are part of the software."""
    return [f"material {material_sha256}"] if material_sha256 else []


def plan_key(part_sha256: str, units: str, part_name: str, recipe_toml: str, stock_sha256: str, material_sha256: str = "") -> str:
    """Key of a plan. material_sha256 : here and below, of a version other than the shipped one"""
    return _key("plan", part_sha256, units, part_name, recipe_toml, stock_sha256, *_own(material_sha256))


def program_key(plan_sha256: str, cell: Cell, material_sha256: str = "") -> str:
    """Key of a program."""
    own = [*_own(material_sha256), "with its window"] if material_sha256 else []  # one without would run within that of the shipped material
    return _key("program", plan_sha256, cell.sha256, *own)


def resumption_key(program_sha256: str, plan_sha256: str, cell: Cell, point: Mapping[str, Any], material_sha256: str = "") -> str:
    """Key of the rest of a program. point : from where"""
    told = json.dumps(dict(point), sort_keys=True)
    return _key("resume", program_sha256, plan_sha256, cell.sha256, told, *_own(material_sha256))


def proof_key(
    program_sha256: str,
    part_sha256: str,
    units: str,
    cell: Cell,
    stock_sha256: str = "",
    links: Sequence[str] = (),
    material_sha256: str = "",
) -> str:
    """Key of a proof. stock_sha256 : of the mesh that it is milled from, if one is given; links : what was run on the part before"""
    inputs = (program_sha256, part_sha256, units, cell.sha256, cell.twin_sha256, stock_sha256)
    return _key("proof", *inputs, *links, *_own(material_sha256))
