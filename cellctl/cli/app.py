"""All commands by name."""

from __future__ import annotations

from collections.abc import Callable

import typer

from cellctl.cli import files, job_life, models, remote, service, tokens, users
from cellctl.cli.audit import audit
from cellctl.cli.backup import backup, restore
from cellctl.cli.doctor import doctor
from cellctl.cli.fleet import fleet
from cellctl.cli.going_on import go_on
from cellctl.cli.planning import planner_scheduler, planner_worker
from cellctl.cli.prove import prove
from cellctl.cli.record import record
from cellctl.cli.shop import mtconnect, opcua
from cellctl.cli.tutorial import tutorial

app = typer.Typer(
    name="cellctl",
    help="Plans, runs and simulates a five-axis cell that deposits and mills metal parts in turn.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
COMMANDS: dict[str, tuple[Callable[..., None], ...]] = {
    "Service": (tutorial, service.demo, service.serve, service.sim, doctor, audit, backup, restore),
    "Shop": (mtconnect, opcua),
    "Planning on other machines": (planner_scheduler, planner_worker),
    "Files": (files.plan, files.show, files.post, prove, models.model),
    "Jobs": (
        remote.submit, remote.jobs, remote.watch, remote.approve, remote.cancel, record, go_on, job_life.queue, job_life.table, job_life.rerun,
        job_life.retry, job_life.note,
    ),
    "Cell": (
        fleet, remote.hold, remote.resume, remote.abort, remote.reset, remote.stop, remote.home, remote.unlock, remote.confirm_position,
        remote.override, remote.jog, remote.control,
    ),
}
for panel, commands in COMMANDS.items():
    for command in commands:
        app.command(rich_help_panel=panel)(command)
app.add_typer(tokens.app, name="token", rich_help_panel="Service")
app.add_typer(users.app, name="user", rich_help_panel="Service")
