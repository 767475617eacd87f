"""From mesh and recipe to toolpaths and G-code: `plan(mesh, recipe)`, then `post(plan, cell)`.

`resume(program, cell, point)` gives the rest of a program that was interrupted. The names `plan`, `post` and `resume` are the
functions; the modules of the same names are imported as `from planner.plan import Plan`.
What is heavy is loaded when it is called: whoever only reads Plans and Programs does not wait for numba and scipy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from typing import TYPE_CHECKING, Any

import planner.plan  # noqa: F401  (the module is bound first, then the function of its name)
from planner.errors import PlannerError
from planner.post import post as _post
from planner.resume import resume as _resume

if TYPE_CHECKING:
    from planner.mesh import Mesh, load
    from planner.plan import Layer, Plan
    from planner.recipe import Recipe, load_recipe, parse_recipe

__all__ = ["Mesh", "PlannerError", "Recipe", "load", "load_recipe", "parse_recipe", "plan", "post", "resume"]

_HOMES = {"Mesh": "mesh", "load": "mesh", "Recipe": "recipe", "load_recipe": "recipe", "parse_recipe": "recipe"}


def _plan(
    mesh: object,
    recipe: Recipe,
    *,
    part_name: str = "part",
    progress: Callable[[str, float], None] | None = None,
    findings: Iterable[str] = (),
    on_layer: Callable[[Layer], None] | None = None,
) -> Plan:
    """How to make a part: see `planner.pipeline.plan`."""
    from planner import pipeline

    return pipeline.plan(mesh, recipe, part_name=part_name, progress=progress, findings=findings, on_layer=on_layer)


plan = _plan
post = _post
resume = _resume


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"planner.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'planner' has no attribute {name!r}")
