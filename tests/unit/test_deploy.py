"""What stands in config/deploy fits the software that it deploys: options, files, names of figures."""

from __future__ import annotations

import configparser
import json
import re
import shlex
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

import click
import pytest
import typer.main

from cellctl.api.context import Service, Settings
from cellctl.cli.app import app
from cellctl.domain.snapshot import Alarm, IoView, JobView, Snapshot
from cellctl.store import Store
from config import find_facts
from tests.unit.cellctl.conftest import empty_store as empty_store
from tests.unit.cellctl.conftest import store as store

ROOT = Path(__file__).resolve().parents[2]
DEPLOY = ROOT / "config" / "deploy"
FIGURE = re.compile(r"\bcellctl_[a-z0-9_]+")
RULE = re.compile(r'([A-Z_]+)(\{[^}]+\})?(==|!=|=|\+=|:=)"[^"]*"')


def parsed(words: list[str]) -> click.Context:
    """The command line as `cellctl` reads it, carried out no further. Raises click.UsageError for an option that it does not have."""
    group = typer.main.get_command(app)
    assert isinstance(group, click.Group) or hasattr(group, "commands")
    name, *rest = words
    command = group.commands[name]  # type: ignore[attr-defined]
    return command.make_context(name, rest)


def unit(path: Path) -> configparser.ConfigParser:
    read = configparser.ConfigParser(strict=False, interpolation=None, delimiters=("=",))
    read.optionxform = str  # type: ignore[assignment,method-assign]
    read.read(path)
    return read


def test_the_unit_starts_the_service_with_options_that_it_has() -> None:
    program, *words = shlex.split(unit(DEPLOY / "hybridcell.service")["Service"]["ExecStart"])
    context = parsed(words)
    assert program.endswith("/cellctl") and context.params["cell"] == "/etc/hybridcell/cell.toml"
    assert context.params["store"] == "/var/lib/hybridcell/store"


def test_the_unit_of_a_planning_machine_joins_a_pool_by_tls() -> None:
    service = unit(DEPLOY / "hybridcell-planner.service")["Service"]
    program, *words = shlex.split(service["ExecStart"])
    context = parsed(words)
    assert program.endswith("/cellctl") and context.params["scheduler"].startswith("tls://") and not context.params["plain"]
    assert context.params["cert"] and context.params["key"] and str(context.params["folder"]).endswith(service["StateDirectory"])


def test_the_backup_unit_takes_a_backup_of_the_store_that_is_served() -> None:
    backup = unit(DEPLOY / "hybridcell-backup.service")["Service"]["ExecStart"]
    inner = shlex.split(shlex.split(backup)[2].replace("exec ", "").replace("%%", "%"))
    context = parsed(inner[1:])
    served = parsed(shlex.split(unit(DEPLOY / "hybridcell.service")["Service"]["ExecStart"])[1:])
    assert context.params["store"] == served.params["store"]
    assert unit(DEPLOY / "hybridcell-backup.timer")["Timer"]["OnCalendar"]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
@pytest.mark.parametrize("name", ["hybridcell.service", "hybridcell-backup.service", "hybridcell-backup.timer", "hybridcell-planner.service"])
def test_systemd_takes_the_unit(name: str, tmp_path: Path) -> None:
    """Verified by systemd itself, with a program that exists in place of the installed one."""
    for path in DEPLOY.glob("hybridcell*.[st]*"):
        (tmp_path / path.name).write_text(path.read_text().replace("/opt/hybridcell/.venv/bin/cellctl", "/bin/true"))
    done = subprocess.run(["systemd-analyze", "verify", "--man=no", str(tmp_path / name)], capture_output=True, text=True, check=False)
    said = [line for line in (done.stdout + done.stderr).splitlines() if "hybridcell" in line]
    assert not said


def test_every_rule_of_udev_is_one_and_jumps_to_a_label() -> None:
    lines = [line for line in (DEPLOY / "60-hybridcell.rules").read_text().splitlines() if line and not line.startswith("#")]
    assert lines
    for line in lines:
        assert not RULE.sub("", line).replace(",", "").strip(), line
    labels = set(re.findall(r'LABEL="(\w+)"', "\n".join(lines)))
    assert set(re.findall(r'GOTO="(\w+)"', "\n".join(lines))) <= labels


def test_the_container_is_made_from_files_that_are_there_and_runs_options_that_exist() -> None:
    text = (DEPLOY / "Containerfile").read_text()
    for words in re.findall(r"^COPY (?!--from)(.+)$", text, re.MULTILINE):
        *sources, _target = words.split()
        assert all((ROOT / source).exists() for source in sources), words
    for lock in re.findall(r"--require-hashes -r (\S+)", text):
        assert "--hash=sha256:" in (ROOT / lock).read_text()
    command = re.search(r"^CMD (\[.+\])$", text, re.MULTILINE)
    assert command is not None and parsed(json.loads(command[1])).params["run"] == "/run/hybridcell"


def alarmed() -> Snapshot:
    """A cell with everything that a figure is made of."""
    job = JobView("job-1", "block", progress=0.25, remaining_s=90.0)
    io = IoView(estop_ok=True, door_closed=False)
    return Snapshot(1, time.time(), "c", "sim", "FAULT", "", tip_speed_mm_s=12.0, io=io, job=job, alarms=[Alarm(1, 0.0, "door", "", "")])


@pytest.fixture
def service(tmp_path: Path, store: Store) -> Service:
    from cellctl.api.app import build_service

    (tmp_path / "run").mkdir()
    return build_service(Settings(store.folder, tmp_path / "run", find_facts("cells", "trunnion_tcp")))


def told(service: Service, snapshot: Snapshot | None, monkeypatch: pytest.MonkeyPatch) -> dict[str, float]:
    """Figures as Prometheus reads them: name with labels -> value."""
    monkeypatch.setattr(type(service.link), "fresh", property(lambda _link: snapshot))
    lines = service.metrics.collect(service).decode().splitlines()
    return {line.rpartition(" ")[0]: float(line.rpartition(" ")[2]) for line in lines if not line.startswith("#")}


def test_board_and_alerts_name_figures_that_the_service_tells(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    service.metrics.requests.labels("GET", "/", "200").inc()
    service.metrics.seconds.labels("/").observe(0.1)
    figures = told(service, alarmed(), monkeypatch)
    names = {name.partition("{")[0] for name in figures} | {"cellctl_jobs"}
    board: dict[str, Any] = json.loads((DEPLOY / "grafana_board.json").read_text())
    wanted = {name for panel in board["panels"] for target in panel["targets"] for name in FIGURE.findall(target["expr"])}
    wanted |= set(FIGURE.findall((DEPLOY / "hybridcell_alerts.yml").read_text()))
    assert len(wanted) >= 15 and wanted <= names
    assert figures['cellctl_interlock_safe{interlock="door_closed"}'] == 0.0 and figures['cellctl_interlock_safe{interlock="estop_ok"}'] == 1.0
    assert figures["cellctl_active_alarms"] == 1.0 and figures["cellctl_tip_speed_metres_per_second"] == pytest.approx(0.012)


def test_a_cell_that_went_silent_leaves_no_figures_of_before(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    told(service, alarmed(), monkeypatch)
    figures = told(service, None, monkeypatch)
    assert figures["cellctl_cell_up"] == 0.0 and figures["cellctl_job_progress_ratio"] != figures["cellctl_job_progress_ratio"]
    assert not [name for name in figures if name.startswith(("cellctl_interlock_safe", "cellctl_laser_watts"))]
