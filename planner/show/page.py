"""A plan as one web page of its own: a drawing per layer, a slider, the figures beside it."""

from __future__ import annotations

import json
from html import escape

import numpy as np

from planner.plan import Layer, Plan
from planner.show.strokes import COLOURS, layer_strokes
from planner.show.summary import smooth_deviation, text

_STYLE = """
body{font:14px/1.45 system-ui,sans-serif;margin:0;color:#212529;background:#f8f9fa}
header{padding:14px 22px;background:#fff;border-bottom:1px solid #dee2e6}h1{font-size:18px;margin:0}
main{display:flex;gap:22px;padding:18px 22px;flex-wrap:wrap}
#view{flex:1 1 560px;background:#fff;border:1px solid #dee2e6;border-radius:6px;padding:10px}
svg{width:100%;height:70vh}path{fill:none;vector-effect:non-scaling-stroke;stroke-linecap:round}
aside{flex:1 1 320px;max-width:640px}pre{overflow:auto;max-height:60vh;background:#fff;border:1px solid #dee2e6;padding:10px;font-size:12px}
label{margin-right:14px;white-space:nowrap}i{display:inline-block;width:18px;height:3px;vertical-align:middle;margin-right:5px}
input[type=range]{width:100%}
"""
_SCRIPT = """
const layers=JSON.parse(document.getElementById('layers').textContent);
const svg=document.querySelector('svg'),slider=document.querySelector('input[type=range]'),title=document.getElementById('title');
const hidden=new Set(['rapid']);
function draw(){const l=layers[+slider.value];title.textContent=l.title;
 svg.innerHTML=l.paths.filter(p=>!hidden.has(p[0])).map(p=>`<path class="${p[0]}" d="${p[1]}"/>`).join('');}
slider.addEventListener('input',draw);
document.querySelectorAll('[data-kind]').forEach(box=>box.addEventListener('change',()=>{
 box.checked?hidden.delete(box.dataset.kind):hidden.add(box.dataset.kind);draw();}));
draw();
"""


def html(plan: Plan) -> str:
    """A self-contained HTML page; it loads nothing."""
    layers = [{"title": _title(layer), "paths": _paths(layer)} for layer in plan.layers]
    low, high = _frame(plan)
    data = json.dumps(layers, separators=(",", ":")).replace("</", "<\\/")
    classes = "".join(
        f".{kind}{{stroke:{colour};stroke-width:{0.8 if kind in _FAINT else 1.8}}}" for kind, colour in COLOURS.items()
    )
    boxes = "".join(
        f'<label><input type="checkbox" data-kind="{kind}"{"" if kind == "rapid" else " checked"}> '
        f'<i style="background:{colour}"></i>{kind}</label>'
        for kind, colour in COLOURS.items()
    )
    box = f"{low[0]:.2f} {-high[1]:.2f} {high[0] - low[0]:.2f} {high[1] - low[1]:.2f}"
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(plan.part_name)}</title>'
        f"<style>{_STYLE}{classes}.part{{stroke:#212529;stroke-width:1.2}}</style>"
        f"<header><h1>{escape(plan.part_name)}: {escape(plan.process)} of {escape(plan.material)}</h1></header>"
        f'<main><div id="view"><div id="title"></div><svg viewBox="{box}" preserveAspectRatio="xMidYMid meet"></svg>'
        f'<input type="range" min="0" max="{len(layers) - 1}" value="0" aria-label="layer"><div>{boxes}</div></div>'
        f"<aside><pre>{escape(text(plan))}</pre></aside></main>"
        f'<script type="application/json" id="layers">{data}</script><script>{_SCRIPT}</script></html>\n'
    )


_FAINT = ("lead", "link", "rapid")


def _title(layer: Layer) -> str:
    facets = max((contour.deviation_mm for contour in layer.contours), default=0.0)
    surface = smooth_deviation(layer)
    off = "" if surface is None else f", {surface:.2e} mm from the smooth surface"
    return (
        f"layer {layer.index}: z {layer.bottom[2]:.3f} … {layer.top[2]:.3f} mm; "
        f"contours at most {facets:.5f} mm from the facets{off}"
    )


def _paths(layer: Layer) -> list[list[str]]:
    """[kind, SVG path] of the finished contours and of every stroke, y up."""
    found = [
        ["part", _path(contour.curve.evaluate(contour.curve.sample(0.02))[:, :2])] for contour in layer.contours
    ]
    found += [[stroke.kind, _path(stroke.points[:, :2])] for stroke in layer_strokes(layer)]
    return found


def _path(points: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str:
    return "M" + "L".join(f"{x:.2f} {-y:.2f}" for x, y in np.round(points, 2) + 0.0)


def _frame(plan: Plan) -> tuple[list[float], list[float]]:
    """Lowest and highest x and y of all that is drawn, with some room."""
    margin = 0.08 * float(np.max(plan.bounds[1, :2] - plan.bounds[0, :2])) + 6.0
    return (plan.bounds[0, :2] - margin).tolist(), (plan.bounds[1, :2] + margin).tolist()
