"""A plan as one web page of its own: the part in space, areas by layer, a drawing per layer, a slider, the figures beside it."""

from __future__ import annotations

import json
from html import escape

import numpy as np

from planner.plan import Layer, Plan
from planner.show.page_space import SPACE_SCRIPT, space_data
from planner.show.places import flat, is_level, where
from planner.show.space import HANGING, piece_colour
from planner.show.strokes import CHORD_MM, COLOURS, layer_strokes
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
canvas{width:100%;height:52vh;touch-action:none;cursor:grab}
#areas{height:110px;margin-top:6px}#areas rect{vector-effect:non-scaling-stroke}.hang{fill:url(#hatch)!important}
"""
_SCRIPT = """
const layers=JSON.parse(document.getElementById('layers').textContent);
const svg=document.querySelector('#layer'),slider=document.querySelector('input[type=range]'),title=document.getElementById('title');
const hatch=svg.innerHTML,hidden=new Set(['rapid']);
function draw(){const l=layers[+slider.value];title.textContent=l.title;
 svg.setAttribute('viewBox',l.box||svg.dataset.box);const mark=document.getElementById('mark');if(mark)mark.setAttribute('x',slider.value);
 svg.innerHTML=hatch+l.paths.filter(p=>!hidden.has(p[0])).map(p=>`<path class="${p[0]}" d="${p[1]}"/>`).join('');}
slider.addEventListener('input',draw);
document.querySelectorAll('[data-kind]').forEach(box=>box.addEventListener('change',()=>{
 box.checked?hidden.delete(box.dataset.kind):hidden.add(box.dataset.kind);draw();}));
