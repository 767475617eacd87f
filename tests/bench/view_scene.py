"""A plan of five million drawn segments in a store, made with the service's own writers, and what a browser says of drawing it."""

from __future__ import annotations

import hashlib
import json
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import trimesh
from numpy.typing import NDArray
from playwright.sync_api import Page

from cellctl.domain.jobs import JobState
from cellctl.planning.container import pack, unpack
from cellctl.planning.geometry import layer_geometry, points_of
from cellctl.planning.track import INDEX as TRACK_INDEX
from cellctl.planning.track import chunk_file, track_beside
from cellctl.planning.view import OVERVIEW, layer_file, put, write_whole
from cellctl.store import jobs, open_store, parts
from cellctl.store.ids import new_id
from cellctl.store.jobs import JobRow
from cellctl.store.parts import Inspection, PartRow
from planner.nurbs.curve import Curve
from planner.plan import Layer, Operation, Pass, Process

LAYERS = 1000
LAYER_MM = 0.1
RINGS, RING_SEGMENTS = 4, 500
FILLS, FILL_SEGMENTS = 60, 50
RADIUS_MM = 30.0
LINES = 500  # of the program in each layer
LAYER_S = 60.0
PLAN, PROGRAM, MESH = ("5e" * 32, "9a" * 32, "3c" * 32)
NAME = "five million segments"
BROWSED_S = 6.0

TRACED = ["toplevel", "devtools.timeline"]
WATCH = """() => {
  window.longTasks = [];
  window.longTaskWatch?.disconnect();
  window.longTaskWatch = new PerformanceObserver((list) => window.longTasks.push(...list.getEntries().map((task) => task.duration)));
  window.longTaskWatch.observe({ type: "longtask" });
}"""


FAST = """async (input, times) => {
  for (const [n, time] of times.entries()) {
    input.value = time;
    input.dispatchEvent(new Event('input'));
    if (n % 2) await new Promise((done) => requestAnimationFrame(done));
  }
}"""


def _ring(radius: float, turns: NDArray[np.float64]) -> Curve:
    wavy = radius + 0.6 * np.sin(11 * turns)
    return Curve.from_polyline(np.column_stack([wavy * np.cos(turns), wavy * np.sin(turns), np.zeros(len(turns))]))


def first_layer() -> Layer:
    """Four wavy contours and sixty hatch lines whose points are all needed: RINGS * RING_SEGMENTS + FILLS * FILL_SEGMENTS segments."""
    turns = np.linspace(0.0, 2.0 * np.pi, RING_SEGMENTS + 1)
    axis = np.array([0.0, 0.0, 1.0])
    rows = np.array([[0.0, 12.0, 1100.0, 10.0, 15.0]])
    contours = tuple(Pass(_ring(RADIUS_MM - 1.5 * k, turns), axis, rows * [1, 1 + 0.1 * k, 1, 1, 1]) for k in range(RINGS))
    across = np.linspace(-20.0, 20.0, FILL_SEGMENTS + 1)
    wave = 0.1 * (-1.0) ** np.arange(FILL_SEGMENTS + 1)
    fills = []
    for y in np.linspace(-16.0, 16.0, FILLS):
        line = np.column_stack([across, y + wave, np.zeros(len(across))])
        fills.append(Pass(Curve.from_polyline(line), axis, rows * [1, 1, 0.9, 1, 1]))
    size = {"bead_width_mm": 1.5, "bead_height_mm": LAYER_MM}
    made = (Operation(Process.DEPOSIT_CONTOUR, 0, contours, **size), Operation(Process.DEPOSIT_FILL, 0, tuple(fills), **size))
    plane = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    return Layer(0, plane, plane + np.array([0, 0, LAYER_MM, 0, 0, 0]), (), (), 1.0, 0.0, made, thickness_mm=(LAYER_MM, LAYER_MM))


