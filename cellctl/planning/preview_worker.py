"""The process that answers what a person waits for while choosing: `python -m cellctl.planning.preview_worker PARENT BYTES`.

It lives as long as the web process, keeps what the last parts came to (mesh, division), reads one JSON task per line on stdin
and writes one answer per line. What it works on may take its memory, never the web process's.
"""

from __future__ import annotations

import sys
import tempfile
import traceback
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from cellctl.faults import explain
from cellctl.planning.previews import Answer, Ask
from cellctl.planning.task import Failed, Task
from cellctl.planning.worker import Line, be_modest, end_with
from config.base import PREFERRED, prefer

if TYPE_CHECKING:
    from planner.decompose.pieces import Division
    from planner.mesh.mesh import Mesh
    from planner.recipe import Recipe

KEPT = 8  # meshes and divisions of the parts that were asked for last
DIVIDES_BY = (
    "material", "process", "build_direction", "decompose", "cuts", "axis_layers", "overhang", "support", "substrate_mm",
    "turn_deg", "layer_height_mm", "crease_deg", "cutter_diameter_mm", "small_cutter_diameter_mm", "stock_allowance_mm",
)  # fmt: skip
"""Fields of a recipe that a division into pieces depends on; the others move only figures within the pieces."""


class Kept:
    """The newest few of what is dear to make."""

    def __init__(self) -> None:
        self._held: OrderedDict[str, Any] = OrderedDict()

    def get(self, key: str, make: Callable[[], Any]) -> Any:
        """What is held under this key, made now if it is not."""
        if key not in self._held:
            self._held[key] = make()
        self._held.move_to_end(key)
        while len(self._held) > KEPT:
            self._held.popitem(last=False)
        return self._held[key]


MESHES, DIVISIONS = Kept(), Kept()


def _mesh(path: str) -> Mesh:
    from planner.mesh import load

    mesh: Mesh = MESHES.get(path, lambda: load(Path(path), "mm"))
    return mesh


def _division(path: str, mesh: Mesh, recipe: Recipe, material_toml: str) -> Division:
    from planner.decompose.division import divide
    from planner.process import Settings

    key = path + recipe.model_dump_json(include=set(DIVIDES_BY)) + material_toml
    made: Division = DIVISIONS.get(key, lambda: divide(mesh, recipe, Settings.from_recipe(recipe)))
    return made


def estimate(ask: Ask) -> dict[str, Any]:
    """What a part with this recipe would take. Raises PlannerError, ConfigError."""
    from config import load_cell
    from planner.estimate import estimate as made
    from planner.recipe import parse_recipe

    recipe = parse_recipe(ask.recipe_toml)
    mesh = _mesh(ask.file)
    with _material(recipe.material, ask.material_toml):
        division = None if recipe.process == "mill" else _division(ask.file, mesh, recipe, ask.material_toml)
        return asdict(made(mesh, recipe, load_cell(ask.cell), division=division))


@contextmanager
def _material(name: str, toml: str) -> Iterator[None]:
    """Within, the material's name stands for these facts; without any for the shipped ones."""
    if not toml:
        yield
        return
    with tempfile.TemporaryDirectory(prefix="material-") as folder:
        path = Path(folder) / "material.toml"
        path.write_text(toml, encoding="utf-8")
        prefer("materials", name, path)
        try:
            yield
        finally:
            PREFERRED.pop(("materials", name))


def picture(ask: Ask) -> dict[str, Any]:
    """A small picture of a mesh as PNG, written to `target`. Raises MeshError."""
    from cellctl.planning.thumbnail import png_of

    Path(ask.target).write_bytes(png_of(_mesh(ask.file)))
    return {}


def figures(ask: Ask) -> dict[str, Any]:
    """Lengths, times and powder of a plan by layer, written to `target`. Raises FileFormatError."""
    from cellctl.planning.layer_figures import figures_of
    from planner.files import read_plan

    Path(ask.target).write_bytes(msgspec.json.encode(figures_of(read_plan(Path(ask.file)))))
    return {}


KINDS: dict[str, Callable[[Ask], dict[str, Any]]] = {"estimate": estimate, "picture": picture, "figures": figures}


def answer(ask: Ask) -> Answer:
    """What one task comes to, an error as its words."""
    try:
        return Answer(KINDS[ask.kind](ask))
    except MemoryError:
        return Answer({}, Failed("Out of memory", "this part needs more memory than a worker may use", "use a coarser mesh"))
    except Exception as error:  # noqa: BLE001  the task's edge: whatever happens is told to the one who waits
        fault = explain(error)
        if fault is not None:
            return Answer({}, Failed(fault.title, fault.detail, fault.hint, fault.status))
        traceback.print_exc()
        detail = f"{type(error).__name__}: {error}"
        return Answer({}, Failed("Internal fault", detail, "the service's log has the details; please report it", 500))


def main(parent: int, memory_bytes: int) -> int:
    """Answer line by line until stdin ends."""
    line = Line()
    end_with(parent)
    be_modest(Task(kind="inspect", folder="", parent=parent, memory_bytes=memory_bytes))
    for text in iter(partial(sys.stdin.buffer.readline), b""):
        line.write(msgspec.json.encode(answer(msgspec.json.decode(text, type=Ask))))
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2])))
