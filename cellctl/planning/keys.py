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


def plan_key(part_sha256: str, units: str, part_name: str, recipe_toml: str, stock_sha256: str) -> str:
    """Key of a plan."""
    return _key("plan", part_sha256, units, part_name, recipe_toml, stock_sha256)


def program_key(plan_sha256: str, cell: Cell) -> str:
    """Key of a program."""
    return _key("program", plan_sha256, cell.sha256)


def resumption_key(program_sha256: str, plan_sha256: str, cell: Cell, point: Mapping[str, Any]) -> str:
    """Key of the rest of a program. point : from where"""
    return _key("resume", program_sha256, plan_sha256, cell.sha256, json.dumps(dict(point), sort_keys=True))


def proof_key(
    program_sha256: str, part_sha256: str, units: str, cell: Cell, stock_sha256: str = "", links: Sequence[str] = ()
) -> str:
    """Key of a proof. stock_sha256 : of the mesh that it is milled from, if one is given; links : what was run on the part before"""
    return _key("proof", program_sha256, part_sha256, units, cell.sha256, cell.twin_sha256, stock_sha256, *links)
