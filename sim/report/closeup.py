"""The close-up of one place: the metal around it, coloured by deviation, with a mark, a millimetre scale and the commanded path."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from typing import Any

import matplotlib.image
import numpy as np
from numpy.typing import NDArray

from sim.picture import AMBIENT, DIFFUSE, PAPER, STEEL, rasterise, shading
from sim.report.chart import number, path
from sim.report.markup import Node, tag
from sim.report.silhouette import Outline, Stand, hull_of

Array = NDArray[np.float64]
Mesh = tuple[Array, NDArray[np.int64], Array]
"""Vertices (n, 3) mm build frame, facets (m, 3), deviation of the vertices (n,) mm."""

WIDE, HIGH = 360, 270  # size of the picture in the page's units
FINE = 4  # pixels of the drawing for each of these; halved for smooth edges
HALF_MM = 8.0  # half of the width shown
HALF_OF_BODIES_MM = 24.0  # the same where bodies met: a holder's width
REACH_HALVES = 3.0  # half widths from the place: metal farther away is left out, its cut edge lies outside the picture
HIDDEN_MM = 0.5  # a place this far behind the metal in front of it is not seen
ELEVATIONS = (0.55, 0.15, 1.2)  # rad, of the directions tried
AZIMUTHS = 8


@dataclass(frozen=True)
class Camera:
    """A parallel projection that looks against `towards` (from the scene to the eye) with `centre` in the middle of the picture.

    scale : pixels per mm; wide, high : pixels
    """

    centre: Array
    towards: Array
    scale: float
    wide: int
    high: int

    @property
    def right(self) -> Array:
        """Unit vector, to the picture's right."""
        flat = np.array([-self.towards[1], self.towards[0], 0.0])
        length = float(np.linalg.norm(flat))
        return flat / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])

    @property
    def up(self) -> Array:
        """Unit vector, upwards in the picture."""
        return np.asarray(np.cross(self.towards, self.right))

    def project(self, points: Array) -> Array:
        """(n, 3) mm -> (n, 3): pixels from the left and from the bottom, and mm towards the eye."""
        seen = (points - self.centre) @ np.stack([self.right, self.up, self.towards], axis=1)
        seen[:, :2] = seen[:, :2] * self.scale + 0.5 * np.array([self.wide, self.high])
        return np.ascontiguousarray(seen)


def direction(azimuth: float, elevation: float) -> Array:
    """Unit vector from azimuth and elevation, rad."""
    return np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])


def around(mesh: Mesh, at: Array, reach_mm: float) -> Mesh:
    """The part of the mesh within `reach_mm` of a place; its vertices numbered anew."""
    vertices, facets, deviation = mesh
    near = np.zeros(len(vertices), dtype=bool)
    box = np.flatnonzero((np.abs(vertices - at) < reach_mm).all(axis=1))
    near[box] = np.linalg.norm(vertices[box] - at, axis=1) < reach_mm
    kept = facets[near[facets].all(axis=1)]
    used, renumbered = np.unique(kept, return_inverse=True)
    return vertices[used], renumbered.reshape(kept.shape).astype(np.int64), deviation[used]


def first_seen_from(mesh: Mesh, at: Array) -> Array:
    """Unit vector to the eye: the first direction in a fixed order from which the place is not hidden."""
    vertices, facets, _ = mesh
    choices = [direction(0.75 + 2.0 * np.pi * k / AZIMUTHS, rise) for rise in ELEVATIONS for k in range(AZIMUTHS)]
    if not len(facets):
        return choices[0]
    for towards in choices:
        camera = Camera(at, towards, 6.0, 24, 24)
        screen = camera.project(vertices)
        depth = rasterise(screen, facets, screen[:, 2].copy(), np.ones(len(vertices)), camera.wide, camera.high)
        if depth[12, 12, 2] == 0.0 or depth[12, 12, 0] < HIDDEN_MM:
            return towards
    return choices[0]


