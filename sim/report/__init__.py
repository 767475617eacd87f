"""The report of a proof: one HTML file to read, print and sign."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim.report.found import where
    from sim.report.page import html

__all__ = ["html", "where"]


def __getattr__(name: str) -> Any:
    """Loaded when asked for: charts and markup alone do without numba and matplotlib."""
    if name == "html":
        from sim.report.page import html

        return html
    if name == "where":
        from sim.report.found import where

        return where
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
