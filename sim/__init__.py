"""The far end of the wires: a whole cell in software, and the proof of a Program in it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim.dryrun import prove

__all__ = ["prove"]


def __getattr__(name: str) -> Any:
    """`prove` is loaded when it is asked for: devices alone do without numba and matplotlib."""
    if name == "prove":
        from sim.dryrun import prove

        return prove
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