def draw(mesh: Mesh, camera: Camera, limit_mm: float) -> Array:
    """The mesh as an image (high / 2, wide / 2, 3) in 0..1, coloured by deviation from -limit_mm (blue) to +limit_mm (red)."""
    vertices, facets, deviation = mesh
    drawn = np.zeros((camera.high, camera.wide, 3))
    if len(facets):
        shade = shading(vertices, facets, camera.right, camera.up, camera.towards)
        drawn = rasterise(camera.project(vertices), facets, deviation, shade, camera.wide, camera.high)[::-1]
    colours = STEEL(np.clip(0.5 + 0.5 * drawn[..., 0] / limit_mm, 0.0, 1.0))[..., :3]
    matt = np.minimum(drawn[..., 1:2], AMBIENT + DIFFUSE)
    lit = colours * matt + np.maximum(drawn[..., 1:2] - matt, 0.0)
    image = np.where(drawn[..., 2:3] > 0.0, np.clip(lit, 0.0, 1.0), PAPER)
    halved: Array = image.reshape(camera.high // 2, 2, camera.wide // 2, 2, 3).mean(axis=(1, 3))
    return halved


def data_uri(png: bytes) -> str:
    """A PNG as a data URI."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def png_of(image: Array) -> bytes:
    """An image (h, w, 3) in 0..1 as PNG that holds pixels and nothing else."""
    out = io.BytesIO()
    unsigned: Any = {"Software": None}  # no name and version of the library in the file
    matplotlib.image.imsave(out, np.round(image * 255.0).astype(np.uint8), format="png", metadata=unsigned)
    return out.getvalue()


def closeup(
    mesh: Mesh, at: Array, commanded: list[Array], here: Array, limit_mm: float, words: str, stand: Stand | None = None, half_mm: float = HALF_MM
) -> Node:  # fmt: skip
    """The picture of one place.

    at : (3,) mm, build frame   commanded : polylines (n, 3) of the path before and after   here : (n, 3) path of the line at fault
    limit_mm : where the colours end   words : what it shows, for those who cannot see it
    stand : the tool and what it met, drawn as outlines over the metal   half_mm : half of the width shown
    """
    piece = around(mesh, at, REACH_HALVES * half_mm)
    towards = first_seen_from(piece, at)
    scale = WIDE * FINE / 2 / (2.0 * half_mm)
    image = draw(piece, Camera(at, towards, scale, WIDE * FINE // 2, HIGH * FINE // 2), limit_mm)
    page = Camera(at, towards, WIDE / (2.0 * half_mm), WIDE, HIGH)
    drawn: list[Node | None] = [
        tag("image", href=data_uri(png_of(image)), x=0, y=0, width=WIDE, height=HIGH),
        *(_stroke(page, run, "path-near") for run in commanded),
        *(_bodies(page, stand) if stand else ()),
        _stroke(page, here, "path-halo"),
        _stroke(page, here, "path-here"),
        *_mark(),
        _ruler(page.scale),
        _compass(page),
        None if len(piece[1]) else tag("text", "no metal stands here", x=WIDE / 2, y=HIGH - 40, class_="note middle"),
        *(_names(stand) if stand else ()),
        tag("rect", x=0.5, y=0.5, width=WIDE - 1, height=HIGH - 1, class_="frame"),
    ]
    return tag("svg", *drawn, viewBox=f"0 0 {WIDE} {HIGH}", role="img", aria_label=words, class_="closeup")


def _bodies(camera: Camera, stand: Stand) -> list[Node | None]:
    """Outlines of the bodies as seen, and the tool's axis with its tip."""
    drawn: list[Node | None] = [_outline(camera, outline) for outline in stand.outlines]
    tip = camera.project(stand.axis[:1])[0]
    spot = tag("circle", cx=round(float(tip[0]), 1), cy=round(float(camera.high - tip[1]), 1), r=3, class_="tip")
    return [*drawn, _stroke(camera, stand.axis, "tool-axis"), spot]


def _outline(camera: Camera, outline: Outline) -> Node | None:
    """The silhouette of one convex body."""
    corners = hull_of(camera.project(outline.points)[:, :2])
    if len(corners) < 3:
        return None
    closed = path(corners[:, 0], camera.high - corners[:, 1]) + "z"
    return tag("path", tag("title", outline.name), d=closed, class_="body-tool" if outline.is_tool else "body-met")


def _names(stand: Stand) -> list[Node]:
    """Which outlines are whose, in the upper left corner."""
    groups = [("tool", [each.name for each in stand.outlines if each.is_tool]), ("met", [each.name for each in stand.outlines if not each.is_tool])]
    lines = [(kind, ", ".join(dict.fromkeys(names))) for kind, names in groups if names]
    wide = 34.0 + 5.2 * max((len(text) for _, text in lines), default=0)
    drawn: list[Node] = [tag("rect", x=6, y=6, width=wide, height=4 + 14 * len(lines), class_="paper")]
    for row, (kind, text) in enumerate(lines):
        drawn.append(tag("path", d=f"M11 {15 + 14 * row}h14", class_=f"body-{kind}"))
        drawn.append(tag("text", text, x=30, y=18.5 + 14 * row, class_="note"))
    return drawn


def _stroke(camera: Camera, points: Array, class_: str) -> Node | None:
    if len(points) < 2:
        return None
    seen = camera.project(points)
    return tag("path", d=path(seen[:, 0], camera.high - seen[:, 1]), class_=class_)


def _mark() -> list[Node]:
    """A ring with four ticks in the middle of the picture, dark on light so that it shows on any colour."""
    x, y = WIDE / 2, HIGH / 2
    ticks = f"M{x - 24} {y}h10M{x + 14} {y}h10M{x} {y - 24}v10M{x} {y + 14}v10"
    return [
        *(tag("circle", cx=x, cy=y, r=14, class_=name) for name in ("mark-halo", "mark")),
        *(tag("path", d=ticks, class_=name) for name in ("mark-halo", "mark")),
    ]


def _ruler(scale: float) -> Node:
    """A bar of round length in the lower left corner."""
    length = next(value for value in (50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1) if value * scale < 0.3 * WIDE)
    bar = f"M14 {HIGH - 20}v8h{length * scale:.6g}v-8"
    back = tag("rect", x=8, y=HIGH - 30, width=length * scale + 12, height=24, class_="paper")
    return tag("g", back, tag("path", d=bar, class_="ruler"), tag("text", f"{number(length)} mm", x=18, y=HIGH - 17, class_="note"))


def _compass(camera: Camera) -> Node:
    """The axes of the build frame in the lower right corner."""
    x, y = WIDE - 40.0, HIGH - 38.0
    drawn = [tag("rect", x=x - 34, y=y - 34, width=68, height=66, class_="paper")]
    for index, name in enumerate("XYZ"):
        axis = np.eye(3)[index]
        dx, dy = 22.0 * float(axis @ camera.right), -22.0 * float(axis @ camera.up)
        if np.hypot(dx, dy) > 3.0:
            drawn.append(tag("path", d=f"M{x:.6g} {y:.6g}l{dx:.1f} {dy:.1f}", class_="ruler"))
            drawn.append(tag("text", name, x=round(x + 1.35 * dx, 1), y=round(y + 1.35 * dy + 3.5, 1), class_="note middle"))
    return tag("g", *drawn)
