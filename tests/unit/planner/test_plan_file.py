"""The plan file: everything comes back, the same bytes for the same plan, and damage is told in one line."""

from __future__ import annotations

import json
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from planner.errors import FileFormatError
from planner.files import plan_from_bytes, plan_sha256, read_layer, read_plan, write_plan
from planner.files.plan_file import HEAD_BYTES, plan_bytes
from planner.files.plan_tables import layer_from, tables_of
from planner.nurbs import construct
from planner.pipeline import plan
from planner.plan import Plan
from planner.recipe import Recipe
from tests.unit.planner.divided_plan import divided_plan
from tests.unit.planner.small_parts import frustum


@pytest.fixture(scope="module")
def made() -> Plan:
    """With leaning walls, so that axis curves are in it, and with a rational curve."""
    cone = plan(frustum(14.0, 12.0, 3.2, sections=48), Recipe(layer_height_mm=0.8), part_name="Kegel ø 28")
    first = cone.layers[0]
    round_one = replace(first.contours[0], curve=construct.circle([0.0, 0.0, 0.0], 14.0))
    return replace(cone, layers=(replace(first, contours=(round_one,)), *cone.layers[1:]), findings=("eins", "zwei µ"))


def same(first: Any, second: Any) -> bool:
    """Whether two values are equal to the last bit, field by field."""
    if isinstance(first, np.ndarray):
        return isinstance(second, np.ndarray) and first.dtype == second.dtype and np.array_equal(first, second)
    if is_dataclass(first) and not isinstance(first, type):
        return type(first) is type(second) and all(
            same(getattr(first, f.name), getattr(second, f.name)) for f in fields(first)
        )
    if isinstance(first, (tuple, list)):
        return len(first) == len(second) and all(same(a, b) for a, b in zip(first, second, strict=True))
    return bool(first == second) and type(first) is type(second)


def test_plan_comes_back_equal_to_the_last_bit(made: Plan, tmp_path: Path) -> None:
    write_plan(made, tmp_path / "plan.h5")
    assert same(made, read_plan(tmp_path / "plan.h5"))


def test_same_plan_gives_the_same_bytes_and_another_one_another_hash(made: Plan) -> None:
    assert plan_bytes(made) == plan_bytes(plan_from_bytes(plan_bytes(made)))
    assert plan_sha256(made) == plan_sha256(plan_from_bytes(plan_bytes(made)))
    assert plan_sha256(made) != plan_sha256(replace(made, tolerance_mm=0.11))


def test_one_layer_is_read_alone(made: Plan, tmp_path: Path) -> None:
    write_plan(made, tmp_path / "plan.h5")
    for number in (0, 2, 3):
        assert same(made.layers[number], read_layer(tmp_path / "plan.h5", number))
    with pytest.raises(FileFormatError, match="no layer 4"):
        read_layer(tmp_path / "plan.h5", 4)


def test_file_is_hdf5_with_schema_and_units(made: Plan, tmp_path: Path) -> None:
    write_plan(made, tmp_path / "plan.h5")
    with h5py.File(tmp_path / "plan.h5", "r") as file:
        assert file.attrs["schema"] == 3
        assert file.attrs["sha256"] == plan_sha256(made)
        assert "mm" in file["passes/setpoints"].attrs["unit"]


