"""Changes of people's rows in the store itself, each with its row in the audit trail: who may write the folder may make them."""

from __future__ import annotations

import getpass
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from cellctl.cli.input import InputFault

if TYPE_CHECKING:
    from sqlalchemy import Connection

Row = TypeVar("Row")


def change(
    store: Path, verb: str, how: Callable[[Connection, float], Row], target: Callable[[Row], str], listed_by: str, outcome: str = "ok"
) -> Row:
    """What `how` gives, written down with it in one transaction. target : of the deed; listed_by : the command that lists such rows

    Raises InputFault for what is not there.
    """
    from cellctl.store import audit, open_store
    from cellctl.store.parts import NotFoundError

    opened = open_store(store)
    try:
        with opened.write() as rows:
            row = how(rows, opened.clock())
            deed = audit.Deed(f"command line ({getpass.getuser()})", "admin", "local", verb, target(row), "")
            audit.add(rows, deed, opened.clock(), outcome)
    except NotFoundError as error:
        raise InputFault(str(error), f"`cellctl {listed_by} list` lists them") from None
    finally:
        opened.close()
    return row
