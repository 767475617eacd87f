"""Checkpoints: an edited Program goes on from the layer of the edit, with the same proof as from its begin; bad files are not used."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

import planner
from config import load_cell, load_material
from planner.mesh.mesh import Mesh
from planner.program import Program
from planner.recipe import Recipe
from sim import checkpoint, prove
from sim.checkpoint import Checkpoints, Place, Prefix
from sim.dryrun import DryRun, layer_begins
from sim.state import StateError, freeze, thaw

CELL_MM = 0.4
CELL = load_cell("trunnion_tcp")


@cache
def part() -> Mesh:
    box = trimesh.creation.box((9.0, 6.0, 2.4))
    return Mesh(np.asarray(box.vertices), np.asarray(box.faces))


@cache
def program() -> Program:
    recipe = Recipe.model_validate({"process": "hybrid", "tolerance_mm": 0.2, "layer_height_mm": 0.8, "overbuild": 0.45, "interpass_s": 0.0})
    return planner.post(planner.plan(part(), recipe, part_name="block"), CELL)


def edited(given: Program, layer: int) -> Program:
    """The Program with the first gate of a layer's process left shut."""
    begins = [1, *layer_begins(given)]
    index = next(i for i in range(begins[layer] - 1, len(given.lines)) if "M62" in given.lines[i])
    return replace(given, lines=tuple(f"N{i + 1} G90" if i == index else line for i, line in enumerate(given.lines)))


def test_edit_of_a_layer_goes_on_from_that_layer_with_the_proof_of_a_full_run(tmp_path: Path) -> None:
    kept = prove(program(), CELL, part(), cell_mm=CELL_MM, checkpoints=tmp_path)
    begins = layer_begins(program())
    assert len(list(tmp_path.iterdir())) == len(begins) >= 2
    change = edited(program(), 2)
    fresh = prove(change, CELL, part(), cell_mm=CELL_MM)
    assert fresh.to_json() != kept.to_json()
    run = DryRun(change, CELL, part(), load_material("316L"), None, CELL_MM)
    run.resume(Checkpoints(tmp_path, lambda line: pytest.fail(line)), part(), None)
    assert run.resumed_at == begins[1]
    before = run.controller.next_line
    assert before == begins[1]  # no line before the layer is sent again
    run.execute()
    again = run.conclude()
    assert again.to_json() == fresh.to_json()
    assert again.picture == fresh.picture
    assert again.timeline.to_dict() == fresh.timeline.to_dict()
    assert again.lines_executed == len(change.lines)


def test_damaged_and_foreign_checkpoints_are_not_used_and_one_line_says_so(tmp_path: Path) -> None:
    fresh = prove(program(), CELL, part(), cell_mm=CELL_MM, checkpoints=tmp_path)
    by_size = sorted(tmp_path.iterdir(), key=lambda path: path.stat().st_mtime_ns)
    whole = by_size[0].read_bytes()
    by_size[0].write_bytes(whole[:2000] + bytes(64) + whole[2064:])
    with by_size[1].open("wb") as file:
        np.savez(file, head=np.array([{"schema": 1}], dtype=object))
    said: list[str] = []
    again = prove(program(), CELL, part(), cell_mm=CELL_MM, checkpoints=tmp_path, progress=lambda share, word: said.append(word))
    assert again.to_json() == fresh.to_json()
    told = [word for word in said if "checkpoint" in word]
    assert len(told) == 2 and all("\n" not in word and "not used" in word for word in told)


def test_places_are_known_by_everything_that_is_before_them() -> None:
    given = program()
    begins = layer_begins(given)

    def keys(lines: tuple[str, ...], schedule: np.ndarray, fact: bytes) -> list[str]:  # type: ignore[type-arg]
        return [place.key for place in Prefix([fact]).places(lines, given.table, schedule, begins)]

    plain = keys(given.lines, given.schedule, b"cell")
    assert len(set(plain)) == len(begins)
    assert keys(given.lines, given.schedule, b"other cell")[0] != plain[0]
    late = (*given.lines[: begins[1]], "N0", *given.lines[begins[1] + 1 :])
    assert keys(late, given.schedule, b"cell") == plain
    early = ("N1 G20", *given.lines[1:])
    assert not set(keys(early, given.schedule, b"cell")) & set(plain)
    schedule = given.schedule.copy()
    schedule["value"][schedule["n"] < begins[0]] += 1.0
    assert keys(given.lines, schedule, b"cell")[0] != plain[0]


def test_states_are_put_together_from_what_differs(tmp_path: Path) -> None:
    random = np.random.default_rng(7)
    keeper = Checkpoints(tmp_path, lambda line: pytest.fail(line))
    trees = []
    blocks = np.full((6, 5, 4), -1, dtype=np.int32)
    cells: dict[int, np.ndarray] = {}  # type: ignore[type-arg]
    for n in range(5):
        for at in random.choice(blocks.size, 12, replace=False).tolist():  # some blocks change, come or go
            if at in cells and random.random() < 0.3:
                del cells[at]
            else:
                cells[at] = random.normal(size=(8, 8, 8)).astype(np.float32)
        directory = blocks.copy()
        directory.ravel()[sorted(cells)] = np.arange(len(cells), dtype=np.int32)
        value = np.array([cells[at] for at in sorted(cells)])
        rows = np.full((n + 1, 3), np.nan)
        tree = {"metal": {"directory": directory, "value": value}, "rows": rows, "time": 0.1 * n, "list": [1, {"dict": [["a", float("inf")]]}]}
        trees.append(tree)
        keeper.keep(Place(n + 1, n, f"{n}" * 64), tree)
    sizes = [path.stat().st_size for path in sorted(tmp_path.iterdir())]
    assert max(sizes[1:]) < 16 * 2048 + 8000  # only the blocks that changed
    for n, tree in enumerate(trees):
        _, back = next(Checkpoints(tmp_path, lambda line: pytest.fail(line)).latest([Place(n + 1, n, f"{n}" * 64)]))
        np.testing.assert_array_equal(back["metal"]["directory"], tree["metal"]["directory"])  # type: ignore[index]
        np.testing.assert_array_equal(back["metal"]["value"], tree["metal"]["value"])  # type: ignore[index]
        np.testing.assert_array_equal(back["rows"], tree["rows"])
        assert back["time"] == tree["time"] and back["list"] == tree["list"]


def test_folder_of_checkpoints_is_bounded_and_says_when_it_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "FOLDER_BYTES_MAX", 50_000)
    said: list[str] = []
    older = Checkpoints(tmp_path, said.append)
    for n in range(3):
        older.keep(Place(n + 1, n, f"{n}a" * 32), {"x": np.full(5000, float(n))})
    assert len(said) == 1 and "fill" in said[0]
    assert len(list(tmp_path.iterdir())) == 1
    newer = Checkpoints(tmp_path, said.append)
    newer.keep(Place(1, 0, "b" * 64), {"x": np.arange(5000.0)})
    newer.sweep()
    assert [path.name[0] for path in tmp_path.iterdir()] == ["b"]


def test_state_of_an_unknown_make_is_refused() -> None:
    with pytest.raises(StateError, match="Path"):
        freeze({"a": Path("x")})
    with pytest.raises(StateError, match="tagged"):
        thaw({"code": "print()"})
