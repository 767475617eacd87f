"""The plug of the CNC's serial line: in or out, and under which name the port comes back."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Plug:
    """`name` is that of the port while the plug is in, empty for the cell file's; `pulls` tells how often it was out: a port of before is dead."""

    is_out: bool = False
    name: str = ""
    pulls: int = 0

    def pull(self) -> None:
        """Out; harmless twice."""
        if not self.is_out:
            self.is_out = True
            self.pulls += 1

    def put(self, name: str) -> None:
        """In, under this name (empty: the cell file's). A plug that is in under another one is taken out first."""
        if not self.is_out and name != self.name:
            self.pull()
        self.is_out, self.name = False, name
