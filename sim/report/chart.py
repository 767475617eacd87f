"""Charts as SVG: one frame with a scale in each direction, and what is drawn in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.report.markup import Node, tag

Array = NDArray[np.float64]

LEFT, RIGHT, TOP, BOTTOM = 62.0, 14.0, 8.0, 34.0  # margins of a frame, in units of which 720 are the width of the page
WIDTH = 720.0


def ticks(low: float, high: float, count: int = 6) -> list[float]:
    """About `count` round values from low to high: steps of 1, 2 or 5 times a power of ten."""
    rough = (high - low) / max(1, count)
    power = 10.0 ** np.floor(np.log10(rough))
    step = float(next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= rough * 0.999))
    first = np.ceil(low / step - 1e-9)
    return [float(step * k) for k in np.arange(first, np.floor(high / step + 1e-9) + 1)]


def number(value: float) -> str:
    """A tick's text."""
    return f"{value + 0.0:.6g}".replace("-", "\N{MINUS SIGN}")


@dataclass(frozen=True)
class Scale:
    """A scale from low to high, named with its unit; logarithmic if said."""

    low: float
    high: float
    name: str = ""
    log: bool = False

    @property
    def marks(self) -> list[float]:
        """Where it has ticks."""
        if self.log:
            return [10.0**k for k in range(round(np.log10(self.low)), round(np.log10(self.high)) + 1)]
        return ticks(self.low, self.high)

    def share(self, values: Array | float) -> Array:
        """Position of values between low (0) and high (1), kept within."""
        given = np.clip(np.asarray(values, dtype=np.float64), self.low, self.high)
        if self.log:
            return np.asarray(np.log(given / self.low) / np.log(self.high / self.low))
        return np.asarray((given - self.low) / (self.high - self.low))


def spanning(values: Array, name: str, least: float = 1.0, floor: float | None = 0.0) -> Scale:
    """A scale that holds all finite values and, if given, `floor`; at least `least` wide, with some room above."""
    known = values[np.isfinite(values)]
    low = min(float(known.min(initial=np.inf)), np.inf if floor is None else floor)
    high = max(float(known.max(initial=-np.inf)), -np.inf if floor is None else floor)
    if not np.isfinite(low):
        low, high = 0.0, least
    high = max(high, low + least)
    room = 0.08 * (high - low)
    return Scale(low if low == floor else low - room, high + room, name)


@dataclass(frozen=True)
class Frame:
    """The field of a chart. `at_y` is its upper edge in the picture, so that several stand below each other on one x scale."""

    x: Scale
    y: Scale
    height: float = 150.0
    at_y: float = TOP
    width: float = WIDTH

    def px(self, values: Array | float) -> Array:
        """Horizontal position in the picture."""
        return np.asarray(LEFT + (self.width - LEFT - RIGHT) * self.x.share(values))

    def py(self, values: Array | float) -> Array:
        """Vertical position in the picture."""
        return np.asarray(self.at_y + self.height * (1.0 - self.y.share(values)))

    def axes(self, with_x: bool = True) -> Node:
        """Frame, grid lines, ticks and names of both scales."""
        left, right, bottom = LEFT, self.width - RIGHT, self.at_y + self.height
        drawn: list[Node] = []
        for value in self.y.marks:
            y = float(self.py(value))
            drawn.append(tag("line", x1=left, x2=right, y1=y, y2=y, class_="grid"))
            drawn.append(tag("text", number(value), x=left - 5, y=y + 3.5, class_="tick end"))
        for value in self.x.marks:
            x = float(self.px(value))
            drawn.append(tag("line", x1=x, x2=x, y1=self.at_y, y2=bottom, class_="grid"))
            if with_x:
                drawn.append(tag("text", number(value), x=x, y=bottom + 13, class_="tick middle"))
        drawn.append(tag("rect", x=left, y=self.at_y, width=right - left, height=self.height, class_="frame"))
        middle = self.at_y + 0.5 * self.height
        drawn.append(tag("text", self.y.name, x=14, y=middle, transform=f"rotate(-90 14 {middle:.6g})", class_="name middle"))
        if with_x:
            drawn.append(tag("text", self.x.name, x=0.5 * (left + right), y=bottom + 28, class_="name middle"))
        return tag("g", *drawn)

    def line(self, x: Array, y: Array, class_: str) -> Node:
        """A polyline; a value that is no number makes a gap, points that change nothing are left out."""
        return tag("path", d=path(self.px(x), np.where(np.isfinite(y), self.py(np.nan_to_num(y)), np.nan)), class_=class_)

    def bars(self, low: Array, high: Array, foot: Array, top: Array, class_: str) -> Node:
        """Upright bars from low to high in x and foot to top in y."""
        x0, x1, y0, y1 = self.px(low), self.px(high), self.py(foot), self.py(top)
        runs = [f"M{a:.1f} {c:.1f}H{b:.1f}V{d:.1f}H{a:.1f}Z" for a, b, c, d in zip(x0, x1, y0, y1, strict=True) if abs(c - d) > 0.05]
        return tag("path", d="".join(runs), class_=class_)

    def level(self, value: float, text: str, class_: str = "limit") -> Node:
        """A horizontal line with a text at its right end."""
        y = float(self.py(value))
        line = tag("line", x1=LEFT, x2=self.width - RIGHT, y1=y, y2=y, class_=class_)
        return tag("g", line, tag("text", text, x=self.width - RIGHT - 4, y=y - 3, class_="note end"))

    def upright(self, value: float, class_: str = "limit") -> Node:
        """A vertical line."""
        x = float(self.px(value))
        return tag("line", x1=x, x2=x, y1=self.at_y, y2=self.at_y + self.height, class_=class_)


def path(x: Array, y: Array) -> str:
    """SVG's path data of a polyline, to a tenth of a unit."""
    good = np.isfinite(x) & np.isfinite(y)
    x, y = np.round(x, 1), np.round(y, 1)
    kept = np.ones(len(x), dtype=bool)
    if len(x) > 2:
        kept[1:-1] = ~((y[1:-1] == y[:-2]) & (y[1:-1] == y[2:]))
    parts, pen = [], "M"
    for index in np.flatnonzero(kept | ~good):
        if not good[index]:
            pen = "M"
            continue
        parts.append(f"{pen}{x[index]:.6g} {y[index]:.6g}")
        pen = "L"
    return "".join(parts)


def svg(height: float, words: str, *drawn: Node | None, width: float = WIDTH) -> Node:
    """The picture. words : what it shows, for those who cannot see it"""
    return tag("svg", *drawn, viewBox=f"0 0 {width:g} {height:g}", role="img", aria_label=words, class_="chart")


def legend(entries: tuple[tuple[str, str], ...], x: float, y: float) -> Node:
    """Strokes with their names, side by side. entries : (class of the line, name)"""
    drawn: list[Node] = []
    for class_, name in entries:
        drawn.append(tag("path", d=f"M{x:.6g} {y:.6g}h22", class_=class_))
        drawn.append(tag("text", name, x=x + 27, y=y + 3.5, class_="tick"))
        x += 27 + 6.2 * len(name) + 18
    return tag("g", *drawn)
