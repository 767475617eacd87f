"""The bearing's features come out right in its model, and the pipe's model as files."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh

from planner.errors import FileFormatError, InputError
from planner.mesh import load
from planner.mesh.mesh import Mesh
from planner.model import Approximation, approximate
from planner.show.model_picture import model_png
from planner.slicing import slice_mesh

PARTS = Path(__file__).resolve().parents[3] / "config" / "parts"


@pytest.fixture(scope="module")
def bearing() -> Approximation:
    return approximate(load(PARTS / "bearing.stl"), (0.0, 0.0, 1.0), 0.08)


@pytest.fixture(scope="module")
def pipe() -> Approximation:
    return approximate(load(PARTS / "pipe.stl"), (0.0, 0.0, 1.0), 0.04)


def test_the_pipe_keeps_its_cusp_and_its_one_hole(pipe: Approximation):
    body = pipe.triangles().to_trimesh()
    assert body.is_watertight and body.euler_number == 0
    assert pipe.deviation().max_mm <= 0.04
    assert pipe.counts.branchings == 2


def test_the_bearing_keeps_its_cusp(bearing: Approximation):
    body = bearing.triangles().to_trimesh()
    assert body.is_watertight and body.euler_number == 2
    found = bearing.deviation()
    assert found.max_mm <= 0.08 and abs(found.volume_error) < 2e-3


def test_the_four_small_cylinders_stand_where_they_should(bearing: Approximation):
    plane = np.array([[0.0, 0.0, 11.0, 0.0, 0.0, 1.0]])
    for mesh in (bearing.triangles(), bearing.mesh):
        small = [loop for loop in slice_mesh(mesh, plane)[0].loops if loop.area_mm2 < 100.0]
        outlines = [shapely.Polygon(loop.points[:, :2]) for loop in small]
        centres = sorted((round(line.centroid.x, 2), round(line.centroid.y, 2)) for line in outlines)
        assert np.allclose(centres, [(6.0, 6.0), (6.0, 23.0), (49.0, 6.0), (49.0, 23.0)], atol=0.01)
        for loop in small:
            radius = np.linalg.norm(loop.points[:, :2] - np.round(loop.points.mean(axis=0)[:2]), axis=1)
            assert np.abs(radius - 3.0).max() < 0.02
    model = bearing.triangles()
    tops = (np.abs(model.normals[:, 2] - 1.0) < 1e-9) & (np.abs(model.centroids[:, 2] - 14.0) < 1e-6)
    assert model.areas[tops].sum() == pytest.approx(4.0 * np.pi * 9.0, rel=0.005)


def test_the_blind_hole_is_as_deep_and_as_wide_as_in_the_part(bearing: Approximation):
    middle = np.array([[27.5, 0.0, 0.0, 1.0, 0.0, 0.0]])
    areas = [slice_mesh(mesh, middle)[0].area_mm2 for mesh in (bearing.triangles(), bearing.mesh)]
    assert areas[0] == pytest.approx(areas[1], rel=1e-3)
    assert len(slice_mesh(bearing.triangles(), middle)[0].loops) == 1
    across = np.array([[0.0, y, 0.0, 0.0, 1.0, 0.0] for y in np.linspace(1.0, 28.0, 10)])
    pairs = zip(slice_mesh(bearing.triangles(), across), slice_mesh(bearing.mesh, across), strict=True)
    for made, given in pairs:
        holes = [[loop for loop in section.loops if loop.is_hole] for section in (made, given)]
        assert len(holes[0]) == len(holes[1])
        for one, two in zip(*holes, strict=True):
            assert np.allclose(one.points.min(axis=0), two.points.min(axis=0), atol=0.08)
            assert np.allclose(one.points.max(axis=0), two.points.max(axis=0), atol=0.08)
            assert one.area_mm2 == pytest.approx(two.area_mm2, rel=0.01)


def test_stl_and_gltf_read_back_as_the_model(pipe: Approximation, tmp_path: Path):
    pipe.export(tmp_path / "pipe.stl")
    again = load(tmp_path / "pipe.stl")
    assert again.is_closed and again.volume == pytest.approx(pipe.triangles().volume, rel=1e-5)
    pipe.export(tmp_path / "pipe.glb", with_original=True)
    scene = trimesh.load(io.BytesIO((tmp_path / "pipe.glb").read_bytes()), file_type="glb")
    assert isinstance(scene, trimesh.Scene)
    assert set(scene.geometry) == {"model", "original"}
    assert scene.geometry["original"].visual.material.alphaMode == "BLEND"
    metres = Mesh.from_trimesh(scene.geometry["model"])
    assert metres.volume * 1e9 == pytest.approx(pipe.triangles().volume, rel=1e-4)


def test_step_reads_back_with_the_model_s_volume(pipe: Approximation, tmp_path: Path):
    pytest.importorskip("OCP", reason="the optional extra cad (cadquery-ocp) is not installed")
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps
    from OCP.STEPControl import STEPControl_Reader

    pipe.export(tmp_path / "pipe.step")
    reader = STEPControl_Reader()
    reader.ReadFile(str(tmp_path / "pipe.step"))
    reader.TransferRoots()
    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(reader.OneShape(), properties)
    assert abs(properties.Mass()) == pytest.approx(pipe.triangles().volume, rel=1e-3)


def test_a_file_that_is_no_model_is_refused_in_one_line(pipe: Approximation, tmp_path: Path):
    with pytest.raises(InputError, match=r"\.txt"):
        pipe.export(tmp_path / "pipe.txt")
    with pytest.raises(FileFormatError, match="cannot be written"):
        pipe.export(tmp_path / "nowhere" / "pipe.stl")


def test_the_picture_is_the_same_each_time(pipe: Approximation):
    first = model_png(pipe, "pipe")
    assert first.startswith(b"\x89PNG") and first == model_png(pipe, "pipe")