def test_writing_leaves_no_other_file(made: Plan, tmp_path: Path) -> None:
    write_plan(made, tmp_path / "plan.h5")
    write_plan(made, tmp_path / "plan.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["plan.h5"]


def test_any_flipped_byte_is_noticed(made: Plan) -> None:
    data = plan_bytes(made)
    places = np.concatenate([np.arange(0, HEAD_BYTES, 31), np.linspace(HEAD_BYTES, len(data) - 1, 60).astype(int)])
    for place in places:
        damaged = bytearray(data)
        damaged[place] ^= 0x10
        with pytest.raises(FileFormatError) as caught:
            plan_from_bytes(bytes(damaged))
        assert "\n" not in caught.value.message


@pytest.mark.parametrize("keep", [0, 10, HEAD_BYTES, 5000, -1])
def test_truncated_file_is_refused_in_one_line(made: Plan, tmp_path: Path, keep: int) -> None:
    path = tmp_path / "plan.h5"
    path.write_bytes(plan_bytes(made)[:keep])
    for read in (read_plan, lambda p: read_layer(p, 0)):
        with pytest.raises(FileFormatError) as caught:
            read(path)
        assert "plan.h5" in caught.value.message and "\n" not in caught.value.message


def test_other_version_is_named(made: Plan) -> None:
    with pytest.raises(FileFormatError, match="version 7, this program reads 3"):
        plan_from_bytes(plan_bytes(replace(made, schema=7)))


def test_absent_file_and_unwritable_place_are_refused(made: Plan, tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="cannot be read"):
        read_plan(tmp_path / "none.h5")
    with pytest.raises(FileFormatError, match="cannot be written"):
        write_plan(made, tmp_path / "no_folder" / "plan.h5")


def test_contours_keep_both_deviations_and_a_plan_along_facets_its_bytes(made: Plan) -> None:
    read = plan_from_bytes(plan_bytes(made))
    for layer, again in zip(made.layers, read.layers, strict=True):
        for contour, other in zip(layer.contours, again.contours, strict=True):
            assert (contour.deviation_mm, contour.smooth_deviation_mm) == (other.deviation_mm, other.smooth_deviation_mm)
    bare = [
        replace(layer, contours=tuple(replace(c, smooth_deviation_mm=float("nan")) for c in layer.contours))
        for layer in made.layers
    ]
    along_facets = replace(made, layers=tuple(bare))
    assert plan_bytes(plan_from_bytes(plan_bytes(along_facets))) == plan_bytes(along_facets) != plan_bytes(made)


def test_pieces_setups_skeleton_candidates_and_overhang_come_back_equal_to_the_last_bit() -> None:
    made = divided_plan()
    read = plan_from_bytes(plan_bytes(made))
    assert same(made, read)
    assert plan_bytes(read) == plan_bytes(made)
    assert sum(len(layer.overhang) for layer in read.layers) == sum(layer.overhang_mm2 > 0.0 for layer in made.layers) > 0


def test_every_figure_of_a_piece_a_setup_the_skeleton_and_a_candidate_changes_the_hash() -> None:
    made = divided_plan()
    part, setup, item, skeleton = made.subcomponents[1], made.setups[1], made.candidates[1], made.skeleton
    assert skeleton is not None
    others = [
        *(replace(made, subcomponents=(part_,)) for part_ in changed(part)),
        *(replace(made, setups=(setup_,)) for setup_ in changed(setup)),
        *(replace(made, candidates=(item_,)) for item_ in changed(item)),
        *(replace(made, skeleton=skeleton_) for skeleton_ in changed(skeleton)[1:]),
        replace(made, skeleton=None),
        replace(made, layers=(replace(made.layers[0], thickness_mm=(0.8, 0.81)), *made.layers[1:])),
        replace(made, layers=(replace(made.layers[0], overhang=(np.zeros((3, 3)),)), *made.layers[1:])),
    ]
    hashes = [plan_sha256(other) for other in [made, *others]]
    assert len(set(hashes)) == len(hashes) == 1 + (1 + 13) + (1 + 3) + (1 + 10) + 3 + 3


def changed(item: Any) -> list[Any]:
    """The item, and it once more for each of its fields with that field changed."""
    found = [item]
    for field in fields(item):
        value = getattr(item, field.name)
        other = (
            value + 1
            if isinstance(value, np.ndarray)
            else (*value, "x")
            if field.name == "why"
            else tuple(v + 1 for v in value)
            if isinstance(value, tuple)
            else not value
            if isinstance(value, bool)
            else value + "x"
            if isinstance(value, str)
            else value + 1
        )
        found.append(replace(item, **{field.name: other}))
    return found


def test_layer_of_a_divided_plan_is_read_from_its_own_rows_only(tmp_path: Path) -> None:
    made = divided_plan()
    write_plan(made, tmp_path / "plan.h5")
    for number in (0, 11, 12, len(made.layers) - 1):
        assert same(made.layers[number], read_layer(tmp_path / "plan.h5", number))
    tables = tables_of(made)
    asked = {"outlines/points": 0, "curves/points": 0}

    def read(name: str, first: int, last: int) -> Any:
        asked[name] = asked.get(name, 0) + last - first
        return tables[name][first:last]

    assert layer_from(read, 11, json.loads(tables["plan/words"].tobytes())["notes"]).overhang_mm2 > 0.0
    assert asked["outlines/points"] == len(made.layers[11].overhang[0]) < len(tables["outlines/points"]) / 5


def test_every_measured_table_of_a_divided_plan_states_its_unit(tmp_path: Path) -> None:
    write_plan(divided_plan(), tmp_path / "plan.h5")
    with h5py.File(tmp_path / "plan.h5", "r") as file:
        bare: list[str] = []
        file.visititems(
            lambda name, item: bare.append(name)
            if isinstance(item, h5py.Dataset) and item.dtype.kind == "f" and "unit" not in item.attrs
            else None
        )
    assert not bare


def test_older_plan_is_refused_with_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "old.h5").write_bytes(plan_bytes(replace(divided_plan(), schema=2)))
    for read in (read_plan, lambda path: read_layer(path, 0)):
        with pytest.raises(FileFormatError, match=r"old\.h5: plan version 2, this program reads 3") as caught:
            read(tmp_path / "old.h5")
        assert caught.value.hint == "plan the part again"
