"""The as-built surface: its picture, its figures, the histogram of its deviation and what each layer adds to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from sim.report.chart import BOTTOM, LEFT, TOP, Frame, Scale, legend, spanning, svg
from sim.report.closeup import data_uri
from sim.report.markup import Node, table, tag

if TYPE_CHECKING:
    from sim.deviation import Deviation
    from sim.proof import Proof

NARROW = 400.0  # width of the histogram, which stands beside the figures, in units of the page
LAYER_HEIGHT = 78.0  # of each of the two charts by layer
LEAST_PERCENT = 1e-3  # where the histogram's logarithmic scale begins


def section(proof: Proof) -> list[Node]:
    """Picture, figures and charts."""
    picture = None
    if proof.picture:
        words = "The part as the twin built it, from two sides, coloured by its deviation from the mesh"
        caption = f"{words}. Blue: metal is missing; red: too much; the bar beside the scale is the tolerance."
        picture = tag("figure", tag("img", src=data_uri(proof.picture), alt=words), tag("figcaption", caption))
    beside = tag("div", _figures(proof), _histogram(proof), class_="beside")
    return [tag("h2", "As built against the mesh"), *([picture] if picture else []), beside, *_layers(proof)]


def _figures(proof: Proof) -> Node:
    """Figures of the whole surface and of what a cutter left, side by side."""
    columns: list[tuple[str, Deviation]] = [("#Whole", proof.deviation)]
    if proof.milled is not None:
        columns.append(("#Milled", proof.milled))
    lines: list[tuple[str, Callable[[Deviation], str]]] = [
        ("Mean (+ too much, \N{MINUS SIGN} missing)", lambda d: f"{d.mean_mm:+.4f} mm".replace("-", "\N{MINUS SIGN}")),
        ("Half of it within", lambda d: f"{d.p50_mm:.3f} mm"),
        ("95 % within", lambda d: f"{d.p95_mm:.3f} mm"),
        ("99 % within", lambda d: f"{d.p99_mm:.3f} mm"),
        ("Highest bump", lambda d: f"{d.max_excess_mm:.3f} mm"),
        ("Deepest hollow", lambda d: f"{d.max_missing_mm:.3f} mm"),
        ("Points measured", lambda d: f"{d.samples}"),
    ]
    rows: list[tuple[Node | str, ...]] = [(name, *(show(deviation) for _, deviation in columns)) for name, show in lines]
    volumes = (
        f"Of {proof.deviation.part_mm3:.0f} mm\N{SUPERSCRIPT THREE} of the part, {proof.deviation.missing_mm3:.1f} are missing;"
        f" {proof.deviation.excess_mm3:.1f} stand outside it. Measured along the part's normal above the joint with the plate."
    )
    return tag("div", table(("Deviation", *(name for name, _ in columns)), rows), tag("p", volumes, class_="soft"))


def _histogram(proof: Proof) -> Node | None:
    """Share of the surface over its deviation, on a logarithmic scale that shows the tails."""
    if proof.histogram is None or not sum(proof.histogram.counts):
        return None
    edges = np.asarray(proof.histogram.edges_mm, dtype=np.float64)
    counts = np.asarray(proof.histogram.counts)
    percent = 100.0 * counts / float(counts.sum())
    middle = 0.5 * (edges[1:] + edges[:-1])
    outside = np.abs(middle) > proof.tolerance_mm
    x, y = Scale(float(edges[0]), float(edges[-1]), "deviation, mm"), Scale(LEAST_PERCENT, 100.0, "share, % (log)", log=True)
    frame = Frame(x, y, 165.0, width=NARROW)
    foot = np.full(len(percent), LEAST_PERCENT)
    below, above = int(counts[middle < -proof.tolerance_mm].sum()), int(counts[middle > proof.tolerance_mm].sum())
    classes = ((~outside, "bar"), (outside, "bar-out"))
    drawn = [
        frame.axes(),
        *(frame.bars(edges[:-1][which], edges[1:][which], foot[which], percent[which], name) for which, name in classes),
        frame.upright(-proof.tolerance_mm),
        frame.upright(proof.tolerance_mm),
    ]
    words = (
        f"Histogram of the deviation at {counts.sum()} points. Dashed: the tolerance; {below} points ({below / counts.sum():.2%}) lie more than"
        f" that below the part's surface, {above} ({above / counts.sum():.2%}) above. The first and the last bar also hold what lies beyond"
    )
    return tag("figure", svg(TOP + frame.height + BOTTOM, words, *drawn, width=NARROW), tag("figcaption", words + "."))


def _layers(proof: Proof) -> list[Node]:
    """Deviation and volumes layer by layer, on one scale of layers."""
    if not proof.layers:
        return []
    number = np.array([layer.layer for layer in proof.layers], dtype=np.float64)
    p99 = np.array([layer.p99_mm for layer in proof.layers])
    excess = np.array([layer.excess_mm3 for layer in proof.layers])
    missing = np.array([layer.missing_mm3 for layer in proof.layers])
    x = Scale(float(number.min()) - 0.5, float(number.max()) + 0.5, "layer")
    upper = Frame(x, spanning(np.append(p99, 1.1 * proof.allowed_mm), "99 % within, mm", 0.01), LAYER_HEIGHT, TOP + 14)
    lower = Frame(x, spanning(np.concatenate([excess, -missing]), "volume, mm\N{SUPERSCRIPT THREE}", 0.1), LAYER_HEIGHT, TOP + 26 + LAYER_HEIGHT)
    zero = np.zeros(len(number))
    drawn = [
        legend((("key-missing", "missing (down)"), ("key-excess", "too much (up)")), LEFT + 4, 10.0),
        upper.axes(with_x=False),
        upper.bars(number - 0.32, number + 0.32, zero, p99, "bar"),
        upper.level(proof.allowed_mm, f"bound {proof.allowed_mm:.3f} mm"),
        lower.axes(),
        lower.bars(number - 0.32, number + 0.32, zero, excess, "bar-excess"),
        lower.bars(number - 0.32, number + 0.32, -missing, zero, "bar-missing"),
        lower.level(0.0, "", "zero"),
    ]
    worst = proof.layers[int(np.argmax(p99))]
    words = f"Deviation and volumes by layer; the worst is layer {worst.layer}: 99 % of it within {worst.p99_mm:.3f} mm"
    return [tag("figure", svg(lower.at_y + lower.height + BOTTOM, words, *drawn), tag("figcaption", words + "."))]
