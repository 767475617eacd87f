"""The course of a run as charts: set-points beside read-backs over time and by layer, alarms and holds on the same axis."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellctl.record.samples import columns_of
from sim.report.chart import BOTTOM, LEFT, TOP, Frame, Scale, legend, spanning, svg
from sim.report.markup import Node, tag

Array = NDArray[np.float64]

BUCKETS = 600  # at most, along the page: more could not be seen apart
PER_BUCKET = 3  # samples at least, in the mean: no gaps between them
HEIGHT = 68.0
STEP = 80.0  # from one frame to the next
HEAD = 30.0  # room above the first frame
CHARTS = (
    ("laser, W", "laser_setpoint_w", "laser_readback_w"),
    ("powder, g/min", "powder_setpoint_g_min", "powder_readback_g_min"),
    ("speed, mm/s", None, "tip_speed_mm_s"),
    ("carrier, L/min", "carrier_gas_setpoint_l_min", "carrier_gas_readback_l_min"),
    ("shield, L/min", "shield_gas_setpoint_l_min", "shield_gas_readback_l_min"),
)
"""Name of the scale, column of the set-point, column of the read-back; a column that the samples do not have is left out."""


def bucketed(at: Array, values: Array, edges: Array) -> tuple[Array, Array, Array]:
    """(mean, least, greatest), each (b,), of values (n,) sampled at times `at` (n,), ascending, in buckets between edges (b + 1,).

    A bucket without a known value is NaN.
    """
    known = np.isfinite(values)
    place = np.clip(np.searchsorted(edges, at[known], side="right") - 1, 0, len(edges) - 2)
    values = values[known]
    count = np.bincount(place, minlength=len(edges) - 1)
    least, greatest = np.full(len(count), np.inf), np.full(len(count), -np.inf)
    np.minimum.at(least, place, values)
    np.maximum.at(greatest, place, values)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(place, weights=values, minlength=len(count)) / count
    empty = count == 0
    return mean, np.where(empty, np.nan, least), np.where(empty, np.nan, greatest)


def section(samples: Path, record: dict[str, Any]) -> list[Node]:
    """Charts over time, one below the other, from the record's own samples."""
    wanted = ["at", *(name for _, *names in CHARTS for name in names if name)]
    columns = columns_of(samples, wanted)
    at = columns["at"]
    if len(at) < 2 or at[-1] <= at[0]:
        return [tag("p", "The run left too few samples for a chart.", class_="soft")]
    begin, span = float(at[0]), float(at[-1] - at[0])
    unit, per = ("min", 60.0) if span > 600.0 else ("s", 1.0)
    count = min(BUCKETS, max(1, len(at) // PER_BUCKET))
    edges = np.linspace(begin, begin + span, count + 1)
    time = (edges - begin) / per
    x = Scale(0.0, float(time[-1]), f"time since the first sample, {unit}")
    known = {name for name, values in columns.items() if np.isfinite(values).any()}
    shown = [(name, columns.get(wanted or ""), columns[read]) for name, wanted, read in CHARTS if read in known]
    key = (("set", "set-point"), ("is", "read back"), ("key-range", "least to greatest"), ("limit", "alarm"))
    drawn: list[Node | None] = [legend(key, LEFT + 4, 9.0)]
    for index, (name, setpoint, readback) in enumerate(shown):
        drawn += _chart(Frame(x, Scale(0.0, 1.0), HEIGHT, HEAD + STEP * index), name, at, edges, setpoint, readback, index == len(shown) - 1)
    bottom = HEAD + STEP * (len(shown) - 1) + HEIGHT
    drawn += _marks(record, x, begin, per, bottom)
    words = (
        f"What was set and what was read back over the run, {record['samples']} samples in {count} spans."
        " Red lines: alarms. Grey fields: the job stood held or stopped."
    )
    return [tag("figure", svg(bottom + BOTTOM, words, *drawn), tag("figcaption", words))]


def _chart(frame: Frame, name: str, at: Array, edges: Array, setpoint: Array | None, readback: Array, is_last: bool) -> list[Node | None]:
    """One frame: the read-back's mean and extremes, the set-point's greatest value in each span."""
    mean, least, greatest = bucketed(at, readback, edges)
    wanted = None if setpoint is None else bucketed(at, setpoint, edges)[2]
    scale = spanning(np.concatenate([greatest, least, [] if wanted is None else wanted]), name)
    frame = Frame(frame.x, scale, frame.height, frame.at_y)
    left = (edges[:-1] - edges[0]) / (edges[-1] - edges[0]) * frame.x.high
    width = left[1] - left[0]
    wide = np.isfinite(least) & (greatest > least)
    return [
        frame.axes(with_x=is_last),
        frame.bars(left[wide], left[wide] + width, least[wide], greatest[wide], "range"),
        frame.line(left, wanted, "set") if wanted is not None else None,
        frame.line(left, mean, "is"),
    ]


def _marks(record: dict[str, Any], x: Scale, begin: float, per: float, bottom: float) -> list[Node]:
    """Alarms as lines through all charts, holds as fields."""
    frame = Frame(x, Scale(0.0, 1.0), bottom - HEAD, HEAD)
    ended = begin + x.high * per
    fields = [((hold["from_at"] - begin) / per, ((hold["to_at"] or ended) - begin) / per) for hold in record["holds"]]
    spans = np.array([span for span in fields if span[1] > span[0]], dtype=np.float64).reshape(-1, 2)
    foot = np.zeros(len(spans))
    held = tag("g", frame.bars(spans[:, 0], spans[:, 1], foot, foot + 1.0, "held"))
    return [held, *(frame.upright((alarm["at"] - begin) / per) for alarm in record["alarms"])]


def by_layer(layers: Sequence[dict[str, Any]]) -> list[Node]:
    """Set-points and read-backs of each layer: greatest laser power and powder rate, and the mean of what was read."""
    if not layers:
        return []
    number = np.array([row["layer"] + 1 for row in layers], dtype=np.float64)

    def column(name: str) -> Array:
        return np.array([row[name] for row in layers], dtype=np.float64)

    x = Scale(float(number.min()) - 0.5, float(number.max()) + 0.5, "layer")
    drawn: list[Node | None] = [legend((("set", "greatest set-point"), ("is", "greatest read-back"), ("layer", "mean read-back")), LEFT + 4, 10.0)]
    pairs = (("laser, W", "laser_{}_w"), ("powder, g/min", "powder_{}_g_min"))
    for index, (name, pattern) in enumerate(pairs):
        wanted, greatest, mean = (column(pattern.format(kind)) for kind in ("setpoint_max", "readback_max", "readback_mean"))
        frame = Frame(x, spanning(np.concatenate([wanted, greatest]), name), HEIGHT, TOP + 14 + STEP * index)
        drawn.append(frame.axes(with_x=index == len(pairs) - 1))
        drawn += [frame.line(number, values, style) for values, style in ((wanted, "set"), (greatest, "is"), (mean, "layer"))]
    words = "Laser power and powder rate by layer: what was set at most, what was read back at most and in the mean"
    return [tag("figure", svg(TOP + 14 + STEP + HEIGHT + BOTTOM, words, *drawn), tag("figcaption", words + "."))]
