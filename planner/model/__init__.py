"""Layers with ruled or upright sides as one watertight model: built, measured against the mesh, exported."""

from planner.model.approximation import Approximation, ModelCounts, approximate
from planner.model.measuring import ModelDeviation, two_way

__all__ = ["Approximation", "ModelCounts", "ModelDeviation", "approximate", "two_way"]
