"""Trends: buckets against plain numpy, levels that forget nothing, silence as a gap, a year within a moment; over REST as it is asked."""

from __future__ import annotations

import io
import shutil
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from sqlalchemy import insert

from cellctl.domain.channels import NAMES
from cellctl.store import Store, open_store, trend_levels
from cellctl.store.schema import events, journal
from cellctl.store.schema import trend_levels as levels_table
from cellctl.store.trends import RAW_ROWS_MAX, trend
from tests.unit.cellctl.conftest import Web

Floats = NDArray[np.float64]
START = 1_700_000_000.0
LASER = NAMES.index("laser_readback_w")
YEAR_S = 365 * 86_400


def samples_in(store: Store, at: Floats, laser_w: Floats) -> None:
    """Samples with a laser that reads as given (NaN: unknown) and a feed override that counts up."""
    rows = [
        {"at": float(t), "job": "", "state": "IDLE", "laser_readback_w": None if np.isnan(w) else float(w), "feed_override_percent": float(k)}
        for k, (t, w) in enumerate(zip(at, laser_w, strict=True))
    ]
    with store.write_cell() as connection:
        connection.execute(insert(journal), rows)


def thin(store: Store) -> None:
    """What the service does over time."""
    taken = 1
    while taken:
        with store.write_cell() as rows:
            _, taken = trend_levels.advance(rows, trend_levels.upto(rows))


@pytest.fixture(scope="module")
def thinned(tmp_path_factory: pytest.TempPathFactory, empty_store: Path) -> tuple[Path, Floats, Floats]:
    """Two hours of a job at 2.5 Hz, with one spike of a single sample and some readings that nobody has; in the levels too."""
    at = START + np.arange(0.0, 7200.0, 0.4)
    laser = 800.0 + 50.0 * np.sin(at / 7.0)
    laser[10_011] = 1900.0
    laser[2500:2520] = np.nan
    folder = tmp_path_factory.mktemp("thinned") / "store"
    shutil.copytree(empty_store, folder)
    store = open_store(folder)
    samples_in(store, at, laser)
    thin(store)
    store.close()
    return folder, at, laser


@pytest.fixture
def run(thinned: tuple[Path, Floats, Floats], tmp_path: Path) -> Iterator[tuple[Store, Floats, Floats]]:
    folder, at, laser = thinned
    shutil.copytree(folder, tmp_path / "thinned")
    store = open_store(tmp_path / "thinned")
    yield store, at, laser
    store.close()


def plainly(at: Floats, values: Floats, edges: Floats) -> list[tuple[float, float, float]]:
    """Least, greatest and mean between edges, one bucket after the other."""
    found = []
    for low, high in pairwise(edges):
        inside = values[(at >= low) & (at < high)]
        inside = inside[~np.isnan(inside)]
        found.append((inside.min(), inside.max(), inside.mean()) if len(inside) else (np.nan,) * 3)
    return found


@pytest.mark.parametrize(
    ("start", "seconds", "points", "made_of"),
    [(990.0, 60.0, 1000, 0), (990.0, 1000.0, 300, 0), (1.0, 1800.0, 60, 10), (7.3, 6500.0, 11, 60), (0.0, 7200.0, 6, 600), (3.0, 7190.0, 1000, 10)],
)
def test_buckets_are_what_plain_numpy_says_whatever_level_answers(
    run: tuple[Store, Floats, Floats], start: float, seconds: float, points: int, made_of: int
) -> None:
    store, at, laser = run
    from_at = START + start
    with store.read_cell() as rows:
        found = trend(rows, from_at, from_at + seconds, points, ("laser_readback_w",))
    assert found.made_of == made_of
    edges = np.append(found.at, found.at[-1] + found.step_s) if found.step_s else np.append(found.at - 1e-6, found.at[-1] + 1e-6)
    expected = np.array(plainly(at, laser, edges))
    got = np.stack([found.least[:, 0], found.greatest[:, 0], found.mean[:, 0]], axis=1)
    inside = edges[1:] <= from_at + seconds
    np.testing.assert_allclose(got[inside], expected[inside], rtol=1e-5)
    assert inside.sum() >= 4 and len(found.at) <= points


def test_a_spike_of_one_sample_is_seen_from_far_away_and_after_its_samples_have_gone(run: tuple[Store, Floats, Floats]) -> None:
    store, at, _ = run
    with store.write_cell() as rows:
        rows.execute(journal.delete())
    with store.read_cell() as rows:
        found = trend(rows, at[0] - YEAR_S, at[-1] + 1.0, 1000)
    assert np.nanmax(found.greatest[:, LASER]) == 1900.0 and found.made_of == 3600
    assert found.samples.sum() == len(at)