def planned_at(line: int) -> tuple[str, int, float, float]:
    """What the plan asks for at the end of a line of the program (from 0): process, pass (from 1), mm/s, W; from how the layer is made alone."""
    rings, fills = RINGS * (RING_SEGMENTS + 1), FILLS * (FILL_SEGMENTS + 1)
    vertex = int(np.linspace(1, rings + fills - 1, LINES)[line % LINES])
    if vertex < rings:
        ring = vertex // (RING_SEGMENTS + 1)
        return "contour", ring + 1, 12.0 * (1 + 0.1 * ring), 1100.0
    return "fill", (vertex - rings) // (FILL_SEGMENTS + 1) + 1, 12.0, 990.0


def _moved(header: dict[str, Any], number: int) -> dict[str, Any]:
    """The header of the same layer higher up."""
    z = LAYER_MM * number
    place = {**header["place"], "index": number, "z_bottom": z, "z_top": z + LAYER_MM}
    place |= {"bottom": [0, 0, z, 0, 0, 1], "top": [0, 0, z + LAYER_MM, 0, 0, 1]}
    x, y, low = header["origin"]
    return {**header, "place": place, "origin": [x, y, low + z]}


def write_views(plan: Path, program: Path) -> int:
    """Write the view folder of a plan and the track of a program; returns how many segments the plan has."""
    plan.mkdir(parents=True)
    track_beside(program).mkdir(parents=True)
    header, arrays = unpack(layer_geometry(first_layer()))
    for number in range(LAYERS):
        put(pack(_moved(header, number), arrays), plan / layer_file(number))
    write_whole(plan, LAYERS, 130.0)
    _write_overview(plan, header)
    _write_track(track_beside(program), header, arrays)
    return LAYERS * (len(arrays["position"]) - len(arrays["passes"]))


def _write_overview(plan: Path, header: dict[str, Any]) -> None:
    operations = [{"index": one["index"], "process": one["process"], "passes": one["passes"], "length_mm": 1.0} for one in header["operations"]]
    layers = [{**_moved(header, number)["place"], "operations": operations} for number in range(LAYERS)]
    overview = {
        "part": NAME, "material": "316L", "process": "deposit", "layers": layers, "bounds": [[-31, -31, 0], [31, 31, LAYERS * LAYER_MM]],
        "build_from_part": np.eye(4).tolist(), "tolerance_mm": 0.1, "findings": [], "volumes": {}, "subcomponents": [], "setups": [],
        "candidates": [], "skeleton": None,
    }  # fmt: skip
    put(msgspec.json.encode(overview), plan / OVERVIEW)


