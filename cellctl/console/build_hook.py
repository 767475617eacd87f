"""Hatch build hook: a wheel holds the built operator's page; an editable install leaves that to `make console`."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class ConsoleBuildHook(BuildHookInterface[Any]):
    """Runs cellctl/console/build.py by its path, because the project is not importable while it is being built."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the page for a standard wheel; `version` is "standard" or "editable"."""
        if version == "editable":
            return
        builder = runpy.run_path(str(Path(self.root) / "cellctl" / "console" / "build.py"))
        self.app.display_info(builder["build"]())
