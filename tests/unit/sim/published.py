"""Single tracks from publications (published.toml) against the melt law: calibrate on one half of the tracks, judge the other."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from config import Tool, load_cell, load_material
from sim.process.melt import MeltLaw, bead_at, melt_law

Array = NDArray[np.float64]

FILE = Path(__file__).parent / "published.toml"
AMBIENT_K = 293.0
ABSORPTIVITIES = np.arange(0.20, 0.801, 0.01)  # what is published for solid and liquid metal and for powder lies within
SPOTS_MM = np.arange(0.6, 1.31, 0.1)
JETS_MM = np.arange(1.0, 4.01, 0.25)
HEAD: Tool = next(tool for tool in load_cell("trunnion_tcp").tools if tool.kind == "deposition")


@dataclass(frozen=True)
class TrackSet:
    """One publication's tracks.  measured : (n,) float by column name."""

    name: str
    material: str
    source: str
    note: str
    measured: dict[str, Array]
    calibrated: tuple[str, ...]
    spot_mm: float


@dataclass(frozen=True)
class Errors:
    """Calibrated constants of one set, and relative errors (signed) of widths and heights: of all tracks and of those held out."""

    absorptivity: float
    spot_mm: float
    jet_diameter_mm: float
    width: Array
    height: Array

    def held_out(self, of: Array) -> Array:
        """Those of the tracks that calibration did not see."""
        return of[~seen(of.size)]


def seen(count: int) -> NDArray[np.bool_]:
    """Half of the tracks: those with an even count of ones in their binary number, so that the halves of a factorial design are balanced."""
    return np.array([number.bit_count() % 2 == 0 for number in range(count)], dtype=bool)


def track_sets() -> list[TrackSet]:
    """All sets of the file."""
    found = []
    for entry in tomllib.loads(FILE.read_text(encoding="utf-8"))["set"]:
        tracks = np.array(entry["tracks"], dtype=float)
        measured = {name: tracks[:, k] for k, name in enumerate(entry["columns"])}
        spot = float(entry.get("spot_mm", np.nan))
        found.append(
            TrackSet(
                entry["name"],
                entry["material"],
                entry["source"],
                entry["note"],
                measured,
                tuple(entry["calibrated"]),
                spot,
            )
        )
    return found


def predicted(tracks: TrackSet, law: MeltLaw, rows: NDArray[np.bool_]) -> Array:
    """Width and height, (k, 2) float, mm, of the chosen tracks; each track's own spot where the set has one."""
    columns = {name: values[rows] for name, values in tracks.measured.items()}
    count = columns["power_w"].size
    powder = columns.get("powder_g_min", np.zeros(count))
    spots = columns.get("spot_mm", np.full(count, 2.0 * law.spot_mm))
    out = np.empty((count, 2))
    for i in range(count):
        own = law._replace(spot_mm=0.5 * float(spots[i]))
        out[i] = bead_at(own, columns["power_w"][i], powder[i], columns["speed_mm_s"][i], 0.0, 1.0, AMBIENT_K)[:2]
    return out


def errors_of(tracks: TrackSet) -> Errors:
    """Fit the head's constants that the set names to half of its tracks, by the mean of the absolute relative errors; judge all."""
    law = melt_law(load_material(tracks.material), HEAD)._replace(sticking=1.0)
    width = tracks.measured["width_mm"]
    spots = SPOTS_MM if "spot_mm" in tracks.calibrated else [1.0 if np.isnan(tracks.spot_mm) else tracks.spot_mm]

    fit = seen(width.size)

    def miss(law: MeltLaw, column: int, truth: Array) -> float:
        return float(np.abs(predicted(tracks, law, fit)[:, column] / truth[fit] - 1.0).mean())

    choices = [
        law._replace(absorptivity=float(a), spot_mm=0.5 * float(spot)) for a, spot in product(ABSORPTIVITIES, spots)
    ]
    law = min(choices, key=lambda choice: miss(choice, 0, width))
    height = tracks.measured.get("height_mm", np.empty(0))
    if height.size:
        jets = [law._replace(jet_mm=0.5 * float(jet)) for jet in JETS_MM]
        law = min(jets, key=lambda choice: miss(choice, 1, height))
    result = predicted(tracks, law, np.ones(width.size, dtype=bool))
    off = result[:, 1] / height - 1.0 if height.size else height
    return Errors(law.absorptivity, 2.0 * law.spot_mm, 2.0 * law.jet_mm, result[:, 0] / width - 1.0, off)
