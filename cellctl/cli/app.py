"""All commands by name."""

from __future__ import annotations

import typer

from cellctl.cli import files, remote, service, tokens

app = typer.Typer(
    name="cellctl",
    help="Plans, runs and simulates a five-axis cell that deposits and mills metal parts in turn.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in (service.demo, service.serve, service.sim, service.doctor):
    app.command(rich_help_panel="Service")(command)
for command in (files.plan, files.show, files.post, files.prove):
    app.command(rich_help_panel="Files")(command)
for command in (remote.submit, remote.jobs, remote.watch, remote.approve, remote.cancel, remote.record):
    app.command(rich_help_panel="Jobs")(command)
for command in (remote.hold, remote.resume, remote.abort, remote.reset, remote.stop, remote.home):
    app.command(rich_help_panel="Cell")(command)
app.add_typer(tokens.app, name="token", rich_help_panel="Service")
