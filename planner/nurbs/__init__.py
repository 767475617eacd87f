"""The NURBS kernel: curves, fitting, measuring, offsets and ruled surfaces."""

from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate, interpolate_many

__all__ = ["Curve", "interpolate", "interpolate_many"]
