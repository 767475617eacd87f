"""What is done to layers that turn with the part, each in its own frame: deposited, faced, milled in ruled bands."""

from __future__ import annotations

from planner.toolpath.placed import in_build

__all__ = ["in_build"]
