"""The command that shows how to begin: tutorial."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

TEXT = Path(__file__).parent.parent / "tutorial.md"
FOR_THE_TEST = re.compile(r"(?m)^<!--.*-->\n\n?|(?<=^```sh) .*$")


def tutorial_text() -> str:
    """The tutorial as Markdown, without the marks by which the test executes it."""
    return FOR_THE_TEST.sub("", TEXT.read_text(encoding="utf-8"))


def tutorial(plain: Annotated[bool, typer.Option("--plain", help="As the Markdown that it is written in.")] = False) -> None:
    """From a clone to a first simulated part, and to a dry run on a real machine."""
    if plain:
        typer.echo(tutorial_text())
        return
    from rich.console import Console
    from rich.markdown import Markdown

    Console().print(Markdown(tutorial_text()))
