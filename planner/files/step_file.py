"""A model as STEP: ruled B-spline faces and trimmed planes, sewn with OpenCascade (the optional extra `cad`)."""

from __future__ import annotations

import importlib
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import FileFormatError
from planner.nurbs.basis import Side
from planner.nurbs.ruled import RuledSurface
from planner.nurbs.surface import Surface

if TYPE_CHECKING:
    from planner.model import Approximation

_SEWN_CHORDS = 8.0
"""Sewing tolerance as a multiple of the model's chord error: the trimmed planes' edges are within 2 of the ruled faces'."""
SIDES: tuple[Side, Side] = ("left", "right")
_SMOOTH = 1e-5  # one less the cosine of a turn that counts as a corner: a quarter of a degree
_POINT_MM = 1e-7  # OpenCascade's own measure of what is one point


def open_cascade(name: str) -> Any:
    """A module of OpenCascade's Python binding.  Raises FileFormatError, one line, where it is not installed."""
    try:
        return importlib.import_module(f"OCP.{name}")
    except ImportError:
        raise FileFormatError("STEP needs OpenCascade", "install the extra: pip install 'hybridcell[cad]'") from None


def step_bytes(model: Approximation, name: str) -> bytes:
    """The STEP file (AP214, mm) of a model: a solid where the faces close, else a shell.

    Raises FileFormatError where OpenCascade is not installed or cannot write it.
    """
    control = open_cascade("STEPControl")
    open_cascade("Message").Message.DefaultMessenger_s().ChangePrinters().Clear()  # it would talk on stdout
    writer = control.STEPControl_Writer()
    writer.Transfer(step_shape(model), control.STEPControl_StepModelType.STEPControl_AsIs)
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / f"{name}.step"
        if writer.Write(str(target)) != open_cascade("IFSelect").IFSelect_ReturnStatus.IFSelect_RetDone:
            raise FileFormatError("OpenCascade could not write the model as STEP", "write it as .stl or .glb")
        return target.read_bytes()


def step_shape(model: Approximation) -> Any:
    """All walls and planar faces of a model sewn: a solid where they close."""
    builder = open_cascade("BRepBuilderAPI")
    sewing = builder.BRepBuilderAPI_Sewing(_SEWN_CHORDS * model.chord_mm)
    for layer in model.layers:
        for wall in layer.walls:
            for part in smooth_parts(wall.surface):
                surface = b_spline_surface(part.as_surface())
                sewing.Add(builder.BRepBuilderAPI_MakeFace(surface, _POINT_MM).Face())
    for face in model.closed.faces:
        sewing.Add(planar_face(face.rings))
    sewing.Perform()
    return solid_of(sewing.SewedShape())


def smooth_parts(surface: RuledSurface) -> list[RuledSurface]:
    """A ruled surface cut along the rulings at which either of its curves has a corner: faces without an edge inside."""
    joints = surface.curve0.breaks[1:-1]
    bent = np.zeros(len(joints), dtype=bool)
    for curve in (surface.curve0, surface.curve1):
        before, after = (curve.derivatives(joints, 1, side)[1] for side in SIDES)
        lengths = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
        bent |= np.einsum("ij,ij->i", before, after) < (1.0 - _SMOOTH) * lengths
        bent |= lengths <= 0.0
    at = joints[bent]
    if not len(at):
        return [surface]
    pairs = zip(surface.curve0.split(at), surface.curve1.split(at), strict=True)
    return [RuledSurface(low, high) for low, high in pairs]


def b_spline_surface(surface: Surface) -> Any:
    """A `Geom_BSplineSurface` of the same knots and control points."""
    grid_of_points, row_of_numbers, row_of_counts = array_types()
    point = open_cascade("gp").gp_Pnt
    net = surface.control_points
    poles = grid_of_points(1, net.shape[0], 1, net.shape[1])
    for i in range(net.shape[0]):
        for j in range(net.shape[1]):
            poles.SetValue(i + 1, j + 1, point(*net[i, j].tolist()))
    tables = []
    for knots in (surface.knots_u, surface.knots_v):
        values, times = np.unique(knots, return_counts=True)
        reals, integers = row_of_numbers(1, len(values)), row_of_counts(1, len(values))
        for k, (value, count) in enumerate(zip(values.tolist(), times.tolist(), strict=True), start=1):
            reals.SetValue(k, value)
            integers.SetValue(k, count)
        tables.append((reals, integers))
    (u, u_times), (v, v_times) = tables
    made = open_cascade("Geom").Geom_BSplineSurface
    return made(poles, u, v, u_times, v_times, surface.degree_u, surface.degree_v, False, False)


def array_types() -> tuple[Any, Any, Any]:
    """OpenCascade's grid of points, row of numbers and row of counts, as releases before 8 and from 8 on name them."""
    old = open_cascade("TColgp")
    if hasattr(old, "TColgp_Array2OfPnt"):
        rows = open_cascade("TColStd")
        return old.TColgp_Array2OfPnt, rows.TColStd_Array1OfReal, rows.TColStd_Array1OfInteger
    new = open_cascade("collections")
    return new.Array2_gp_Pnt, new.Array1_double, new.Array1_int


def planar_face(rings: tuple[NDArray[np.float64], ...]) -> Any:
    """A trimmed plane; rings (n, 3) float, mm, the outer one first."""
    builder, point = open_cascade("BRepBuilderAPI"), open_cascade("gp").gp_Pnt
    wires = []
    for ring in rings:
        polygon = builder.BRepBuilderAPI_MakePolygon()
        for place in ring.tolist():
            polygon.Add(point(*place))
        polygon.Close()
        wires.append(polygon.Wire())
    made = builder.BRepBuilderAPI_MakeFace(wires[0], True)
    for wire in wires[1:]:
        made.Add(wire)
    return made.Face()


def solid_of(shape: Any) -> Any:
    """The solid that a closed shell bounds; the shape itself where it does not close."""
    kind = open_cascade("TopAbs").TopAbs_ShapeEnum.TopAbs_SHELL
    shells = open_cascade("TopExp").TopExp_Explorer(shape, kind)
    if not shells.More():
        return shape
    topology = open_cascade("TopoDS").TopoDS
    shell = getattr(topology, "Shell_s", None) or topology.Shell
    found = shell(shells.Current())
    shells.Next()
    if shells.More() or not open_cascade("BRep").BRep_Tool.IsClosed_s(found):
        return shape
    return open_cascade("BRepBuilderAPI").BRepBuilderAPI_MakeSolid(found).Solid()
