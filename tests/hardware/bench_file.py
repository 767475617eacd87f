"""The bench file: what stands at the far end of the tests of wires and cell, and what they may do there."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from config.base import ConfigError
from config.cell import Cell, load_cell

SHIPPED = Path(__file__).resolve().parents[1] / "bench.toml"
VARIABLE = "BENCH_FILE"
STATEMENT_CHARACTERS = 8  # shorter than this says nothing


class BenchFileError(Exception):
    """A bench file that cannot be used; the text is one line: what, where, what to do."""


class BenchFile(BaseModel):
    """Facts of a bench. Lengths mm, feeds mm/min, flows L/min, times s; the fields are explained in tests/bench.toml."""

    model_config = ConfigDict(extra="forbid", frozen=True, str_strip_whitespace=True)

    far_end: Literal["sim", "real"] = "sim"
    cell: str
    run_dir: str = ""
    emission_locked_out_by: str = ""
    may_write: bool = False
    may_move: bool = False
    distance_mm: float = Field(default=1.0, gt=0.0, le=20.0)
    feed_mm_min: float = Field(default=300.0, gt=0.0, le=6000.0)
    shield_gas_l_min: float = Field(default=0.0, ge=0.0, le=30.0)
    answer_s: float = Field(default=30.0, gt=0.0, le=600.0)

    @property
    def is_real(self) -> bool:
        """Whether hardware stands there."""
        return self.far_end == "real"


def load_bench(path: Path) -> tuple[BenchFile, Cell]:
    """A bench file and its cell, with `run_dir` and a cell file's name made absolute. Raises BenchFileError."""
    try:
        facts = BenchFile(**tomllib.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise BenchFileError(f"{path}: cannot be read: {error.strerror}; name a bench file in {VARIABLE}") from None
    except tomllib.TOMLDecodeError as error:
        raise BenchFileError(f"{path}: {error}; compare it with tests/bench.toml") from None
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise BenchFileError(f"{path}: {place}: {first['msg']}; tests/bench.toml tells what belongs there") from None
    beside = path.resolve().parent / facts.cell
    try:
        cell = load_cell(str(beside) if facts.cell.endswith(".toml") else facts.cell)
    except ConfigError as error:
        raise BenchFileError(f"{path}: cell: {error.message}; {error.hint}") from None
    _check(path, facts, cell)
    folder = (path.resolve().parent / Path(facts.run_dir).expanduser()).resolve()
    return facts.model_copy(update={"run_dir": str(folder)}), cell


def _check(path: Path, facts: BenchFile, cell: Cell) -> None:
    """Raises BenchFileError for a bench that must not be run."""
    if facts.is_real and cell.mode != "real":
        raise BenchFileError(f'{path}: far_end = "real", but cell {cell.name} has mode = "{cell.mode}"; name the cell file of the real cell')
    if not facts.is_real and cell.mode != "sim":
        raise BenchFileError(f'{path}: far_end = "sim", but cell {cell.name} has mode = "{cell.mode}"; name a cell file with mode = "sim"')
    if facts.is_real and len(facts.emission_locked_out_by) < STATEMENT_CHARACTERS:
        raise BenchFileError(
            f"{path}: emission_locked_out_by says nothing; switch the laser's key off or cap the fibre, and write down there what you did"
        )


def chosen_bench(environment: Mapping[str, str] = os.environ) -> tuple[BenchFile, Cell]:
    """The bench that the environment names, or the one that is shipped. Raises BenchFileError."""
    return load_bench(Path(environment.get(VARIABLE, "") or SHIPPED).expanduser())
