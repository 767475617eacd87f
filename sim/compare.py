"""As-built against the part: how far off the surface is, where metal is missing and where there is too much, whole and by layer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sim.deviation import Deviation, Histogram, LayerDeviation, histogram, spread_of
from sim.process.facet_tree import facet_tree, signed_distances
from sim.process.field import Field
from sim.process.stock import Stock
from sim.process.surface import Triangles, built_mesh, field_mesh
from sim.process.target import Target
from sim.process.volume_gap import Gaps, volume_gaps

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Paths = tuple[Array, Index]  # points (n, 3) mm of process paths, build frame, and the layer of each (n,)
Built = tuple[Array, Index, Array]  # as-built surface: vertices (n, 3) mm, facets (m, 3), deviation of each vertex (n,) mm

BASE_CELLS = 1.5  # surface at or below this height is the joint with the substrate
PICTURE_BASE_CELLS = 1.0  # the drawn surface ends here: under what counts, above the plate's own top
FAR_BANDS = 0.98  # of the band: a sample that lies farther off is measured to the as-built surface itself
FRACTION_CELLS = 0.5  # either way of a surface a cell is partly filled
TOLERANCE_CELLS = 0.5  # stands for the tolerance of the histogram when none is given
PATH_STEP_MM = 0.5  # nearest path points are looked up this far apart


class Measurement(NamedTuple):
    """What `measure` finds.

    whole : all of the part's surface   milled : what a cutter left, None without such   layers : ascending, empty without paths
    histogram : of the whole   built : the as-built surface with its deviation, for pictures
    """

    whole: Deviation
    milled: Deviation | None
    layers: tuple[LayerDeviation, ...]
    histogram: Histogram
    built: Built


class Difference(NamedTuple):
    """How far two as-builts differ: largest distance of a place on one's surface from the other's, mm, and volume in only one, mm3."""

    max_mm: float
    volume_mm3: float


class _Places(NamedTuple):
    """Where deviation is known: (n, 3) mm, deviation (n,) mm, and whether a cutter made the surface there (n,)."""

    points: Array
    deviation: Array
    is_cut: NDArray[np.bool_]


def measure(
    stock: Stock,
    target: Target,
    layer_paths: Paths | None = None,
    *,
    tolerance_mm: float | None = None,
    base_mm: float | None = None,
) -> Measurement:
    """Measure the stock against the part.

    layer_paths : process paths; a place belongs to the layer whose path is nearest. `paths_along` makes them from lines
    tolerance_mm : unit of the histogram; default half a cell   base_mm : surface at or below it does not count; default 1.5 cells

    At the part's samples the deviation is the field's: the distance from the sample to the as-built surface, + where the sample is in
    metal. Where that ends, at the stock's band, it is the distance to the nearest vertex of the as-built surface, too long by at most
    a tenth of a cell. In the other direction the exact distance of every as-built vertex to the part adds to the greatest excess.
    """
    base = BASE_CELLS * stock.cell_mm if base_mm is None else base_mm
    samples = _at_samples(stock, target, base)
    vertices, facets = built_mesh(stock, min(base, PICTURE_BASE_CELLS * stock.cell_mm))
    deviation = target.surface_distance(vertices, stock.cell_mm)
    bumps = _bumps(stock, vertices, deviation, base, samples)
    wanted = target.field_on(stock.origin, stock.cell_mm, FRACTION_CELLS * stock.cell_mm, stock.field.shape)
    gaps = volume_gaps(stock.field, wanted, 0.0)
    whole = _deviation(stock, target, samples, bumps, gaps)
    milled = None
    if samples.is_cut.any():
        near = stock.marks(gaps.centre) < 0
        cut = Gaps(gaps.centre[near], gaps.missing[near], gaps.excess[near])
        milled = _deviation(stock, target, _where(samples, samples.is_cut), _where(bumps, bumps.is_cut), cut)
    layers = () if layer_paths is None or not len(layer_paths[0]) else _by_layer(layer_paths, samples, bumps, gaps)
    unit = TOLERANCE_CELLS * stock.cell_mm if tolerance_mm is None else tolerance_mm
    return Measurement(whole, milled, layers, histogram(samples.deviation, unit), (vertices, facets, deviation))


def compare(stock: Stock, target: Target, base_mm: float | None = None) -> Deviation:
    """The figures of the whole surface alone; see `measure`."""
    return measure(stock, target, base_mm=base_mm).whole


def paths_along(starts: Array, ends: Array, layers: Index, step_mm: float = PATH_STEP_MM) -> Paths:
    """Points along straight pieces of path, at most `step_mm` apart. starts, ends : (n, 3) mm   layers : (n,)"""
    pieces = np.maximum(1, np.ceil(np.linalg.norm(ends - starts, axis=1) / step_mm)).astype(np.int64)
    piece = np.repeat(np.arange(len(pieces)), pieces)
    rank = np.arange(len(piece)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = ((rank + 0.5) / pieces[piece])[:, None]
    return starts[piece] + share * (ends - starts)[piece], np.asarray(layers, dtype=np.int64)[piece]


def difference(one: Stock | Field, other: Stock | Field) -> Difference:
    """How far two as-builts on the same grid differ. Raises ValueError when their grids differ."""
    first, second = (built.field if isinstance(built, Stock) else built for built in (one, other))
    gaps = volume_gaps(first, second)
    surfaces = field_mesh(first), field_mesh(second)
    apart = max(_farthest(surfaces[0], first, surfaces[1]), _farthest(surfaces[1], first, surfaces[0]))
    return Difference(apart, float(gaps.missing.sum() + gaps.excess.sum()))


def _farthest(surface: Triangles, grid: Field, other: Triangles) -> float:
    """Greatest distance of the vertices of one surface from another one, mm, exact; inf when there is nothing to measure to.

    Vertices that close the surface at the grid's last cells are no surface of the metal.
    """
    first, last = grid.origin + grid.cell_mm, grid.origin + grid.cell_mm * (np.array(grid.shape) - 2)
    vertices = surface[0][((surface[0] > first) & (surface[0] < last)).all(axis=1)]
    if not len(vertices):
        return 0.0
    if not len(other[0]):
        return float("inf")
    tree = facet_tree(np.ascontiguousarray(other[0][other[1]]))
    return float(np.abs(signed_distances(tree, np.ascontiguousarray(vertices))[0]).max())


def _at_samples(stock: Stock, target: Target, base: float) -> _Places:
    """Deviation at the part's samples above the base."""
    points = target.samples[target.samples[:, 2] > base]
    deviation = -stock.distance(points)
    is_cut = np.asarray(stock.marks(points) < 0)
    far = np.abs(deviation) > FAR_BANDS * stock.band_mm
    if far.any():
        vertices, _ = built_mesh(stock, -np.inf)
        if len(vertices):
            gap, nearest = cKDTree(vertices).query(points[far], workers=-1)
            deviation[far] = np.sign(deviation[far]) * np.maximum(gap, np.abs(deviation[far]))
            is_cut[far] = stock.marks(vertices[nearest]) < 0
    return _Places(points, deviation, is_cut)


