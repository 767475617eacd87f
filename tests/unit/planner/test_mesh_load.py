"""Files in, meshes or one line out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.errors import MeshError
from planner.mesh import inspect_bytes, load, load_bytes, load_checked

PARTS = Path(__file__).resolve().parents[3] / "config" / "parts"
BOX = trimesh.creation.box((10, 20, 30))
STL = BOX.export(file_type="stl")
JUNK = np.random.default_rng(7).bytes(3000)


def as_bytes(kind: str) -> bytes:
    exported = BOX.export(file_type=kind)
    return exported.encode() if isinstance(exported, str) else exported


@pytest.mark.parametrize(
    ("kind", "suffix"), [("stl", ".stl"), ("stl_ascii", ".STL"), ("3mf", ".3mf"), ("obj", "obj"), ("ply", ".ply")]
)
def test_every_format_gives_the_same_closed_box(kind: str, suffix: str) -> None:
    loaded = inspect_bytes(as_bytes(kind), suffix)
    assert loaded.findings == []
    assert len(loaded.mesh.vertices) == 8
    assert loaded.mesh.is_closed
    assert loaded.mesh.volume == pytest.approx(6000.0)


def test_inches_are_scaled_to_millimetres() -> None:
    loaded = inspect_bytes(STL, ".stl", "inch")
    np.testing.assert_allclose(loaded.mesh.size, [254, 508, 762])
    assert loaded.summary.startswith("254 x 508 x 762 mm (file in inch; x, y, z = -127 ... 127, ")


def test_a_3mf_that_states_another_unit_than_the_user_is_refused() -> None:
    with pytest.raises(MeshError, match="states its unit as mm, asked for was inch") as caught:
        load_bytes(as_bytes("3mf"), ".3mf", "inch")
    assert caught.value.hint == "use units mm"


@pytest.mark.parametrize("name", ["bearing", "double_arc", "hinge", "pipe"])
def test_the_parts_of_the_paper_load_closed_with_trimesh_volume(name: str) -> None:
    path = PARTS / f"{name}.stl"
    mesh = load(path)
    assert mesh.is_closed
    assert mesh.volume == pytest.approx(trimesh.load_mesh(path).volume, rel=1e-9)


def test_the_same_file_gives_the_same_mesh() -> None:
    first, second = load_checked(PARTS / "pipe.stl"), load_checked(PARTS / "pipe.stl")
    assert first.mesh.sha256 == second.mesh.sha256
    assert first.source_sha256 == second.source_sha256
    assert first.findings == []


def with_nan() -> bytes:
    data = bytearray(STL)
    data[84 + 50 * 3 + 12 : 84 + 50 * 3 + 16] = np.float32(np.nan).tobytes()
    return bytes(data)


def scaled(factor: float) -> bytes:
    copy = BOX.copy()
    copy.apply_scale(factor)
    return copy.export(file_type="stl")


REFUSED = [
    ("empty", b"", ".stl", "empty"),
    ("no facets", bytes(84), ".stl", "no facets"),
    ("truncated", STL[:-70], ".stl", "states 12 facets and holds 10"),
    ("too long", STL + b"x" * 70, ".stl", "70 more bytes"),
    ("too short", b"abc", ".stl", "not an STL"),
    ("junk stl", JUNK, ".stl", "no STL"),
    ("junk ply", JUNK, ".ply", "not a readable PLY"),
    ("junk 3mf", JUNK, ".3mf", "not a readable 3MF"),
    ("junk obj", JUNK, ".obj", "OBJ"),
    ("half ply", as_bytes("ply")[:300], ".ply", "PLY"),
    ("half 3mf", as_bytes("3mf")[:500], ".3mf", "3MF"),
    ("half ascii", as_bytes("stl_ascii")[:700], ".stl", "cut off"),
    ("bad word", as_bytes("stl_ascii").replace(b"vertex -5.0", b"vertex -5,0", 1), ".stl", r"line \d+ .* no vertex"),
    ("nan", with_nan(), ".stl", "1 of 12 facets .* not numbers.*first facet 3"),
    ("huge", scaled(1e4), ".stl", "larger than 10000 mm"),
    ("tiny", scaled(1e-4), ".stl", "smaller than 0.01 mm"),
    ("other format", STL, ".step", "cannot read .step"),
]


@pytest.mark.parametrize(("data", "suffix", "words"), [row[1:] for row in REFUSED], ids=[row[0] for row in REFUSED])
def test_a_bad_file_is_refused_with_one_line_and_a_hint(data: bytes, suffix: str, words: str) -> None:
    with pytest.raises(MeshError, match=words) as caught:
        inspect_bytes(data, suffix)
    assert "\n" not in caught.value.message
    assert caught.value.hint


@settings(max_examples=150)
@given(
    st.sampled_from(["stl", "stl_ascii", "3mf", "obj", "ply"]),
    st.integers(0, 2**16),
    st.binary(min_size=1, max_size=30),
    st.booleans(),
)
def test_damaged_bytes_give_a_closed_mesh_or_one_line(kind: str, at: int, damage: bytes, is_cut: bool) -> None:
    data = bytearray(as_bytes(kind))
    place = at % len(data)
    data[place : len(data) if is_cut else place + len(damage)] = damage
    try:
        assert inspect_bytes(bytes(data), kind.removesuffix("_ascii")).mesh.is_closed
    except MeshError as error:
        assert error.message
        assert "\n" not in error.message


def test_an_unknown_unit_is_refused() -> None:
    with pytest.raises(MeshError, match="unknown unit 'cm'"):
        load_bytes(STL, ".stl", "cm")


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path) -> None:
    for path in (tmp_path / "absent.stl", tmp_path):
        with pytest.raises(MeshError, match="cannot be read"):
            load(path)


def test_a_bad_file_on_disk_is_named(tmp_path: Path) -> None:
    (tmp_path / "cut.stl").write_bytes(STL[:-70])
    with pytest.raises(MeshError, match=r"cut\.stl: .* cut off"):
        load(tmp_path / "cut.stl")