def _write_track(folder: Path, header: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
    points = points_of(header, arrays["position"])
    at = np.linspace(1, len(points) - 1, LINES).astype(int)
    number = np.searchsorted(arrays["passes"][:, 0], at, side="right") - 1
    operation = arrays["passes"][number, 1]
    firsts = np.searchsorted(arrays["passes"][:, 1], operation)
    still = np.tile(np.array([0.0, 0.0, 1.0], dtype=np.float32), (LINES, 1))
    common = {
        "time": np.linspace(LAYER_S / LINES, LAYER_S, LINES, dtype=np.float32), "axis": still, "joints": np.zeros((LINES, 5), dtype=np.float32),
        "arc": arrays["arc"][at].astype(np.float32), "path": np.linspace(0, 4000, LINES, dtype=np.float32),
        "pass": (number - firsts).astype(np.int32), "kind": np.full(LINES, 2, dtype=np.uint8),
    }  # fmt: skip
    chunks = []
    for layer in range(LAYERS):
        chunk = {
            "layer": layer, "first_line": layer * LINES, "lines": LINES, "time_start_s": layer * LAYER_S, "time_end_s": (layer + 1) * LAYER_S,
            "path_start_mm": 4000.0 * layer,
        }  # fmt: skip
        tip = (points[at] + [0.0, 0.0, layer * LAYER_MM]).astype(np.float32)
        before = {"tip": tip[0].tolist(), "axis": [0.0, 0.0, 1.0], "joints": [0.0] * 5}
        own = {**common, "tip": tip, "operation": (operation + 2 * layer).astype(np.int32)}
        put(pack({"schema": 2, "kind": "lines", **chunk, "before": before}, own), folder / chunk_file(layer))
        chunks.append(chunk)
    index = {"version": 2, "lines": LAYERS * LINES, "duration_s": LAYERS * LAYER_S, "axes": ["X", "Y", "Z", "A", "C"], "chunks": chunks}
    put(msgspec.json.encode(index), folder / TRACK_INDEX)


def add_job(store_folder: Path) -> int:
    """Put a job of that plan into a store that is served; returns how many segments it has."""
    store = open_store(store_folder)
    try:
        segments = write_views(store.blobs.view(PLAN), store.blobs.program(PROGRAM))
        body = trimesh.creation.cylinder(RADIUS_MM, LAYERS * LAYER_MM, sections=64)
        data = bytes(body.export(file_type="stl"))
        sha256 = hashlib.sha256(data).hexdigest()
        store.blobs.part(sha256, ".stl").write_bytes(data)
        store.blobs.mesh(MESH).write_bytes(data)
        now = store.clock()
        part = PartRow(new_id("part", now), NAME, ".stl", "mm", sha256, len(data), now, "bench", Inspection(MESH, body.bounds.tolist(), 1, 1.0, []))
        row = JobRow(
            new_id("job", now), NAME, part.id, "trunnion-tcp", 'process = "deposit"\n', "316L", now, "bench", JobState.WAITING_FOR_APPROVAL,
            plan_sha256=PLAN, program_sha256=PROGRAM, layers=LAYERS, lines_total=LAYERS * LINES, duration_s=LAYERS * LAYER_S,
        )  # fmt: skip
        with store.write() as rows:
            parts.add(rows, part)
            jobs.add(rows, row)
    finally:
        store.close()
    return segments


def costs(page: Page) -> dict[str, float]:
    """What the view says that its drawing costs."""
    told: dict[str, str] = page.evaluate("({...document.querySelector('.stage').dataset})")
    return {name: float(value) for name, value in told.items() if name not in ("ready", "tool", "tip")}


def scrub_to(page: Page, time_s: float) -> None:
    """Put the slider of the program's time where a hand would."""
    slider = page.locator(".scrub-bar input[type=range]")
    slider.evaluate("(input, time) => { input.value = time; input.dispatchEvent(new Event('input')) }", time_s)


def fast_scrub(page: Page, times_s: list[float]) -> None:
    """Put the slider from one time to the next, two in each frame: faster than what is shown can come."""
    page.locator(".scrub-bar input[type=range]").evaluate(FAST, times_s)


def longest_own_task_ms(events: list[dict[str, Any]]) -> float:
    """Most processor time of a task of the pages' main threads, from Chromium's trace. Raises ValueError if there is none in it."""
    main = {(one["pid"], one["tid"]) for one in events if one["name"] == "thread_name" and one["args"]["name"] == "CrRendererMain"}
    return max(one.get("tdur", 0) for one in events if one["name"].endswith("RunTask") and (one["pid"], one["tid"]) in main) / 1000


def browse(page: Page, do: str) -> dict[str, float]:
    """Scrub through the program or turn the drawing for BROWSED_S; the costs, worst over that time, and the page's longest tasks.

    longest_task_ms : by the wall clock, with the wait for the software rasteriser and for whatever else the machine does
    own_task_ms : processor time that the page's main thread spends in one task; drawing in software is other threads' work
    """
    browser = page.context.browser
    assert browser is not None
    page.evaluate(WATCH)
    browser.start_tracing(page=page, categories=TRACED)
    worst: dict[str, float] = {}
    first = costs(page)["frames"]
    stage = page.locator(".stage")
    began = time.monotonic()
    step = 0
    while time.monotonic() - began < BROWSED_S:
        if do == "scrub":
            scrub_to(page, step * 0.0137 % 1.0 * LAYERS * LAYER_S)
        else:
            stage.press("ArrowRight")
        step += 1
        for name, value in costs(page).items():
            worst[name] = max(worst.get(name, 0.0), value)
    tasks: list[float] = page.evaluate("window.longTasks")
    spent = time.monotonic() - began
    told = {"longest_task_ms": max(tasks, default=0.0), "long_share": sum(tasks) / 1000 / spent}
    told["own_task_ms"] = longest_own_task_ms(json.loads(browser.stop_tracing())["traceEvents"])
    return {**worst, **told, "frames_per_s": (costs(page)["frames"] - first) / spent}

