"""Faults of processes, disk and supply, by wire: every one in every situation at random instants, the plant as witness.

    python -m tests.bench.bench_process_faults [--runs N] [--only WORD] [--situation WORD]
"""

from __future__ import annotations

import argparse
import contextlib
import random
import sqlite3
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import trimesh

from cellctl.client import ServiceError
from config.device import load_device
from tests.bench.process_scene import REST, TIME_SCALE, Outcome, Site, Witness, kill, small_disk, until
from tests.bench.table import Cell, Table

RUNS = 3
SITUATIONS = ("idle", "preparing", "depositing", "milling", "held", "accepting")
LOCKED_S = 7.0  # beyond the time that the cell process waits for a lock
DISK_MB = 24
SEEN_S = 0.05  # the plant is looked at every few milliseconds, more seldom on a busy machine
NOTICED_S = 0.3
BOUND_S = 0.03 + 0.1  # and one request of the link


@dataclass(frozen=True)
class Fault:
    """strike, mend : on a site; told : words of which the operator reads one; dark : what bounds light after the strike ("" : it may go on)"""

    name: str
    strike: Callable[[Site], None]
    mend: Callable[[Site], None]
    told: tuple[str, ...] = ()
    dark: str = ""
    needs_disk: bool = False


def _restarted(site: Site) -> None:
    """The supervisor does it: nothing is to be mended. What the dead process told last counts no more."""
    time.sleep(NOTICED_S)


def _kill_supervisor(site: Site) -> None:
    assert site.service is not None
    kill(site.service.pid)
    site.service.wait()


def _take_over(site: Site) -> None:
    site.start()


def _kill_all(site: Site) -> None:
    _kill_supervisor(site)
    kill(site.aimed["cellctl.cell"])
    kill(site.aimed["cellctl.api"])


def _lock(site: Site) -> None:
    db = sqlite3.connect(site.store / "store.db", timeout=5.0, isolation_level=None, check_same_thread=False)
    db.execute("BEGIN EXCLUSIVE")
    site.lock = db  # type: ignore[attr-defined]
    time.sleep(LOCKED_S)


def _unlock(site: Site) -> None:
    site.lock.rollback()  # type: ignore[attr-defined]
    site.lock.close()  # type: ignore[attr-defined]
    time.sleep(1.5)


def _fill(site: Site) -> None:
    with contextlib.suppress(OSError), (site.store / "filler").open("wb", buffering=0) as file:
        while file.write(bytes(4096)):
            pass
    with contextlib.suppress(ServiceError):  # something that has to be written down
        site.client.command("confirm_position", "the disk is full")
    time.sleep(2.0)


def _make_room(site: Site) -> None:
    (site.store / "filler").unlink()
    time.sleep(1.5)


def _power_off(site: Site) -> None:
    site.plant("fault", fault="power_off")
    time.sleep(3.0)


def _power_on(site: Site) -> None:
    site.plant("fault", fault="power_on")
    time.sleep(2.0)


STORE_WORDS = ("journal cannot be written", "journal")
FAULTS = (
    Fault("cell killed with -9", lambda site: kill(site.aimed["cellctl.cell"]), _restarted, ("cell process ended while a job ran",), "laser"),
    Fault("web killed with -9", lambda site: kill(site.aimed["cellctl.api"]), _restarted),
    Fault("supervisor killed with -9", _kill_supervisor, _take_over),
    Fault("supervisor, cell and web killed with -9", _kill_all, _take_over, ("cell process ended while a job ran",), "laser"),
    Fault("store locked for 7 s", _lock, _unlock, STORE_WORDS),
    Fault("disk full", _fill, _make_room, STORE_WORDS, needs_disk=True),
    Fault("machine powered off", _power_off, _power_on, ("whole machine fell silent", "not answer", "sends no status"), "supply"),
)


def _accept(site: Site, fault: Fault, dice: random.Random) -> None:
    """Strike while a command is on its way."""
    sender = threading.Thread(target=_ask, args=(site,))
    sender.start()
    time.sleep(dice.uniform(0.0, 0.03))
    fault.strike(site)
    sender.join()


def _ask(site: Site) -> None:
    """A hold under an id of this run: asked again, it has to be in the record once."""
    with contextlib.suppress(ServiceError):
        site.client.command("hold", "at the instant", id=f"hold-{site.jobs}")


