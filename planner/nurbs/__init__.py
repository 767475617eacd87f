"""The NURBS kernel: curves and surfaces, many in one call, fitting, measuring, offsets and ruled surfaces."""

from planner.nurbs.batch import (
    CurveSet,
    bounding_boxes_many,
    closest_points_many,
    derivatives_many,
    evaluate_many,
    lengths_many,
    sample_many,
)
from planner.nurbs.closest import closest_points
from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate, interpolate_many
from planner.nurbs.ruled import RuledSurface
from planner.nurbs.surface import Surface
from planner.nurbs.surface_closest import closest_on_surface

__all__ = [
    "Curve",
    "CurveSet",
    "RuledSurface",
    "Surface",
    "bounding_boxes_many",
    "closest_on_surface",
    "closest_points",
    "closest_points_many",
    "derivatives_many",
    "evaluate_many",
    "interpolate",
    "interpolate_many",
    "lengths_many",
    "sample_many",
]
