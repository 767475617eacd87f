"""The record of a job whose run has ended: sealed once, with its samples, plots, alarms, holds, lots and people; as files and over REST."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from sqlalchemy import insert

from cellctl.domain.jobs import JobState
from cellctl.record.course import bucketed
from cellctl.record.keeping import Keeping, sealed
from cellctl.record.seal import open_seal, verify
from cellctl.store import Store, consumables, jobs, parts
from cellctl.store.consumables import Kind
from cellctl.store.ids import new_id
from cellctl.store.jobs import JobRow
from cellctl.store.parts import Inspection, PartRow
from cellctl.store.schema import cell_runs, events, journal
from tests.unit.cellctl.conftest import Web
from tests.unit.cellctl.test_api_parts import assert_problem

BEGIN = 1_700_000_000.0
HOSTILE = "<script>alert(1)</script>"
SAMPLES = 400


def ran(store: Store) -> str:
    """A job with a run of 40 s behind it: two layers, a fault of 8 s in between, an override, 400 samples. Its id."""
    part = PartRow(
        new_id("part", BEGIN), "block", ".stl", "mm", "a" * 64, 684, BEGIN, "erin",
        Inspection("b" * 64, [[0.0, 0.0, 0.0], [12.0, 8.0, 2.0]], 12, 192.0, []),
    )  # fmt: skip
    job = JobRow(new_id("job", BEGIN), f"block {HOSTILE}", part.id, "trunnion-tcp", 'process = "hybrid"\n', "316L", BEGIN, "erin")
    ended = replace(job, state=JobState.COMPLETED, approved_by="otto", approve_because=HOSTILE, confirmed_by="otto")
    times = BEGIN + 0.1 * np.arange(SAMPLES)
    lit = (np.arange(SAMPLES) // 20) % 2 * 1.0
    rows = [
        {
            "at": float(at), "job": job.id, "state": "RUNNING", "executed_line": k, "layer": k // 200, "arc_mm": 1.2 * k,
            "laser_setpoint_w": 1200.0 * on, "laser_readback_w": 1195.0 * on, "powder_setpoint_g_min": 12.0, "powder_readback_g_min": 11.9,
            "tip_x": 0.0, "tip_y": 0.0, "tip_z": 0.0,
        }
        for k, (at, on) in enumerate(zip(times, lit, strict=True))
    ]  # fmt: skip
    told: list[tuple[float, str, str, dict[str, Any]]] = [
        (0.0, "state", "RUNNING: started", {"state": "RUNNING", "because": "started"}),
        (5.0, "command", "otto: override", {"verb": "override", "who": "otto", "client": "c", "because": "slower"}),
        (10.0, "state", f"FAULT: the door was opened {HOSTILE}", {"state": "FAULT", "because": "the door was opened"}),
        (10.0, "alarm", f"the door was opened {HOSTILE}", {"code": "door", "shown_remedy": "close it"}),
        (15.0, "reset", "otto resets: door", {"who": "otto", "codes": ["door"]}),
        (15.0, "state", "HELD: reset", {"state": "HELD", "because": "reset"}),
        (18.0, "state", "RUNNING: resumed", {"state": "RUNNING", "because": "resumed"}),
    ]
    with store.write() as connection:
        parts.add(connection, part)
        jobs.add(connection, ended)
    with store.write_cell() as connection:
        connection.execute(insert(journal), rows)
        connection.execute(insert(events), [
            {"at": BEGIN + at, "kind": kind, "text": text, "job": job.id, "data": json.dumps(data)} for at, kind, text, data in told
        ])  # fmt: skip
        connection.execute(insert(cell_runs).values(
            job=job.id, name="block", program="", program_sha256="c" * 64, started_at=BEGIN, ended_at=BEGIN + 40.0, outcome="completed",
            last_line=400, total_lines=400, who="otto", command_id="start-1",
        ))  # fmt: skip
    return job.id


def load_lots(store: Store, at: float) -> None:
    with store.write() as rows:
        consumables.load(rows, at, "otto", Kind.POWDER, "P-4711", "316L")
        consumables.load(rows, at, "otto", Kind.SHIELD_GAS, f"Ar {HOSTILE}")
        consumables.load(rows, at + 600.0, "otto", Kind.POWDER, "loaded later", "316L")


class Seen(HTMLParser):
    """Elements and attributes of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: set[tuple[str, str]] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes |= {(name, value or "") for name, value in attrs}


async def test_a_run_that_ended_leaves_one_sealed_record_with_everything_in_it(web: Web, tmp_path: Path) -> None:
    load_lots(web.service.store, BEGIN - 60.0)
    job = ran(web.service.store)
    for at, waiting in ((44.0, []), (46.0, [job])):  # what the cell says last is waited for
        assert Keeping(replace(web.service.store, clock=partial(float, BEGIN + at)), web.service.workers).waiting() == waiting
    await web.service.keeping.seal_all()
    await web.service.keeping.seal_all()

    seal = (await web.viewer.get(f"/api/v1/jobs/{job}/record/seal")).json()
    folder = tmp_path / "fetched"
    folder.mkdir()
    for file in seal["files"]:
        answer = await web.viewer.get(f"/api/v1/jobs/{job}/record/files/{file['name']}")
        assert answer.status_code == 200 and len(answer.content) == file["bytes"]
        (folder / file["name"]).write_bytes(answer.content)
    key = (await web.viewer.get("/api/v1/record-key")).json()
    assert key["fingerprint"] == seal["key"] == verify(folder, key["public_pem"].encode())["key"]
    with web.service.store.read() as rows:
        kept = sealed(web.service.store, rows, job)
    assert kept is not None and kept.name == seal["manifest_sha256"]

    check_samples(folder / "samples.parquet")
    answer = await web.viewer.get(f"/api/v1/jobs/{job}/record")
    assert answer.headers["X-Record-Sealed"] == "true" and answer.content == (folder / "record.json").read_bytes()
    check_document(answer.json())
    page = await web.viewer.get(f"/api/v1/jobs/{job}/record?format=html")
    assert page.text == (folder / "record.html").read_text() and "'none'" in page.headers["Content-Security-Policy"]
    check_page(page.text)


