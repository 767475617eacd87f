"""From mesh and recipe to toolpaths and G-code: `plan(mesh, recipe)`, then `post(plan, cell)`.

The names `plan` and `post` are the functions; the modules of the same names are imported as `from planner.plan import Plan`.
"""

from importlib.util import find_spec

import planner.plan
from planner.errors import PlannerError
from planner.mesh import Mesh, load
from planner.pipeline import plan as _plan
from planner.recipe import Recipe, load_recipe, parse_recipe

plan = _plan
if find_spec("planner.post") is not None:
    from planner.post import post as _post

    post = _post

__all__ = ["Mesh", "PlannerError", "Recipe", "load", "load_recipe", "parse_recipe", "plan"]
