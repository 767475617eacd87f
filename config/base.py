"""How a facts file is read: TOML in, a validated frozen model out, every fault as one line that names file, field, value and bound."""

from __future__ import annotations

import hashlib
import tomllib
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

FACTS_DIR = Path(__file__).parent

Vector3 = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, le=1)]


class ConfigError(Exception):
    """A facts file that cannot be used. `message` is one line: file, field, value, bound; `hint` says what to do."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


class Facts(BaseModel):
    """Base of all facts: unknown keys are errors, values cannot change after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @property
    def sha256(self) -> str:
        """Content hash (hex) of the validated facts; independent of the file's layout and comments."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()


F = TypeVar("F", bound=Facts)


def explain(error: ValidationError) -> str:
    """First fault of a validation error as `field: what (got value)`, followed by how many more there are."""
    faults = error.errors(include_url=False)
    first = faults[0]
    where = ".".join(str(part) for part in first["loc"]) or "file"
    if first["type"] == "extra_forbidden":
        what = "unknown key"
    elif first["type"] == "missing":
        what = "is missing"
    else:
        what = f"{first['msg']} (got {first['input']!r})"
    more = f"; and {len(faults) - 1} more" if len(faults) > 1 else ""
    return f"{where}: {what}{more}"


def parse_facts(model: type[F], text: str, source: str) -> F:
    """Validate TOML text.

    Raises ConfigError with one line: `<source>: <field>: <fault>`.
    """
    try:
        return model.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{source}: not TOML: {error}", "correct the line that is named") from None
    except ValidationError as error:
        raise ConfigError(f"{source}: {explain(error)}", "correct the field that is named; every field, its unit and bounds are in config/") from None


def read_facts(model: type[F], path: Path) -> F:
    """Read and validate one TOML file.

    Raises ConfigError when the file is absent, unreadable, not TOML or breaks a bound.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8 text"
        raise ConfigError(f"{path}: cannot be read: {reason}", "name an existing TOML file") from None
    return parse_facts(model, text, str(path))


PREFERRED: dict[tuple[str, str], Path] = {}


def prefer(kind: str, name: str, path: Path) -> None:
    """From here on, in this process, facts of this kind and name are those of the file: a shop's own version goes before the shipped one."""
    PREFERRED[kind, name] = path


def find_facts(kind: str, name: str) -> Path:
    """Path of a facts file by path (`./my.toml`) or by name, preferred before shipped (`kind` is cells, devices or materials).

    Raises ConfigError that lists the shipped names.
    """
    if (kind, name) in PREFERRED:
        return PREFERRED[kind, name]
    given = Path(name)
    if given.suffix == ".toml" and given.is_file():
        return given
    shipped = FACTS_DIR / kind / f"{name}.toml"
    if shipped.is_file():
        return shipped
    known = ", ".join(sorted(path.stem for path in (FACTS_DIR / kind).glob("*.toml")))
    raise ConfigError(f"{name}: no such file and no shipped one of {kind}", f"shipped: {known}")
