"""What learns from the requests of one device: told of each when it is over."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol


class Watcher(Protocol):
    """Learns from what goes over the wire. began_at, ended_at : wire time of a request and of its answer (s)"""

    @property
    def is_waiting(self) -> bool:
        """Whether the next readings tell something: they are taken without a pause then."""

    def wrote(self, names: Sequence[str], began_at: float, ended_at: float) -> None:
        """These registers were written; the device has taken them."""

    def read(self, names: Sequence[str], began_at: float, ended_at: float) -> None:
        """These registers were read; the client holds their values."""
