"""What is mended keeps its shape and is said; what cannot be is refused."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from planner.errors import MeshError
from planner.mesh import Finding, LoadedMesh, inspect_bytes

BOX = trimesh.creation.box((10, 10, 10))


def loaded(vertices: NDArray[np.float64], facets: NDArray[np.int64], kind: str = "stl") -> LoadedMesh:
    shape = trimesh.Trimesh(vertices, facets, process=False)
    return inspect_bytes(shape.export(file_type=kind), kind)


def joined(*shapes: trimesh.Trimesh) -> LoadedMesh:
    both = trimesh.util.concatenate(list(shapes))
    return loaded(both.vertices, both.faces)


def moved(x: float, y: float, z: float, scale: float = 1.0) -> trimesh.Trimesh:
    shape = BOX.copy()
    shape.apply_scale(scale)
    shape.apply_translation((x, y, z))
    return shape


def kinds(result: LoadedMesh) -> dict[str, Finding]:
    return {finding.kind: finding for finding in result.findings}


def octasphere(radius: float, times: int) -> trimesh.Trimesh:
    """8 · 4^times facets."""
    corners = np.vstack([np.eye(3), -np.eye(3)])
    facets = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    shape = trimesh.Trimesh(corners, facets, process=False)
    for _ in range(times):
        shape = shape.subdivide()
        shape.vertices /= np.linalg.norm(shape.vertices, axis=1)[:, None]
    shape.apply_scale(radius)
    return shape


@pytest.mark.parametrize("seed", range(6))
def test_a_sphere_with_81_of_2048_facets_missing_closes_within_a_fifth_of_a_percent(seed: int) -> None:
    sphere = octasphere(23.0, 4)
    kept = np.sort(np.random.default_rng(seed).permutation(2048)[:1967])
    result = loaded(sphere.vertices, sphere.faces[kept])
    finding = kinds(result)["open_edges"]
    assert result.mesh.is_closed
    assert abs(result.mesh.volume / sphere.volume - 1.0) < 0.002
    assert finding.mended
    assert finding.volume_change_mm3 < 0.0
    assert finding.place is not None


def test_the_volume_said_for_a_hole_in_a_ball_is_about_the_cap_that_the_patch_cuts_off() -> None:
    ball = octasphere(10.0, 4)
    middle = int(np.argmax(ball.triangles_center @ [1, 2, 3]))
    result = loaded(ball.vertices, np.delete(ball.faces, middle, axis=0))
    a, b, c = ball.triangles[middle]
    chord = np.mean([np.sum((a - b) ** 2), np.sum((b - c) ** 2), np.sum((c - a) ** 2)])
    # mean height of a ball of radius R over a triangle of chord c is c² / 8R; normals at the rim lack the lost facet
    expected = -chord / (8 * 10.0) * float(ball.area_faces[middle])
    assert kinds(result)["open_edges"].volume_change_mm3 == pytest.approx(expected, rel=0.35)


def test_a_missing_face_is_refused_with_its_size_and_place() -> None:
    on_top = BOX.triangles_center[:, 2] > 4.9
    with pytest.raises(MeshError, match=r"not watertight: 1 hole, .*14\.14 mm.*around \(0, 0, 5\) mm"):
        loaded(BOX.vertices, BOX.faces[~on_top])


@pytest.mark.parametrize("lost", range(12))
def test_a_hole_in_a_flat_face_is_closed_exactly_however_wide(lost: int) -> None:
    result = loaded(BOX.vertices, np.delete(BOX.faces, lost, axis=0))
    assert result.mesh.volume == pytest.approx(1000.0)
    assert kinds(result)["open_edges"].volume_change_mm3 == pytest.approx(0.0, abs=1e-9)


def test_half_a_ball_is_refused() -> None:
    ball = octasphere(10.0, 4)
    with pytest.raises(MeshError, match=r"not watertight: 1 hole, the largest 28\.28 mm wide with 64 open edges"):
        loaded(ball.vertices, ball.faces[ball.triangles_center[:, 2] < 0.0])


def test_inverted_facets_are_turned_round_and_said() -> None:
    result = loaded(BOX.vertices, BOX.faces[:, ::-1])
    assert result.mesh.volume == pytest.approx(1000.0)
    assert kinds(result)["inverted"].count == 12
    assert kinds(result)["inverted"].volume_change_mm3 == pytest.approx(2000.0)


def test_mixed_winding_is_mended_and_counted() -> None:
    facets = BOX.faces.copy()
    facets[[1, 4, 8]] = facets[[1, 4, 8], ::-1]
    result = loaded(BOX.vertices, facets)
    assert result.mesh.volume == pytest.approx(1000.0)
    assert kinds(result)["mixed_winding"].count == 3


def test_a_void_stays_a_void_even_when_everything_is_inside_out() -> None:
    hole = moved(0, 0, 0, 0.5)
    hole.invert()
    assert joined(BOX, hole).findings == []
    assert joined(BOX, hole).mesh.volume == pytest.approx(875.0)
    both = trimesh.util.concatenate([BOX, hole])
    assert loaded(both.vertices, both.faces[:, ::-1]).mesh.volume == pytest.approx(875.0)


def test_duplicate_and_collapsed_facets_are_removed_without_changing_the_volume() -> None:
    extra = np.vstack([BOX.faces, BOX.faces[:2], BOX.faces[3:4, ::-1], [[0, 0, 1], [2, 2, 2]]])
    result = loaded(BOX.vertices, extra)
    assert len(result.mesh.facets) == 12
    assert result.mesh.volume == pytest.approx(1000.0)
    assert kinds(result)["duplicate_facets"].count == 3
    assert kinds(result)["degenerate_facets"].count == 2


def test_a_doubled_inner_wall_vanishes() -> None:
    wall = np.array([[0, 3, 5], [5, 3, 0]])
    result = loaded(BOX.vertices, np.vstack([BOX.faces, wall]))
    assert len(result.mesh.facets) == 12


def test_a_flat_facet_in_a_slit_is_removed_and_nothing_opens() -> None:
    a, b, c = (int(v) for v in BOX.faces[0])
    vertices = np.vstack([BOX.vertices, BOX.vertices[[a, b]].mean(axis=0)])
    split = [[a, 8, c], [8, b, c]]
    for facets in (np.vstack([BOX.faces[1:], split, [[a, b, 8]]]), np.vstack([BOX.faces[1:], split])):
        result = loaded(vertices, facets)
        assert result.mesh.is_closed
        assert result.mesh.areas.min() > 1.0
        assert result.mesh.volume == pytest.approx(1000.0)
        assert "degenerate_facets" in kinds(result)


def test_vertices_that_nearly_meet_are_joined() -> None:
    corners = BOX.vertices[BOX.faces].reshape(-1, 3)
    near = corners + np.random.default_rng(0).uniform(-3e-6, 3e-6, corners.shape)
    result = loaded(near, np.arange(36).reshape(-1, 3), "ply")
    assert len(result.mesh.vertices) == 8
    assert result.mesh.is_closed
    assert kinds(result)["near_duplicate_vertices"].mended


@pytest.mark.parametrize(
    ("second", "volume"),
    [
        (moved(5, 3, 2), 1720.0),
        (moved(5, 0, 0), 1500.0),
        (moved(10, 0, 0), 2000.0),
        (moved(0, 0, 0, 0.5), 1000.0),
    ],
    ids=["corner in corner", "flush faces", "shared wall", "one inside the other"],
)
def test_bodies_that_overlap_are_united(second: trimesh.Trimesh, volume: float) -> None:
    result = joined(BOX, second)
    assert result.mesh.is_closed
    assert result.mesh.volume == pytest.approx(volume)
    assert kinds(result)["overlapping_bodies"].mended


def test_separate_bodies_are_counted_and_left_alone() -> None:
    result = joined(BOX, moved(20, 0, 0), moved(40, 0, 0))
    assert kinds(result)["several_bodies"].count == 3
    assert not kinds(result)["several_bodies"].mended
    assert result.mesh.volume == pytest.approx(3000.0)


def test_a_surface_that_passes_through_itself_is_refused_with_its_place() -> None:
    ball = octasphere(10.0, 3)
    ball.vertices[100] *= -1.3
    with pytest.raises(MeshError, match=r"passes through itself: \d+ pairs .* at \(.*\) mm"):
        loaded(ball.vertices, ball.faces)


def test_an_edge_with_three_facets_is_refused_with_its_place() -> None:
    fin = np.vstack([BOX.vertices, [[0, 0, 30]]])
    with pytest.raises(MeshError, match="three or more facets"):
        loaded(fin, np.vstack([BOX.faces, [[0, 7, 8]], [[int(BOX.faces[0, 0]), int(BOX.faces[0, 1]), 8]]]))


def test_a_one_sided_band_is_refused() -> None:
    turns = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    out = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(40)])
    width = np.cos(turns / 2)[:, None] * out + np.sin(turns / 2)[:, None] * [0, 0, 1]
    vertices = np.vstack([20 * out - 3 * width, 20 * out + 3 * width])
    facets = []
    for i in range(40):
        j, a, b = (i + 1) % 40, i, i + 40
        c, d = (j, j + 40) if i < 39 else (j + 40, j)
        facets += [[a, c, b], [b, c, d]]
    with pytest.raises(MeshError, match="only one side"):
        loaded(vertices, np.array(facets))


def test_a_single_sheet_is_refused() -> None:
    with pytest.raises(MeshError, match="not watertight"):
        loaded(BOX.vertices, BOX.faces[:1])


def test_a_finding_reads_as_one_line_with_place_and_volume() -> None:
    result = loaded(BOX.vertices, BOX.faces[:, ::-1])
    text = str(result.findings[0])
    assert "\n" not in text
    assert "first at (" in text
    assert "2000 mm³" in text
