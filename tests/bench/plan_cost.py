"""One part loaded and planned in a process of its own: times and peak memory as one line of JSON."""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path

from planner.mesh import load
from planner.pipeline import plan
from planner.plan import Layer
from planner.recipe import load_recipe


def main(part: Path, recipe: Path) -> None:
    """Print what loading and planning the part costs: s of CPU, s until the first layer, MB at the peak."""
    started, clock = time.process_time(), time.perf_counter()
    mesh = load(part)
    loaded = time.process_time()
    first: list[float] = []

    def on_layer(layer: Layer) -> None:
        if not first:
            first.append(time.process_time())

    made = plan(mesh, load_recipe(recipe), on_layer=on_layer)
    print(
        json.dumps(
            {
                "facets": len(mesh.facets),
                "layers": len(made.layers),
                "deviation_mm": max(c.deviation_mm for layer in made.layers for c in layer.contours),
                "load_s": loaded - started,
                "first_s": first[0] - loaded,
                "plan_s": time.process_time() - loaded,
                "wall_s": time.perf_counter() - clock,
                "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
            }
        )
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