draw();
"""


def html(plan: Plan) -> str:
    """A self-contained HTML page; it loads nothing."""
    layers = [_drawing(layer) for layer in plan.layers]
    low, high = _frame(plan)
    classes = "".join(
        f".{kind}{{stroke:{colour};stroke-width:{0.8 if kind in _FAINT else 1.8}}}" for kind, colour in COLOURS.items()
    )
    boxes = "".join(
        f'<label><input type="checkbox" data-kind="{kind}"{"" if kind == "rapid" else " checked"}> '
        f'<i style="background:{colour}"></i>{kind}</label>'
        for kind, colour in {**COLOURS, "hang": HANGING}.items()
    )
    box = f"{low[0]:.2f} {-high[1]:.2f} {high[0] - low[0]:.2f} {high[1] - low[1]:.2f}"
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(plan.part_name)}</title>'
        f"<style>{_STYLE}{classes}.part{{stroke:#212529;stroke-width:1.2}}.hang{{stroke:{HANGING};stroke-width:1}}</style>"
        f"<header><h1>{escape(plan.part_name)}: {escape(plan.process)} of {escape(plan.material)}</h1></header>"
        f'<main><div id="view"><canvas tabindex="0" aria-label="the plan in space; arrow keys turn it"></canvas>'
        f'<div>{_pieces(plan)}<label><input type="checkbox" id="built"> only up to the layer below</label></div>{_areas(plan)}'
        f'<div id="title"></div><svg id="layer" viewBox="{box}" data-box="{box}" preserveAspectRatio="xMidYMid meet">'
        f'<pattern id="hatch" width="1.2" height="1.2" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">'
        f'<rect width="0.35" height="1.2" fill="{HANGING}"/></pattern></svg>'
        f'<input type="range" min="0" max="{max(len(layers) - 1, 0)}" value="0" aria-label="layer"><div>{boxes}</div></div>'
        f"<aside><pre>{escape(text(plan))}</pre></aside></main>"
        f'<script type="application/json" id="layers">{_json(layers)}</script>'
        f'<script type="application/json" id="space">{_json(space_data(plan))}</script>'
        f"<script>{_SCRIPT}</script><script>{SPACE_SCRIPT}</script></html>\n"
    )


def _json(data: object) -> str:
    return json.dumps(data, separators=(",", ":")).replace("</", "<\\/")


def _pieces(plan: Plan) -> str:
    """Names of the subcomponents in their colours."""
    return "".join(
        f'<label><i style="height:11px;background:{piece_colour(k)}"></i>{escape(part.name)}</label>'
        for k, part in enumerate(plan.subcomponents)
    )


def _areas(plan: Plan) -> str:
    """Bars of the overhang area by layer on the colours of the pieces; nothing where nothing hangs."""
    most = max((layer.overhang_mm2 for layer in plan.layers), default=0.0)
    if most <= 0.0:
        return ""
    bands = "".join(
        f'<rect x="{part.layers[0]}" y="0" width="{part.layers[1] - part.layers[0]}" height="100" '
        f'fill="{piece_colour(k)}" opacity=".3"/>'
        for k, part in enumerate(plan.subcomponents)
    )
    bars = "".join(
        f'<rect x="{k + 0.1:.1f}" y="{100.0 - 100.0 * layer.overhang_mm2 / most:.2f}" width="0.8" '
        f'height="{100.0 * layer.overhang_mm2 / most:.2f}" fill="{HANGING}"><title>layer {k}: '
        f"{layer.overhang_mm2:.2f} mm²</title></rect>"
        for k, layer in enumerate(plan.layers)
        if layer.overhang_mm2 > 0.0
    )
    mark = '<rect id="mark" x="0" y="0" width="1" height="100" fill="none" stroke="#212529"/>'
    return (
        f"<div>overhang by layer, up to {most:.2f} mm²</div>"
        f'<svg id="areas" viewBox="0 0 {len(plan.layers)} 100" preserveAspectRatio="none">{bands}{bars}{mark}</svg>'
    )


_FAINT = ("lead", "link", "rapid")


def _title(layer: Layer) -> str:
    facets = max((contour.deviation_mm for contour in layer.contours), default=0.0)
    surface = smooth_deviation(layer)
    off = "" if surface is None else f", {surface:.2e} mm from the smooth surface"
    hangs = f"; {layer.overhang_mm2:.2f} mm² overhang" if layer.overhang_mm2 > 0.0 else ""
    place = f"z {layer.bottom[2]:.3f} … {layer.top[2]:.3f} mm" if is_level(layer) else f"in its own plane, {where(layer)}"
    return f"layer {layer.index}: {place}; contours at most {facets:.5f} mm from the facets{off}{hangs}"


def _drawing(layer: Layer) -> dict[str, object]:
    """Title and paths of a layer; one that is not level has a window of its own, since it has its own coordinates."""
    shapes = [
        ("part", flat(layer, contour.curve.evaluate(contour.curve.sample(CHORD_MM)))) for contour in layer.contours
    ]
    shapes += [(stroke.kind, flat(layer, stroke.points)) for stroke in layer_strokes(layer)]
    paths = [[kind, _path(points)] for kind, points in shapes]
    if layer.overhang:
        outlines = "".join(_path(flat(layer, outline)) + "Z" for outline in layer.overhang)
        paths.insert(0, ["hang", outlines])
    drawn: dict[str, object] = {"title": _title(layer), "paths": paths}
    if not is_level(layer) and shapes:
        points = np.vstack([points for _, points in shapes])
        low, high = points.min(axis=0), points.max(axis=0)
        room = 0.08 * float((high - low).max()) + 0.5
        size = high - low + 2.0 * room
        drawn["box"] = f"{low[0] - room:.2f} {-high[1] - room:.2f} {size[0]:.2f} {size[1]:.2f}"
    return drawn


def _path(points: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str:
    return "M" + "L".join(f"{x:.2f} {-y:.2f}" for x, y in np.round(points, 2) + 0.0)


def _frame(plan: Plan) -> tuple[list[float], list[float]]:
    """Lowest and highest x and y of all that is drawn, with some room."""
    margin = 0.08 * float(np.max(plan.bounds[1, :2] - plan.bounds[0, :2])) + 6.0
    return (plan.bounds[0, :2] - margin).tolist(), (plan.bounds[1, :2] + margin).tolist()