def _bumps(stock: Stock, vertices: Array, deviation: Array, base: float, samples: _Places) -> _Places:
    """As-built vertices above the base that stand out of the part by more than a cell and more than most samples."""
    usual = float(np.percentile(np.abs(samples.deviation), 99.0)) if len(samples.deviation) else 0.0
    high = (vertices[:, 2] > base) & (deviation > max(stock.cell_mm * FRACTION_CELLS, usual))
    return _Places(vertices[high], deviation[high], np.asarray(stock.marks(vertices[high]) < 0))


def _where(places: _Places, chosen: NDArray[np.bool_]) -> _Places:
    return _Places(places.points[chosen], places.deviation[chosen], places.is_cut[chosen])


def _deviation(stock: Stock, target: Target, samples: _Places, bumps: _Places, gaps: Gaps) -> Deviation:
    return Deviation(
        **spread_of(samples.deviation, float(bumps.deviation.max(initial=0.0))),
        missing_mm3=float(gaps.missing.sum()),
        excess_mm3=float(gaps.excess.sum()),
        part_mm3=target.volume_mm3,
        samples=len(samples.deviation),
        cell_mm=stock.cell_mm,
    )


def _by_layer(paths: Paths, samples: _Places, bumps: _Places, gaps: Gaps) -> tuple[LayerDeviation, ...]:
    """Figures of each layer that has a path, by the nearest path of every place."""
    tree, names = _thinned(paths)
    layer_of = [names[tree.query(points, workers=-1)[1]] if len(points) else names[:0] for points in (samples.points, bumps.points, gaps.centre)]
    layers = np.unique(names)
    place = [np.searchsorted(layers, layer) for layer in layer_of]
    missing, excess = (np.bincount(place[2], volume, minlength=len(layers)) for volume in (gaps.missing, gaps.excess))
    most = np.zeros(len(layers))
    np.maximum.at(most, place[1], bumps.deviation)
    order = np.argsort(place[0], kind="stable")
    groups = np.split(samples.deviation[order], np.searchsorted(place[0][order], np.arange(1, len(layers))))
    return tuple(
        LayerDeviation(
            layer=int(layers[n]),
            **spread_of(group, float(most[n])),
            missing_mm3=float(missing[n]),
            excess_mm3=float(excess[n]),
            samples=len(group),
        )
        for n, group in enumerate(groups)
    )


def _thinned(paths: Paths) -> tuple[cKDTree, Index]:
    """One path point of each layer in each box of PATH_STEP_MM, and its layer."""
    points, layers = np.asarray(paths[0], dtype=np.float64), np.asarray(paths[1], dtype=np.int64)
    boxes = np.column_stack([np.floor(points / PATH_STEP_MM).astype(np.int64), layers])
    _, kept = np.unique(boxes, axis=0, return_index=True)
    kept.sort()
    return cKDTree(points[kept]), layers[kept]
