"""In which order the islands of a layer are built: neighbours not one after the other, as far as the way stays short."""

from __future__ import annotations

import itertools
import math

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

Floats = NDArray[np.float64]

MOST_TRAVEL = 1.5
"""Of the shortest way from island to island that is found: how much longer one may be on which neighbours cool."""


def islands_in_order(region: MultiPolygon, layer: int) -> list[Polygon]:
    """The polygons of a layer in the order in which they are filled; each layer begins with another one.

    The way goes from each to the nearest that is left. Every other one of that way first, then those between, lets each
    cool before its neighbours are built; that order is taken where it is not much longer, else the way itself.
    """
    parts = [part for part in shapely.get_parts(region) if part.geom_type == "Polygon" and not part.is_empty]
    if len(parts) < 2:
        return parts
    parts.sort(key=lambda part: (round(part.centroid.x, 3), round(part.centroid.y, 3)))
    places = np.array([[part.centroid.x, part.centroid.y] for part in parts])
    way = _nearest_way(places, layer % len(parts))
    apart = [*way[::2], *way[1::2]]
    chosen = apart if len(parts) > 2 and travel_mm(places, apart) <= MOST_TRAVEL * travel_mm(places, way) else way
    return [parts[k] for k in chosen]


def travel_mm(places: Floats, order: list[int]) -> float:
    """Length of the way through places.  places : (n, 2) float, mm"""
    return sum(math.dist(places[a], places[b]) for a, b in itertools.pairwise(order))


def _nearest_way(places: Floats, first: int) -> list[int]:
    """From place to the nearest that is left."""
    left = set(range(len(places))) - {first}
    way = [first]
    while left:
        here = places[way[-1]]
        way.append(min(left, key=lambda k: (round(math.dist(here, places[k]), 6), k)))
        left.remove(way[-1])
    return way
