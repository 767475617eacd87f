"""A model as STEP: ruled B-spline faces and trimmed planes, sewn with OpenCascade (the optional extra `cad`)."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.errors import FileFormatError
from planner.nurbs.surface import Surface

if TYPE_CHECKING:
    from planner.model import Approximation

_SEWN_CHORDS = 8.0
"""Sewing tolerance as a multiple of the model's chord error: the trimmed planes' edges are within 2 of the ruled faces'."""


def step_bytes(model: Approximation, name: str) -> bytes:
    """The STEP file (AP214, mm) of a model: a solid where the faces close, else a shell.

    Raises FileFormatError where OpenCascade is not installed or cannot write it.
    """
    try:
        from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_Sewing
        from OCP.IFSelect import IFSelect_ReturnStatus
        from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer
    except ImportError:
        raise FileFormatError("STEP needs OpenCascade", "install the extra: pip install 'hybridcell[cad]'") from None
    sewing = BRepBuilderAPI_Sewing(_SEWN_CHORDS * model.chord_mm)
    for layer in model.layers:
        for wall in layer.walls:
            surface = b_spline_surface(wall.surface.as_surface())
            sewing.Add(BRepBuilderAPI_MakeFace(surface, 1e-7).Face())
    for face in model.closed.faces:
        sewing.Add(planar_face(face.rings))
    sewing.Perform()
    shape = solid_of(sewing.SewedShape())
    writer = STEPControl_Writer()
    writer.Transfer(shape, STEPControl_StepModelType.STEPControl_AsIs)
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / f"{name}.step"
        if writer.Write(str(target)) != IFSelect_ReturnStatus.IFSelect_RetDone:
            raise FileFormatError("OpenCascade could not write the model as STEP", "write it as .stl or .glb")
        return target.read_bytes()


def b_spline_surface(surface: Surface) -> Any:
    """A `Geom_BSplineSurface` of the same knots and control points."""
    from OCP.Geom import Geom_BSplineSurface
    from OCP.gp import gp_Pnt
    from OCP.TColgp import TColgp_Array2OfPnt
    from OCP.TColStd import TColStd_Array1OfInteger, TColStd_Array1OfReal

    net = surface.control_points
    poles = TColgp_Array2OfPnt(1, net.shape[0], 1, net.shape[1])
    for i in range(net.shape[0]):
        for j in range(net.shape[1]):
            poles.SetValue(i + 1, j + 1, gp_Pnt(*net[i, j].tolist()))
    tables = []
    for knots in (surface.knots_u, surface.knots_v):
        values, times = np.unique(knots, return_counts=True)
        reals, integers = TColStd_Array1OfReal(1, len(values)), TColStd_Array1OfInteger(1, len(values))
        for k, (value, count) in enumerate(zip(values.tolist(), times.tolist(), strict=True), start=1):
            reals.SetValue(k, value)
            integers.SetValue(k, count)
        tables.append((reals, integers))
    (u, u_times), (v, v_times) = tables
    return Geom_BSplineSurface(poles, u, v, u_times, v_times, surface.degree_u, surface.degree_v, False, False)


def planar_face(rings: tuple[Any, ...]) -> Any:
    """A trimmed plane; rings (n, 3) float, mm, the outer one first."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakePolygon
    from OCP.gp import gp_Pnt

    wires = []
    for ring in rings:
        polygon = BRepBuilderAPI_MakePolygon()
        for point in ring.tolist():
            polygon.Add(gp_Pnt(*point))
        polygon.Close()
        wires.append(polygon.Wire())
    made = BRepBuilderAPI_MakeFace(wires[0], True)
    for wire in wires[1:]:
        made.Add(wire)
    return made.Face()


def solid_of(shape: Any) -> Any:
    """The solid that a closed shell bounds; the shape itself where it does not close."""
    from OCP.BRep import BRep_Tool
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeSolid
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    shells = TopExp_Explorer(shape, TopAbs_ShapeEnum.TopAbs_SHELL)
    if not shells.More():
        return shape
    shell = TopoDS.Shell(shells.Current())
    shells.Next()
    if shells.More() or not BRep_Tool.IsClosed(shell):
        return shape
    return BRepBuilderAPI_MakeSolid(shell).Solid()
