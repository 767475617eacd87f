"""Error of the melt law against published single tracks; what was fitted and what was held out is stated in published.py and .toml."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from tests.unit.sim.published import ABSORPTIVITIES, JETS_MM, Array, Errors, TrackSet, errors_of, seen, track_sets

# Mean and 90th percentile of the absolute relative error of the tracks that were held out. A demand of 15 % on height and width
# is met in the mean by all sets, and in nine tracks of ten by the first two sets and by the heights of the fourth.
WIDTH_BOUNDS = {
    "Ti-6Al-4V, powder DED (LENS)": (0.06, 0.12),
    "Inconel 718, powder DED (LENS)": (0.06, 0.12),
    "316L, 0.5 mm spot on 0.1 mm of laid powder": (0.15, 0.23),
    "regression of a factorial design, powder DED, alloy not known": (0.12, 0.23),
}
HEIGHT_BOUNDS = (0.09, 0.15)
SETS = track_sets()


@cache
def errors(name: str) -> Errors:
    return errors_of(next(tracks for tracks in SETS if tracks.name == name))


def mean_and_p90(signed: Array) -> tuple[float, float]:
    return float(np.abs(signed).mean()), float(np.quantile(np.abs(signed), 0.9))


@pytest.mark.parametrize("tracks", SETS, ids=lambda tracks: tracks.name)
def test_widths_of_tracks_that_calibration_did_not_see_are_met(tracks: TrackSet) -> None:
    found = errors(tracks.name)
    mean, p90 = mean_and_p90(found.held_out(found.width))
    assert (mean, p90) <= WIDTH_BOUNDS[tracks.name] and p90 <= WIDTH_BOUNDS[tracks.name][1]
    assert mean <= 0.15


@pytest.mark.parametrize(
    "tracks", [tracks for tracks in SETS if "height_mm" in tracks.measured], ids=lambda tracks: tracks.name
)
def test_heights_of_tracks_that_calibration_did_not_see_are_met(tracks: TrackSet) -> None:
    mean, p90 = mean_and_p90(errors(tracks.name).held_out(errors(tracks.name).height))
    assert mean <= HEIGHT_BOUNDS[0] and p90 <= HEIGHT_BOUNDS[1]


@pytest.mark.parametrize("tracks", SETS, ids=lambda tracks: tracks.name)
def test_calibrated_constants_lie_inside_what_was_searched(tracks: TrackSet) -> None:
    found = errors(tracks.name)
    assert ABSORPTIVITIES[0] < found.absorptivity < 0.6
    assert found.height.size == 0 or JETS_MM[0] < found.jet_diameter_mm < JETS_MM[-1]


def test_every_set_says_where_it_comes_from_and_what_is_not_known() -> None:
    assert {tracks.material for tracks in SETS} == {"316L", "inconel718", "ti6al4v"}
    assert all("doi" in tracks.source or "Procedia" in tracks.source for tracks in SETS)
    assert all(tracks.note for tracks in SETS)


def test_half_of_a_factorial_design_is_balanced_in_every_factor() -> None:
    chosen = seen(16)
    assert chosen.sum() == 8
    assert all(np.array([bool(number >> bit & 1) for number in np.flatnonzero(chosen)]).sum() == 4 for bit in range(4))
