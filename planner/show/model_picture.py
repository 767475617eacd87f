"""An approximation beside its original: the layers' edges, and every facet coloured by its distance from the mesh."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.mesh.nearest import FacetTree
from planner.model import Approximation

Floats = NDArray[np.float64]

_ELEVATION_DEG, _AZIMUTH_DEG = 24.0, -58.0
_LIGHT = np.array([0.35, -0.45, 0.82])
_DPI = 120
_MOST_FACETS = 60_000  # of the picture's model: more are finer than its pixels


def model_png(model: Approximation, title: str = "") -> bytes:
    """A PNG file: the mesh on the left, the approximation on the right with the edges of its layers."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 6.2), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    turn = _towards_eye(model.axis)
    mesh = model.triangles()
    if len(mesh.facets) > _MOST_FACETS:
        mesh = model.triangles(model.chord_mm * (len(mesh.facets) / _MOST_FACETS) ** 2)
    distance = FacetTree(model.mesh).nearest(mesh.centroids)[0]
    scale = ScalarMappable(Normalize(0.0, model.cusp_mm), "viridis")
    left, right = figure.subplots(1, 2)
    _draw(left, model.mesh, turn, np.tile([0.72, 0.74, 0.78], (len(model.mesh.facets), 1)))
    _draw(right, mesh, turn, scale.to_rgba(distance)[:, :3])
    _draw_layers(right, model, turn)
    counts = model.counts
    left.set_title(f"original: {len(model.mesh.facets)} facets", fontsize=10)
    right.set_title(f"{counts.layers} {model.rule} layers, cusp {model.cusp_mm:g} mm", fontsize=10)
    figure.suptitle(title, fontsize=13)
    bar = figure.colorbar(scale, ax=[left, right], shrink=0.75, pad=0.02)
    bar.set_label("distance from the original, mm", fontsize=9)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def _towards_eye(axis: Floats) -> Floats:
    """(3, 3): rows are the picture's right and up, and the direction to the eye, for a part whose axis stands."""
    side = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    azimuth, elevation = np.radians(_AZIMUTH_DEG), np.radians(_ELEVATION_DEG)
    level = np.cos(azimuth) * np.cross(side, axis) + np.sin(azimuth) * side
    eye = np.cos(elevation) * level + np.sin(elevation) * axis
    right = np.cross(axis, eye)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(eye, right), eye])


def _draw(panel: Any, mesh: Mesh, turn: Floats, colours: Floats) -> None:
    """Facets that face the eye, the farthest first, shaded."""
    from matplotlib.collections import PolyCollection

    seen = mesh.normals @ turn[2] > 0.0
    corners = mesh.corners[seen] @ turn.T
    order = np.argsort(corners[:, :, 2].mean(axis=1), kind="stable")
    light = np.clip((mesh.normals @ turn.T) @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.0, 1.0)[seen, None]
    shaded = np.clip(colours[seen] * (0.5 + 0.55 * light), 0.0, 1.0)
    faces = PolyCollection(corners[order][:, :, :2], facecolors=shaded[order], edgecolors=shaded[order], linewidths=0.3)
    panel.add_collection(faces)
    panel.autoscale_view()
    panel.set_aspect("equal", adjustable="box")
    panel.set_axis_off()


def _draw_layers(panel: Any, model: Approximation, turn: Floats) -> None:
    """The layers' edges where their walls face the eye."""
    from matplotlib.collections import LineCollection

    lines = []
    for layer in model.layers:
        for wall in layer.walls:
            u = wall.surface.curve0.sample(0.25 * model.cusp_mm)
            for curve, v in ((wall.surface.curve0, 0.0), (wall.surface.curve1, 1.0)):
                points = curve.evaluate(u) @ turn.T
                seen = wall.surface.normals(u, v) @ turn[2] > 0.0
                both = seen[:-1] & seen[1:]
                lines.append(np.stack([points[:-1, :2], points[1:, :2]], axis=1)[both])
    panel.add_collection(LineCollection(list(np.concatenate(lines)), colors="black", linewidths=0.35, alpha=0.6))
