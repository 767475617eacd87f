"""State of the simulated cell's objects as plain data, numbers and arrays, and back into objects of the same make: no code in it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from config.base import Facts
from sim.cnc import actions
from sim.cnc.answers import Build, StatusReport
from sim.cnc.chain import Chain
from sim.cnc.firmware import Firmware
from sim.cnc.interpreter import Interpreter
from sim.cnc.line import LineNoise, ReceiveRing, Transmitter
from sim.cnc.machine import Machine, Suspend
from sim.cnc.modal import Modal, Offsets
from sim.cnc.motion import Motion
from sim.faults import Faults
from sim.plant.feeder import Feeder
from sim.plant.io import InputsOutputs
from sim.plant.laser import Laser
from sim.world import World

OBJECTS = (World, Firmware, Interpreter, Machine, Motion, ReceiveRing, LineNoise, Transmitter, StatusReport, Laser, Feeder, InputsOutputs)
RECORDS: dict[str, Callable[..., Any]] = {
    cls.__name__: cls
    for cls in (
        actions.Move, actions.Dwell, actions.Spindle, actions.Coolant, actions.ToolChange, actions.Output, actions.Pause, actions.ProgramEnd,
        Modal, Offsets,
    )
}  # fmt: skip
ENUMS: dict[str, type[Enum]] = {Suspend.__name__: Suspend}
CONSTANT = (Facts, Build, Chain, Faults)  # made anew from the cell's facts
LEFT_OUT = {
    World: {"metal", "trace", "banks", "wires", "plants", "plug"},  # the metal has a state of its own; the others hold none between steps
    Motion: {"_out", "_row"},  # begins anew with each step
    Firmware: {"supply"},
}


class StateError(Exception):
    """State that cannot be written down or does not fit; the message is one line."""


def freeze(value: Any) -> Any:
    """Plain data of a value: None, bool, int, float, str, array, list, or a dict with one tag.

    Raises StateError for a type that is not known here: better no state than half of it.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, (bytes, bytearray)):
        return {"bytes": value.decode("latin-1")}
    if isinstance(value, Enum) and type(value).__name__ in ENUMS:
        return {"enum": [type(value).__name__, value.name]}
    if isinstance(value, (list, tuple, deque, frozenset)):
        items = [freeze(item) for item in (sorted(value) if isinstance(value, frozenset) else value)]
        return items if isinstance(value, list) else {type(value).__name__: items}
    if isinstance(value, dict):
        return {"dict": [[freeze(key), freeze(item)] for key, item in value.items()]}
    if is_dataclass(value) and type(value).__name__ in RECORDS:
        return {"record": [type(value).__name__, [freeze(getattr(value, field.name)) for field in fields(value)]]}
    if isinstance(value, OBJECTS):
        return {"object": {name: freeze(item) for name, item in _own(value).items()}}
    raise StateError(f"{type(value).__name__} has no written state")


def thaw(plain: Any, now: Any = None) -> Any:
    """The value again. An object is brought to its state in place: `now` is that of the same make.

    Raises StateError when the data do not fit.
    """
    if isinstance(plain, np.ndarray):
        return plain.copy()
    if isinstance(plain, list):
        return [thaw(item) for item in plain]
    if not isinstance(plain, dict):
        return plain
    if len(plain) != 1:
        raise StateError("a value with more than one tag")
    tag, content = next(iter(plain.items()))
    if tag == "object":
        return _into(now, content)
    builders: dict[str, Callable[[Any], Any]] = {
        "bytes": lambda text: bytearray(text.encode("latin-1")),
        "enum": lambda names: ENUMS[names[0]][names[1]],
        "tuple": lambda items: tuple(thaw(item) for item in items),
        "deque": lambda items: deque(thaw(item) for item in items),
        "frozenset": lambda items: frozenset(thaw(item) for item in items),
        "dict": lambda pairs: {thaw(key): thaw(item) for key, item in pairs},
        "record": lambda parts: RECORDS[parts[0]](*(thaw(item) for item in parts[1])),
    }
    if tag not in builders:
        raise StateError(f"no value is tagged {tag!r}")
    return builders[tag](content)


def _own(value: Any) -> dict[str, Any]:
    """Attributes that are state."""
    left_out = LEFT_OUT.get(type(value), set())
    return {
        name: item
        for name, item in vars(value).items()
        if name not in left_out and not isinstance(item, CONSTANT) and not callable(item)
    }


def _into(now: Any, content: dict[str, Any]) -> Any:
    own = _own(now) if isinstance(now, OBJECTS) else {}
    if set(own) != set(content):
        raise StateError(f"state of another make than {type(now).__name__}")
    for name, item in content.items():
        value = thaw(item, own[name])
        if isinstance(own[name], np.ndarray) and getattr(value, "shape", None) != own[name].shape:
            raise StateError(f"{type(now).__name__}.{name} has another shape")
        setattr(now, name, value)
    return now
