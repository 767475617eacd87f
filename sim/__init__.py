"""The far end of the wires: a whole cell in software, and the proof of a Program in it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim.dryrun import prove
    from sim.standing import Standing, stock_after

__all__ = ["Standing", "prove", "stock_after"]


def __getattr__(name: str) -> Any:
    """`prove` and `stock_after` are loaded when they are asked for: devices alone do without numba and matplotlib."""
    if name == "prove":
        from sim.dryrun import prove

        return prove
    if name in ("Standing", "stock_after"):
        from sim import standing

        return getattr(standing, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
