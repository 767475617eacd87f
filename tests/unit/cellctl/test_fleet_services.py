"""Three services, one store: jobs for any and for a named cell are made side by side; one dies in the middle and comes back."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest

from cellctl.domain.fleet import DEAD_S
from cellctl.store import Store, open_store, tokens, upgrade
from cellctl.store.fleet import LeaseHeldError
from cellctl.store.shared import Wanted, share
from cellctl.store.tokens import Role
from tests.unit.cellctl.fleet_site import RECIPE, Site, all_answer, grow_silent, make_before
from tests.unit.cellctl.test_store import part_in

CELLS = ("alpha", "beta", "gamma")
JOB = {"recipe": RECIPE}


@pytest.fixture(params=["one file", "postgres"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Store]:
    """Alpha's: with a database and files that all hosts see, or, of cells at one host, the file that all of them open."""
    for name in CELLS if request.param == "postgres" else ():
        (tmp_path / "shared.url").write_text(request.getfixturevalue("database").render_as_string(hide_password=False))
        share(tmp_path / f"{name}-store", Wanted(f"@{tmp_path / 'shared.url'}", tmp_path / "files"))
        upgrade(tmp_path / f"{name}-store")
    folder = tmp_path / ("alpha-store" if request.param == "postgres" else "store")
    upgrade(folder)
    opened = open_store(folder)
    yield opened
    opened.close()


@pytest.fixture
async def sites(tmp_path: Path, store: Store) -> AsyncIterator[dict[str, Site]]:
    with store.write() as rows:
        token = tokens.create(rows, "the admin", Role.ADMIN, store.clock())[1]
    folders = {name: tmp_path / f"{name}-store" if store.is_shared else store.folder for name in CELLS}
    found = {name: Site(name, folders[name], tmp_path / name, token) for name in CELLS}
    part = part_in(store)
    make_before(store, part, [site.make_cell() for site in found.values()])
    for site in found.values():
        await site.power_up()
        await site.serve()
    await all_answer(store, CELLS)
    JOB["part_id"] = part  # type: ignore[assignment]
    yield found
    for site in found.values():
        await site.kill()
        assert site.far is not None
        await site.far.close()


async def test_jobs_of_a_service_that_died_are_made_elsewhere_and_its_running_one_goes_on_when_it_is_back(
    sites: dict[str, Site], store: Store
) -> None:
    alpha, beta = sites["alpha"], sites["beta"]
    named = (await alpha.post("/jobs", {**JOB, "cell": "beta"}, 201))["id"]
    await alpha.until(named, lambda job: job["state"] == "waiting_for_approval")
    await beta.post(f"/jobs/{named}/approve", {"table_clear": True})
    running = await alpha.until(named, lambda job: job["state"] == "running")
    assert (running["cell"], running["cell_wanted"]) == ("beta", "beta") and beta.far is not None and beta.far.job == named

    waiting = (await alpha.post("/jobs", {**JOB, "cell": "beta"}, 201))["id"]
    anywhere = [(await alpha.post("/jobs", {**JOB, "cell": "any"}, 201)) for _ in range(6)]
    assert {job["cell_wanted"] for job in anywhere} == {"any"}
    shown = [await alpha.until(job["id"], lambda job: job["state"] == "waiting_for_approval") for job in anywhere]
    assert {job["cell"] for job in shown} == set(CELLS)  # all have their share
    at_beta = [job["id"] for job in shown if job["cell"] == "beta"]
    assert {job["id"] for job in (await alpha.get("/jobs?cell=beta"))["items"]} == {named, waiting, *at_beta}

    await beta.kill()
    grow_silent(store, "beta", DEAD_S)
    for job in at_beta:
        moved = await alpha.until(job, lambda job: job["cell"] not in ("", "beta") and job["state"] == "waiting_for_approval")
        assert moved["approved_by"] == ""
    stays = await alpha.until(named, lambda job: "not been heard" in job["why"])
    assert stays["state"] == "running" and stays["cell"] == "beta" and stays["why"].endswith("its part lies on that table")
    assert (await alpha.get(f"/jobs/{waiting}"))["why"].endswith("it was meant for that cell")

    for job in anywhere:
        at = sites[(await alpha.get(f"/jobs/{job['id']}"))["cell"]]
        await at.post(f"/jobs/{job['id']}/approve", {"table_clear": True})
        await at.until(job["id"], lambda job: job["state"] == "running")
        assert at.far is not None and at.far.job == job["id"]
        at.far.end("completed")
        await at.until(job["id"], lambda job: job["state"] == "completed")
    made = [job for site in sites.values() if site.far is not None for job, *_ in site.far.started]
    assert sorted(made) == sorted([named, *(job["id"] for job in anywhere)])  # each once, whatever died

    beta.far.end("interrupted")  # while its service is not there
    await beta.serve()
    back = await alpha.until(named, lambda job: job["state"] == "interrupted" and "heard" not in job["why"])
    assert back["cell"] == "beta" and back["why"] == "ended at line 10 of 10"
    await beta.until(waiting, lambda job: job["state"] == "waiting_for_approval")


async def test_a_second_service_of_a_cell_is_refused_in_one_line(sites: dict[str, Site], tmp_path: Path, store: Store) -> None:
    alpha = sites["alpha"]
    assert alpha.service is not None
    (store.folder / "owner").write_text("another host's\n")  # as a store folder of its own has it
    with pytest.raises(LeaseHeldError) as refused:
        await Site("alpha", store.folder, alpha.run, alpha.token).serve()
    assert refused.value.message.startswith("the cell alpha is run by another service, at ") and "\n" not in refused.value.message


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"cell": "delta"}, "cell: there is no cell 'delta'"),
        ({"cell": "beta", "recipe": {**RECIPE, "laser_w": 5000.0}}, "laser_w: the recipe asks at least 5000 W, beta gives at most 2000 W"),
        ({"cell": "any", "recipe": {"process": "mill", "cutter_diameter_mm": 7.0}}, "cutter_diameter_mm: asked 7 mm, alpha has no end mill"),
    ],
)
async def test_a_job_that_cannot_be_made_where_it_is_asked_for_is_refused_at_once(
    sites: dict[str, Site], asked: dict[str, object], told: str
) -> None:
    problem = await sites["gamma"].post("/jobs", {**JOB, **asked}, 422)
    assert told in problem["detail"] and "\n" not in problem["detail"]
