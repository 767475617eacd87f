"""What a part would take, before it is planned: layers, time, powder and cost, from its sections only."""

from planner.estimate.estimate import Estimate, estimate
from planner.estimate.prices import Cost, Missing

__all__ = ["Cost", "Estimate", "Missing", "estimate"]
