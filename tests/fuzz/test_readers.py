"""Whatever bytes come in, a reader gives a sound mesh or one line, soon and in little memory."""

from __future__ import annotations

import struct
import tracemalloc

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from planner.errors import MeshError
from planner.mesh import load_bytes
from tests.fuzz.reading import assert_mesh_or_one_line
from tests.fuzz.seeds import archive, model_3mf, seeds

SUFFIXES = (".stl", ".obj", ".ply", ".3mf")
FEW = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
WORDS = [b"nan", b"inf", b"-1", b"1e308", b"4294967295", b"99999999999999999999", b"0", b"facet", b"f", b"\x00", b"\n"]

FOUND = {  # inputs that once raised something else or ended the process, cut down
    "a vertex of two numbers": (
        ".obj",
        b"v 0 0 0\nv 10 0 0\nv 0 10 0\nv 0 0\n10.0\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n",
    ),
    "more vertices stated than there are": (
        ".ply",
        b"ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
        b"element face 4\nproperty list uchar int vertex_indices\nend_header\n"
        b"0 0 0\n10 0 0\n0 10 0\n0 0 10\n3 0 0 3 2\n",
    ),
    "facets without area": (".obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"),
    "a vertex of one number": (
        ".stl",
        b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 5\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n",
    ),
}


@st.composite
def damaged(draw: st.DrawFn) -> tuple[bytes, str]:
    """A sound file in which bytes were changed, cut out, doubled or replaced by words that mean trouble."""
    suffix = draw(st.sampled_from(SUFFIXES))
    data = bytearray(draw(st.sampled_from(seeds(suffix))))
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, max(0, len(data) - 1)))
        width = draw(st.integers(0, 12))
        kind = draw(st.sampled_from(["bytes", "word", "cut", "double", "end"]))
        if kind == "bytes":
            data[at : at + width] = draw(st.binary(min_size=width, max_size=width))
        elif kind == "word":
            data[at : at + width] = draw(st.sampled_from(WORDS))
        elif kind == "cut":
            del data[at : at + width]
        elif kind == "double":
            data[at:at] = data[at : at + 8 * width]
        else:
            del data[at:]
    return bytes(data), suffix


@FEW
@given(damaged())
def test_a_damaged_file_gives_a_mesh_or_one_line(case: tuple[bytes, str]) -> None:
    assert_mesh_or_one_line(*case)


@settings(FEW, max_examples=60)
@given(st.binary(max_size=400), st.sampled_from(SUFFIXES))
def test_bytes_that_mean_nothing_give_one_line(data: bytes, suffix: str) -> None:
    assert not assert_mesh_or_one_line(data, suffix)


@settings(FEW, max_examples=60)
@given(
    st.lists(st.tuples(*[st.integers(-1, 6)] * 3), max_size=14),
    st.lists(st.tuples(*[st.integers(0, 3)] * 3), max_size=7),
)
def test_facets_between_any_vertices_give_a_mesh_or_one_line(
    facets: list[tuple[int, int, int]], vertices: list[tuple[int, int, int]]
) -> None:
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in facets]
    assert_mesh_or_one_line("\n".join(lines).encode(), ".obj")


@settings(FEW, max_examples=60)
@given(st.lists(st.tuples(*[st.integers(0, 2)] * 9), min_size=1, max_size=12))
def test_facets_on_a_coarse_grid_give_a_mesh_or_one_line(facets: list[tuple[int, ...]]) -> None:
    records = b"".join(struct.pack("<12fH", 0, 0, 0, *facet, 0) for facet in facets)
    assert_mesh_or_one_line(bytes(80) + struct.pack("<I", len(facets)) + records, ".stl")


@pytest.mark.parametrize("name", sorted(FOUND))
def test_what_fuzzing_found_is_one_line_now(name: str) -> None:
    suffix, data = FOUND[name]
    with pytest.raises(MeshError):
        load_bytes(data, suffix)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_sound_files_are_read(suffix: str) -> None:
    for data in seeds(suffix):
        assert load_bytes(data, suffix).volume == pytest.approx(1000 / 6)


def lying(suffix: str) -> bytes:
    """A small file that states four thousand million elements, or unpacks to a gigabyte."""
    if suffix == ".stl":
        return bytes(80) + struct.pack("<I", 4_000_000_000) + bytes(500)
    if suffix == ".ply":
        binary = next(data for data in seeds(".ply") if b"binary" in data)
        return binary.replace(b"vertex 4", b"vertex 4000000000").replace(b"face 4", b"face 4000000000")
    packed = bytearray(archive(model_3mf().encode()))
    entry = packed.rindex(b"PK\x01\x02")
    packed[entry + 24 : entry + 28] = struct.pack("<I", 3_000_000_000)
    return bytes(packed)


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".3mf"])
def test_a_count_that_lies_costs_no_memory(suffix: str) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(MeshError):
            load_bytes(lying(suffix), suffix)
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()


def nested(levels: int, fan: int) -> bytes:
    """The tetrahedron in components of components: fan ** levels of them, 20 mm apart."""
    extra = ""
    for level in range(levels):
        moves = [f"1 0 0 0 1 0 0 0 1 {20 * fan**level * i} 0 0" for i in range(fan)]
        inner = "".join(f'<component objectid="{level + 1}" transform="{move}"/>' for move in moves)
        extra += f'<object id="{level + 2}" type="model"><components>{inner}</components></object>'
    return archive(model_3mf(build=f'<item objectid="{levels + 1}"/>', extra=extra).encode())


def test_bodies_in_components_are_all_read_or_the_file_is_refused() -> None:
    assert load_bytes(nested(2, 3), ".3mf").volume == pytest.approx(9 * 1000 / 6)
    try:
        assert load_bytes(nested(3, 4), ".3mf").volume == pytest.approx(64 * 1000 / 6)
    except MeshError as error:
        assert "places 64 bodies, of which" in str(error)
    with pytest.raises(MeshError, match="more than 10000 bodies"):
        load_bytes(nested(10, 10), ".3mf")


def test_a_component_that_holds_itself_is_refused() -> None:
    inner = '<object id="2" type="model"><components><component objectid="2"/></components></object>'
    with pytest.raises(MeshError, match="holds no facets"):
        load_bytes(archive(model_3mf(build='<item objectid="2"/>', extra=inner).encode()), ".3mf")


def test_a_soup_of_loose_facets_is_refused_at_once() -> None:
    corners = [(20 * i, 20 * k, 0, 20 * i + 9, 20 * k, 0, 20 * i, 20 * k + 9, 1) for i in range(60) for k in range(60)]
    records = b"".join(struct.pack("<12fH", 0, 0, 0, *facet, 0) for facet in corners)
    with pytest.raises(MeshError, match="3600 holes"):
        load_bytes(bytes(80) + struct.pack("<I", len(corners)) + records, ".stl")