def check_samples(path: Path) -> None:
    """Read back by itself: every sample, with its unit."""
    table = pq.read_table(path)
    assert table.num_rows == SAMPLES and table.schema.field("laser_readback_w").metadata == {b"unit": b"W"}
    read = table.column("laser_readback_w").to_numpy()
    assert read.sum() == pytest.approx(1195.0 * SAMPLES / 2)
    assert np.all(np.diff(table.column("at").to_numpy()) > 0.0)


def check_document(record: dict[str, Any]) -> None:
    assert record["samples"] == SAMPLES and [row["samples"] for row in record["layers"]] == [200, 200]
    (hold,) = record["holds"]
    assert (hold["from_at"], hold["to_at"], hold["states"]) == (BEGIN + 10.0, BEGIN + 18.0, ["FAULT", "HELD"])
    (alarm,) = record["alarms"]
    assert (alarm["code"], alarm["remedy"], alarm["reset_by"], alarm["reset_at"]) == ("door", "close it", "otto", BEGIN + 15.0)
    assert [deed["who"] for deed in record["overrides"]] == ["otto"]
    assert {(lot["kind"], lot["lot"]) for lot in record["consumables"]} == {("powder", "P-4711"), ("shield_gas", f"Ar {HOSTILE}")}
    assert record["people"]["erin"] == ["submitted"] and "approved" in record["people"]["otto"]


def check_page(page: str) -> None:
    """No script, nothing from elsewhere, and a chart for each of what was sampled."""
    seen = Seen()
    seen.feed(page)
    assert not seen.tags & {"script", "link", "iframe", "object", "form"} and HOSTILE not in page and "alert(1)" in page
    assert not [value for name, value in seen.attributes if name in ("src", "href") and not value.startswith("data:")]
    assert len(re.findall(r'class="is"', page)) >= 4 and "P-4711" in page


async def test_before_its_end_a_record_is_what_is_known_now_and_not_sealed(web: Web) -> None:
    job = ran(web.service.store)
    answer = await web.viewer.get(f"/api/v1/jobs/{job}/record")
    assert answer.headers["X-Record-Sealed"] == "false" and answer.json()["samples"] == SAMPLES
    assert_problem(await web.viewer.get(f"/api/v1/jobs/{job}/record/seal"), 409)
    assert_problem(await web.viewer.get(f"/api/v1/jobs/{job}/record/files/record.json"), 409)
    assert_problem(await web.nobody.get("/api/v1/record-key"), 401)


async def test_a_key_that_others_may_read_seals_nothing_and_is_told_once(web: Web, capsys: pytest.CaptureFixture[str]) -> None:
    store = web.service.store
    open_seal(store.folder)
    key = store.folder / "record.key"
    key.chmod(0o644)
    job = ran(store)
    await web.service.keeping.seal_all()
    await web.service.keeping.seal_all()
    assert_problem(await web.viewer.get(f"/api/v1/jobs/{job}/record/seal"), 409)
    assert capsys.readouterr().out.count("others may read the key") == 1
    key.chmod(0o600)
    await web.service.keeping.seal_all()
    assert (await web.viewer.get(f"/api/v1/jobs/{job}/record/seal")).status_code == 200


async def test_lots_are_refused_without_their_material_and_those_of_today_are_told(web: Web) -> None:
    path = "/api/v1/cell/consumables"
    assert_problem(await web.operator.post(path, json={"kind": "powder", "lot": "1"}), 422)
    assert_problem(await web.operator.post(path, json={"kind": "powder", "lot": "1", "material": "unobtainium"}), 422)
    assert_problem(await web.operator.post(path, json={"kind": "carrier_gas", "lot": "1", "material": "316L"}), 422)
    assert_problem(await web.viewer.post(path, json={"kind": "powder", "lot": "1", "material": "316L"}), 403)
    lots = [
        {"kind": "powder", "lot": "P-4711", "material": "316L"},
        {"kind": "carrier_gas", "lot": "Ar 9"},
        {"kind": "powder", "lot": "P-4712", "material": "ti6al4v"},
    ]
    for body in lots:
        assert (await web.operator.post(path, json=body)).status_code == 201
    told = (await web.viewer.get(path)).json()
    assert {lot["kind"]: lot["lot"] for lot in told["loaded"]}["powder"] == "P-4712" and len(told["history"]) == 3


def test_buckets_hold_what_a_plain_loop_finds() -> None:
    rng = np.random.default_rng(5)
    at = np.sort(rng.uniform(0.0, 10.0, 500))
    values = np.where(rng.random(500) < 0.1, np.nan, rng.normal(size=500))
    edges = np.linspace(0.0, 12.0, 25)
    mean, least, greatest = bucketed(at, values, edges)
    for k in range(24):
        inside = values[(at >= edges[k]) & (at < edges[k + 1]) & np.isfinite(values)]
        if len(inside):
            np.testing.assert_allclose([mean[k], least[k], greatest[k]], [inside.mean(), inside.min(), inside.max()])
        else:
            assert np.isnan([mean[k], least[k], greatest[k]]).all()