def play(site: Site, fault: Fault, situation: str, seed: int) -> Outcome:
    """One run; the cell is IDLE before and behind it."""
    dice = random.Random(f"{fault.name}/{situation}/{seed}")
    found = Outcome(fault.name, situation)
    witness = Witness(site.run / "sim.sock")
    witness.start()
    job = ""
    try:
        job = site.bring("depositing" if situation == "accepting" else situation, dice)
        site.aim()
        struck = site.plant()["time_s"]
        if situation == "accepting":
            _accept(site, fault, dice)
        else:
            fault.strike(site)
        found.told = _told(site, fault)
        began = time.monotonic()
        fault.mend(site)
        until(lambda: site.state(), "an answer")
        found.back_s = time.monotonic() - began
        found.told = found.told or _told(site, fault)
        if situation == "accepting":
            _ask(site)
        refused = site.bring_back()
        if refused:
            found.wrong.append(refused)
        _judge(site, fault, found, witness, struck, job)
    except (TimeoutError, AssertionError, ServiceError, OSError) as error:
        found.wrong.append(f"{type(error).__name__}: {error}"[:200])
    finally:
        witness.is_over = True
        witness.join()
    return found


def _told(site: Site, fault: Fault) -> str:
    """What the operator reads now, of what was expected."""
    texts = [str(alarm.get("cause", "")) for alarm in site.snapshot().get("alarms", [])]
    with contextlib.suppress(sqlite3.Error):
        texts += [row[0] for row in site.rows("SELECT text FROM events WHERE kind IN ('alarm', 'offline', 'state') ORDER BY seq DESC LIMIT 6")]
    return next((text for text in texts for word in fault.told if word in text), "")


def _judge(site: Site, fault: Fault, found: Outcome, witness: Witness, struck: float, job: str) -> None:
    found.lit_s = witness.lit_after_s(struck) if fault.dark else 0.0
    found.standing_s = witness.standing_s()
    dead_man_s = load_device(site.cell.links["laser"].device).dead_man_s
    bound_s = {"laser": dead_man_s, "supply": 0.0, "": 0.0}[fault.dark] + BOUND_S + SEEN_S
    if fault.dark and found.lit_s > bound_s:
        found.wrong.append(f"light for {1e3 * found.lit_s:.0f} ms after the strike, bound {1e3 * bound_s:.0f}")
    if found.standing_s > bound_s:
        found.wrong.append(f"light at standstill for {1e3 * found.standing_s:.0f} ms, bound {1e3 * bound_s:.0f}")
    if job and fault.told and not found.told:
        found.wrong.append("the operator is not told")
    found.wrong += site.record_is_wrong(job)


def measure(runs: int, only: str = "", situation: str = "") -> list[Outcome]:
    """Every fault in every situation `runs` times; a service of its own for each fault."""
    found = []
    for fault in FAULTS:
        if only not in fault.name:
            continue
        with ExitStack() as stack:
            place = stack.enter_context(tempfile.TemporaryDirectory(prefix="faults-"))
            if fault.needs_disk and not stack.enter_context(small_disk(Path(place) / "store", DISK_MB)):
                found.append(Outcome(fault.name, "skipped: this user may not mount a small disk"))
                continue
            site = Site(Path(place))
            try:
                site.start()
                until(lambda site=site: site.state() in REST, "rest")  # type: ignore[misc]
                site.bring_back()
                for where in SITUATIONS:
                    for seed in range(runs if situation in where else 0):
                        found.append(play(site, fault, where, seed))
                        print(found[-1], file=sys.stderr, flush=True)
            finally:
                site.end()
    return found + planning(runs, only)


def planning(runs: int, only: str = "") -> list[Outcome]:
    """Faults while a part is uploaded and planned: the request fails with its reason, or is done once."""
    found: list[Outcome] = []
    if only and only not in "planner killed with -9 web killed with -9 supervisor":
        return found
    with tempfile.TemporaryDirectory(prefix="faults-") as place:
        site = Site(Path(place))
        try:
            site.start()
            part = Path(place) / "block.stl"
            trimesh.creation.icosphere(subdivisions=5, radius=6.0).export(part)
            for seed in range(runs):
                found += [_planner_killed(site, part, seed), _web_killed(site, part, seed)]
                print(*found[-2:], sep="\n", file=sys.stderr, flush=True)
        finally:
            site.end()
    return found


RECIPE = {"process": "deposit", "tolerance_mm": 0.5, "cusp_mm": 0.2}