def test_samples_that_no_level_holds_yet_are_in_the_answer(run: tuple[Store, Floats, Floats]) -> None:
    store, at, _ = run
    samples_in(store, at[-1] + np.arange(1.0, 30.0), np.full(29, 1234.0))
    with store.read_cell() as rows:
        found = trend(rows, at[0], at[-1] + 60.0, 500)
    assert found.made_of == 10 and found.greatest[-1, LASER] == 1234.0 and found.samples.sum() == len(at) + 29


def test_levels_made_in_pieces_are_those_made_at_once_and_nothing_counts_twice(run: tuple[Store, Floats, Floats]) -> None:
    store, at, laser = run
    with store.read_cell() as rows:
        assert trend_levels.advance(rows, trend_levels.upto(rows)) == (len(at), 0)
        stored = rows.execute(levels_table.select().where(levels_table.c.level_s == 600).order_by(levels_table.c.start_at)).all()
    figures = trend_levels.unpack([row.figures for row in stored])
    keys = np.floor(at / 600.0)
    for row, found in zip(stored, figures, strict=True):
        inside = laser[keys == row.start_at / 600]
        assert row.samples == len(inside)
        np.testing.assert_allclose(found[LASER], [np.nanmin(inside), np.nanmax(inside), np.nansum(inside), (~np.isnan(inside)).sum()], rtol=1e-6)


def test_silence_of_the_cell_is_a_gap_and_ten_seconds_without_news_are_none(store: Store) -> None:
    at = np.concatenate([START + np.arange(0.0, 300.0, 10.0), START + 1000.0 + np.arange(0.0, 300.0, 10.0)])
    samples_in(store, at, np.full(len(at), 5.0))
    with store.read_cell() as rows:
        for points in (1000, 20):
            found = trend(rows, START, START + 1400.0, points)
            gaps = np.flatnonzero(found.samples == 0)
            assert len(gaps) == 1 and START + 290.0 < found.at[gaps[0]] < START + 1000.0
            assert np.isnan(found.mean[gaps[0]]).all() and (np.diff(found.at) > 0.0).all()


def test_a_moment_that_nobody_sampled_is_empty(store: Store) -> None:
    with store.read_cell() as rows:
        for seconds in (60.0, YEAR_S):
            found = trend(rows, START, START + seconds, 1000)
            assert len(found.at) == 0


def test_old_figures_of_fewer_channels_are_read_and_the_new_ones_are_unknown() -> None:
    blob = trend_levels.pack(trend_levels.of_values(np.array([[1.0, 2.0]]))[0])
    figures = trend_levels.unpack([blob])
    assert figures.shape == (1, len(NAMES), 4)
    assert figures[0, :2, 0].tolist() == [1.0, 2.0] and np.isnan(figures[0, 2:, 0]).all() and (figures[0, 2:, 3] == 0.0).all()


def test_finest_levels_are_forgotten_in_time_and_the_coarse_ones_stay(run: tuple[Store, Floats, Floats]) -> None:
    store, at, _ = run
    with store.write_cell() as rows:
        while trend_levels.forget(rows, at[-1] + 100 * 86_400.0):
            pass
        left = {level for (level,) in rows.execute(levels_table.select().with_only_columns(levels_table.c.level_s).distinct())}
    assert left == {60, 600, 3600}


