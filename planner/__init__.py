"""From mesh and recipe to toolpaths and G-code: `plan(mesh, recipe)`, then `post(plan, cell)`.

The names `plan` and `post` are the functions; what the modules of the same names hold is imported as
`from planner.plan import Plan`.
"""

from planner.errors import PlannerError
from planner.mesh import Mesh, load
from planner.pipeline import plan
from planner.post import post
from planner.recipe import Recipe, load_recipe, parse_recipe

__all__ = ["Mesh", "PlannerError", "Recipe", "load", "load_recipe", "parse_recipe", "plan", "post"]