def _planner_killed(site: Site, part: Path, seed: int) -> Outcome:
    found = Outcome("planner killed with -9", "planning")
    dice = random.Random(seed)
    part_id = str(site.client.upload(part)["id"])
    job = str(site.client.submit(part_id, recipe=RECIPE)["id"])
    worker = until(lambda: site.pid("cellctl.planning.worker"), "the planner")
    time.sleep(dice.uniform(0.0, 2.0))
    kill(worker)
    ended = until(lambda: (now := site.client.job(job))["state"] in ("failed", "waiting_for_approval") and now, "the job's end")
    if ended["state"] == "failed":
        found.told = f"{ended['error']['detail']}; {ended['error']['hint']}"
        again = site.client.submit(part_id, recipe=RECIPE)
        until(lambda: site.client.job(again["id"])["state"] in ("planning", "posting", "proving", "waiting_for_approval"), "planning again")
        site.client.cancel(str(again["id"]), "bench")
    return found


def _web_killed(site: Site, part: Path, seed: int) -> Outcome:
    """While an upload is on its way: asked again with the same key, there is one part; jobs that were in work are planned again."""
    found = Outcome("web killed with -9", "uploading, planning")
    dice = random.Random(seed)
    job = str(site.client.submit(str(site.client.upload(part)["id"]), recipe=RECIPE)["id"])
    before = len(site.rows("SELECT id FROM parts"))
    key = f"upload-{seed}"

    def upload() -> str:
        content = part.read_bytes()
        with contextlib.suppress(ServiceError):
            answer = site.client.request("POST", "/api/v1/parts", files={"file": ("x.stl", content)}, headers={"Idempotency-Key": key})
            return str(answer.json().get("id", "")) if answer.status_code == 201 else ""
        return ""

    first: list[str] = []
    sender = threading.Thread(target=lambda: first.append(upload()))
    sender.start()
    time.sleep(dice.uniform(0.0, 1.5))
    kill(site.pid("cellctl.api"))
    sender.join()
    began = time.monotonic()
    second = until(upload, "the upload again")
    found.back_s = time.monotonic() - began
    if first[0] and first[0] != second:
        found.wrong.append("the same key has made another part")
    if len(site.rows("SELECT id FROM parts")) != before + 1:
        found.wrong.append("parts lost or there twice")
    state = until(lambda: (now := str(site.client.job(job)["state"])) not in ("submitted",) and now, "the job's planning")
    found.told = f"job {state}"
    site.client.cancel(job, "bench")
    left = [entry.name for entry in (site.store / "blobs" / "staging").iterdir()]
    if len(left) > 1:
        found.wrong.append(f"left in staging: {left}")
    return found


def tables_of(outcomes: Sequence[Outcome], took_s: float) -> list[Table]:
    """The matrix, and a line for each run in which something was wrong."""
    rows: list[list[Cell]] = []
    for name in dict.fromkeys(one.fault for one in outcomes):
        mine = [one for one in outcomes if one.fault == name]
        per = Counter(one.situation for one in mine)
        told = Counter(one.told[:60] for one in mine if one.told).most_common(1)
        rows.append([
            name, len(mine), sum(bool(one.wrong) for one in mine), round(1e3 * max(one.lit_s for one in mine)),
            round(1e3 * max(one.standing_s for one in mine)), round(max(one.back_s for one in mine), 1),
            ", ".join(f"{where} {count}" for where, count in per.items()), told[0][0] if told else "-",
        ])  # fmt: skip
    note = (
        f"by wire, plant {TIME_SCALE:g} times as fast, times of the wires, {took_s:.0f} s. Where the cell process itself is dead, light ends by "
        "the laser's dead-man (and the CNC's gate at the end of what it has buffered); else within 30 ms and one request."
    )
    columns = ["fault", "runs", "wrong", "lit after ms", "lit at standstill ms", "back s", "situations", "told"]
    table = Table("Faults of processes, disk and supply", columns, rows, note)
    wrong: list[list[Cell]] = [[one.fault, one.situation, "; ".join(one.wrong)] for one in outcomes if one.wrong]
    return [table, *([Table("Faults of processes: what must not be", ["fault", "situation", "wrong"], wrong)] if wrong else [])]


def run() -> list[Table]:
    """Tables of `make bench`."""
    began = time.monotonic()
    outcomes = measure(RUNS)
    return tables_of(outcomes, time.monotonic() - began)


def main(words: Sequence[str]) -> int:
    """Of the command line; exit 1 if something was wrong."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--only", default="")
    parser.add_argument("--situation", default="")
    given = parser.parse_args(words)
    began = time.monotonic()
    outcomes = measure(given.runs, given.only, given.situation)
    for table in tables_of(outcomes, time.monotonic() - began):
        print(table.markdown())
    return 1 if any(one.wrong for one in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
