"""Parts to divide: the shipped examples, the catalogue's, and meshes of them that differ a little."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

import config
from planner.decompose.division import divide
from planner.decompose.pieces import Division
from planner.mesh.load import load
from planner.mesh.mesh import Mesh
from planner.process import Settings
from planner.recipe import Recipe
from tests.parts.catalogue import PARTS

SHIPPED = Path(config.__file__).parent / "parts"
COARSE = 32
"""Segments of a circle: enough for shapes, few for speed."""


@cache
def part(name: str) -> Mesh:
    """A part by name, part frame."""
    return load(SHIPPED / f"{name}.stl") if (SHIPPED / f"{name}.stl").exists() else PARTS[name].mesh(COARSE)


@cache
def divided(name: str, process: str = "hybrid") -> Division:
    """The division of a part with nothing said but material and process."""
    return divided_with(part(name), Recipe(material="316L", process=process))


def divided_with(mesh: Mesh, recipe: Recipe) -> Division:
    """The division of a mesh."""
    return divide(mesh, recipe, Settings.from_recipe(recipe))


def disturbed(mesh: Mesh, by_mm: float) -> Mesh:
    """The mesh with every coordinate off by a little, as another export would have it."""
    noise = np.random.default_rng(5).uniform(-by_mm, by_mm, mesh.vertices.shape)
    return Mesh(mesh.vertices + noise, mesh.facets)


def angle_deg(first: np.ndarray, second: np.ndarray) -> float:
    """Between two unit vectors."""
    return float(np.degrees(np.arccos(np.clip(first @ second, -1.0, 1.0))))
