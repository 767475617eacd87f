"""The picture of a built part: shaded, coloured by its deviation from the mesh, from two sides, with scale and figures."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from numba import njit
from numpy.typing import NDArray

from sim.compare import PICTURE_BASE_CELLS, Built
from sim.deviation import Deviation
from sim.process.stock import Stock
from sim.process.surface import built_mesh
from sim.process.target import Target

Array = NDArray[np.float64]

PIXELS = 1200  # of a view's longer side before it is halved for smooth edges
VIEWS = ((0.75, 0.55, "from front right"), (0.75 + np.pi, 0.3, "from back left"))  # azimuth, elevation, rad
LIGHT = np.array([0.45, 0.55, 0.70])  # right, up, towards the eye
AMBIENT, DIFFUSE, GLOSS, SHINE = 0.42, 0.52, 0.30, 24.0  # of Blinn and Phong's shading
PAPER = 0.97
INK = "#22272e"
STEEL = LinearSegmentedColormap.from_list(
    "steel", [(0.0, "#0b2a6b"), (0.25, "#2f78c4"), (0.46, "#b4bcc6"), (0.54, "#b9bcc0"), (0.75, "#e0702e"), (1.0, "#7a0a12")]
)  # as milled in the middle, blue where metal is missing, red where there is too much


@njit(cache=True, nogil=True)
def rasterise(screen: Array, facets: NDArray[np.int64], value: Array, shade: Array, width: int, height: int) -> Array:
    """Draw triangles with a depth buffer. screen (n, 3) pixels x, y and depth towards the eye; value, shade (n,) -> (h, w, 3).

    Layers of the result: value, shade, and 1 where something is drawn.
    """
    image = np.zeros((height, width, 3))
    depth = np.full((height, width), -1e30)
    for f in range(facets.shape[0]):
        i, j, k = facets[f]
        ax, ay, bx, by, cx, cy = screen[i, 0], screen[i, 1], screen[j, 0], screen[j, 1], screen[k, 0], screen[k, 1]
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if abs(area) < 1e-12:
            continue
        for py in range(max(0, int(min(ay, by, cy))), min(height - 1, int(max(ay, by, cy)) + 1) + 1):
            for px in range(max(0, int(min(ax, bx, cx))), min(width - 1, int(max(ax, bx, cx)) + 1) + 1):
                u = ((bx - px) * (cy - py) - (cx - px) * (by - py)) / area
                v = ((cx - px) * (ay - py) - (ax - px) * (cy - py)) / area
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                z = u * screen[i, 2] + v * screen[j, 2] + w * screen[k, 2]
                if z > depth[py, px]:
                    depth[py, px] = z
                    image[py, px, 0] = u * value[i] + v * value[j] + w * value[k]
                    image[py, px, 1] = u * shade[i] + v * shade[j] + w * shade[k]
                    image[py, px, 2] = 1.0
    return image


@njit(cache=True, nogil=True)
def vertex_normals(vertices: Array, facets: NDArray[np.int64]) -> Array:
    """Area-weighted unit normals, (n, 3)."""
    normals = np.zeros_like(vertices)
    for f in range(facets.shape[0]):
        i, j, k = facets[f]
        ux, uy, uz = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
        vx, vy, vz = vertices[k, 0] - vertices[i, 0], vertices[k, 1] - vertices[i, 1], vertices[k, 2] - vertices[i, 2]
        for corner in (i, j, k):
            normals[corner, 0] += uy * vz - uz * vy
            normals[corner, 1] += uz * vx - ux * vz
            normals[corner, 2] += ux * vy - uy * vx
    for n in range(normals.shape[0]):
        length = max(np.sqrt(normals[n, 0] ** 2 + normals[n, 1] ** 2 + normals[n, 2] ** 2), 1e-30)
        for d in range(3):
            normals[n, d] /= length
    return normals


@njit(cache=True, nogil=True)
def paint(drawn: Array, colours: Array, limit: float, matt: float, paper: float) -> Array:
    """A drawing of `rasterise` (2 h, 2 w, 3), from the bottom up, as an image (h, w, 3) in 0..1 from the top down.

    colours : (n, 3) in 0..1, of values from -limit to +limit   matt : shade above which it is gloss   paper : grey where nothing is drawn
    """
    high, wide, steps = drawn.shape[0], drawn.shape[1] // 2, colours.shape[0]
    image = np.zeros((high // 2, wide, 3))
    for y in range(high):
        row = (high - 1 - y) // 2
        for x in range(2 * wide):
            if drawn[y, x, 2] == 0.0:
                for d in range(3):
                    image[row, x // 2, d] += 0.25 * paper
                continue
            place = int(min(max((0.5 + 0.5 * drawn[y, x, 0] / limit) * steps, 0.0), steps - 1.0))
            shade = min(drawn[y, x, 1], matt)
            for d in range(3):
                image[row, x // 2, d] += 0.25 * min(max(colours[place, d] * shade + drawn[y, x, 1] - shade, 0.0), 1.0)
    return image


def render(vertices: Array, facets: NDArray[np.int64], value: Array, azimuth: float, elevation: float, limit: float) -> Array:
    """One view as an image (h, w, 3) in 0..1, its longer side PIXELS/2; value (n,) is coloured from -limit (blue) to +limit (red)."""
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    right = np.array([-sa, ca, 0.0])
    towards = np.array([ca * ce, sa * ce, se])
    up = np.cross(towards, right)
    frame = vertices @ np.stack([right, up, towards], axis=1)
    low, high = frame[:, :2].min(axis=0), frame[:, :2].max(axis=0)
    scale = 0.96 * PIXELS / float((high - low).max())
    width, height = (2 * int(np.ceil(0.5 * side)) for side in (high - low) * scale + 0.04 * PIXELS)
    screen = np.empty_like(frame)
    screen[:, :2] = (frame[:, :2] - 0.5 * (low + high)) * scale + 0.5 * np.array([width, height])
    screen[:, 2] = frame[:, 2]
    drawn = rasterise(screen, facets, value, shading(vertices, facets, right, up, towards), width, height)
    colours = np.ascontiguousarray(STEEL(np.arange(STEEL.N))[:, :3])
    image: Array = paint(drawn, colours, limit, AMBIENT + DIFFUSE, PAPER)
    return image


def shading(vertices: Array, facets: NDArray[np.int64], right: Array, up: Array, towards: Array) -> Array:
    """Brightness of each vertex, (n,): AMBIENT to AMBIENT + DIFFUSE, more is gloss."""
    normals = vertex_normals(vertices, facets)
    light = LIGHT[0] * right + LIGHT[1] * up + LIGHT[2] * towards
    light = light / np.linalg.norm(light)
    half = (light + towards) / np.linalg.norm(light + towards)
    facing = np.clip(normals @ light, 0.0, 1.0)
    gloss = np.clip(normals @ half, 0.0, 1.0) ** SHINE
    brightness: Array = AMBIENT + DIFFUSE * facing + GLOSS * gloss * facing
    return brightness


def picture(stock: Stock, target: Target, deviation: Deviation, tolerance_mm: float, name: str, built: Built | None = None) -> bytes:
    """PNG of the as-built part. Colours end at twice the tolerance; what stands on the substrate only is drawn.

    built : of `measure`, which saves finding the surface again
    """
    if built is None:
        vertices, facets = built_mesh(stock, PICTURE_BASE_CELLS * stock.cell_mm)
        built = vertices, facets, target.surface_distance(vertices, stock.cell_mm)
    vertices, facets, value = built
    figure = Figure(figsize=(12.0, 6.6), dpi=110, facecolor=(PAPER,) * 3)
    FigureCanvasAgg(figure)
    limit = 2.0 * tolerance_mm
    if len(vertices):
        for index, (azimuth, elevation, words) in enumerate(VIEWS):
            axes = figure.add_axes((0.015 + 0.455 * index, 0.16, 0.445, 0.74))
            axes.imshow(render(vertices, facets, value, azimuth, elevation, limit), interpolation="antialiased")
            axes.set_axis_off()
            figure.text(0.2375 + 0.455 * index, 0.135, words, color=INK, fontsize=9, ha="center")
    else:
        figure.text(0.46, 0.5, "no metal stands on the substrate", ha="center", color=INK, fontsize=14)
    bar = figure.add_axes((0.935, 0.20, 0.014, 0.62))
    scale = figure.colorbar(ScalarMappable(Normalize(-limit, limit), STEEL), cax=bar)
    scale.set_ticks([-limit, -tolerance_mm, 0.0, tolerance_mm, limit])
    scale.ax.tick_params(labelsize=8, colors=INK)
    bar.set_title("mm", fontsize=9, color=INK)
    bar.axhspan(-tolerance_mm, tolerance_mm, xmin=-0.35, xmax=-0.15, color=INK, clip_on=False)
    figure.text(0.02, 0.935, f"{name}: as built, coloured by deviation from the mesh", fontsize=14, color=INK, weight="bold")
    figure.text(0.02, 0.03, caption(deviation, tolerance_mm), fontsize=9.5, color=INK, linespacing=1.5)
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None}, facecolor=figure.get_facecolor())
    return out.getvalue()


def caption(deviation: Deviation, tolerance_mm: float) -> str:
    """The figures under the picture, two lines."""
    return (
        f"99 % of the surface within {deviation.p99_mm:.3f} mm (tolerance {tolerance_mm:g} mm, the bar beside the scale), "
        f"median {deviation.p50_mm:.3f} mm, most excess {deviation.max_excess_mm:.2f} mm, most missing {deviation.max_missing_mm:.2f} mm\n"
        f"missing {deviation.missing_mm3:.1f} and excess {deviation.excess_mm3:.1f} of {deviation.part_mm3:.0f} mm³; "
        f"{deviation.samples} points of the surface above the joint with the plate, grid {deviation.cell_mm:g} mm"
    )