def test_a_year_is_answered_within_200_ms(store: Store) -> None:
    hours = np.arange(YEAR_S // 600)
    blob = trend_levels.pack(trend_levels.of_values(np.full((1, len(NAMES)), 7.0))[0])
    with store.write_cell() as rows:
        for level, count in ((600, len(hours)), (3600, len(hours) // 6)):
            found = [{"level_s": level, "start_at": int(START) + k * level, "samples": 60, "last_id": k, "figures": blob} for k in range(count)]
            rows.execute(insert(levels_table), found)
    samples_in(store, START + np.arange(RAW_ROWS_MAX + 100.0), np.zeros(RAW_ROWS_MAX + 100))
    took = []
    for _ in range(3):
        began = time.process_time()
        with store.read_cell() as rows:
            found_ = trend(rows, START, START + YEAR_S, 1000)
        took.append(time.process_time() - began)
    assert len(found_.at) >= 900 and min(took) < 0.2


async def test_trends_over_rest_name_channel_unit_and_set_point(web: Web) -> None:
    samples_in(web.service.store, START + np.arange(0.0, 50.0), np.full(50, 321.5))
    answer = (await web.viewer.get("/api/v1/cell/trends", params={"from": START, "to": START + 60.0, "channel": "laser_readback_w"})).json()
    assert answer["channels"] == [{"name": "laser_readback_w", "unit": "W", "setpoint": "laser_setpoint_w"}]
    assert answer["series"]["laser_readback_w"]["mean"] == [321.5] * 50 and answer["at"][1] == START + 1.0
    assert answer["step_s"] == 0.0 and set(answer["samples"]) == {1}
    whole = (await web.viewer.get("/api/v1/cell/trends", params={"from": START, "to": START + 60.0, "points": 6})).json()
    assert list(whole["series"]) == list(NAMES) and len(whole["at"]) == 5
    assert whole["series"]["tip_speed_mm_s"]["max"] == [None] * 5


@pytest.mark.parametrize(
    ("params", "words"),
    [({"channel": "lasr"}, "no channel"), ({"from": 5.0, "to": 5.0}, "not before"), ({"points": 0}, "points"), ({"from": "nan"}, "from")],
)
async def test_a_question_that_does_not_fit_is_refused_in_one_line(web: Web, params: dict[str, object], words: str) -> None:
    answer = await web.viewer.get("/api/v1/cell/trends", params=params)  # type: ignore[arg-type]
    problem = answer.json()
    assert answer.status_code == 422 and words in problem["detail"] + str(problem["errors"]) and "\n" not in problem["detail"]
    assert (await web.nobody.get("/api/v1/cell/trends")).status_code == 401


async def test_a_trend_that_a_level_answers_is_a_document_too(web: Web) -> None:
    at = START + np.arange(0.0, 7200.0, 5.0)
    samples_in(web.service.store, at, np.full(len(at), 1000.0))
    thin(web.service.store)
    answer = await web.viewer.get("/api/v1/cell/trends", params={"from": START, "to": START + 7200.0, "points": 50})
    assert answer.status_code == 200 and answer.json()["made_of_s"] >= 10 and answer.json()["step_s"] >= 144.0


async def test_the_same_trend_as_csv_and_as_arrow(web: Web) -> None:
    import pyarrow as pa

    samples_in(web.service.store, START + np.arange(0.0, 50.0), np.append(np.full(49, 1.25), np.nan))
    params = {"from": START, "to": START + 60.0, "channel": "laser_readback_w"}
    stream = await web.viewer.get("/api/v1/cell/trends", params=params, headers={"Accept": "application/vnd.apache.arrow.stream"})
    arrow = pa.ipc.open_stream(stream.content).read_all().to_pydict()
    text = (await web.viewer.get("/api/v1/cell/trends", params=params, headers={"Accept": "text/csv"})).text
    csv = np.genfromtxt(io.StringIO(text), delimiter=",", names=True)
    assert arrow["laser_readback_w_mean"] == [1.25] * 49 + [None]
    np.testing.assert_array_equal(csv["laser_readback_w_mean"], [1.25] * 49 + [np.nan])
    np.testing.assert_allclose(csv["at"], arrow["at"])


async def test_marks_of_a_job_are_its_alarms_holds_and_layers_in_order(web: Web) -> None:
    told = [("job", "wall: started", "{}"), ("layer", "layer 1 of 2", '{"layer": 0}'), ("state", "HOLDING: x", "{}"), ("cnc", "a message", "{}"),
            ("alarm", "The door is open", '{"code": "door", "layer": 1}'), ("state", "RUNNING: y", "{}")]  # fmt: skip
    with web.service.store.write_cell() as rows:
        for k, (kind, text, data) in enumerate(told):
            rows.execute(insert(events).values(at=START + k, kind=kind, text=text, job="job-1", data=data))
        rows.execute(insert(events).values(at=START, kind="alarm", text="of another", job="job-2", data="{}"))
    found = (await web.viewer.get("/api/v1/cell/trends/marks", params={"job": "job-1", "layers": True})).json()
    assert [(mark["kind"], mark["code"], mark["layer"]) for mark in found["items"]] == [
        ("job", "", None), ("layer", "", 0), ("hold", "", None), ("alarm", "door", 1)
    ]  # fmt: skip
    between = (await web.viewer.get("/api/v1/cell/trends/marks", params={"from": START, "to": START + 3.0})).json()
    assert [mark["kind"] for mark in between["items"]] == ["job", "hold", "alarm"] and not between["more"]
