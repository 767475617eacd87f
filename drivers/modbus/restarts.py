"""A device that lost what it was told: started anew, or cut off and back; counted, so that none is missed however short it was."""

from __future__ import annotations


class Restarts:
    """How often a device came back with nothing of what it had been told. What shows it is told by `sign` or `cut_off`."""

    def __init__(self) -> None:
        self.count = 0
        self.why = ""  # of the last one
        self._sign = ""
        self._cut_off = ""

    def sign(self, text: str) -> None:
        """The device itself shows power-up values where it had held others."""
        self._sign = self._sign or text

    def cut_off(self, text: str) -> None:
        """It was lost, and is commanded safe when it is back."""
        self._cut_off = text

    @property
    def is_seen(self) -> bool:
        """Whether the device itself has shown it since it was last counted."""
        return bool(self._sign)

    def answered(self) -> bool:
        """It answers: whether that ends a restart or a loss, which is counted now."""
        why = self._sign or self._cut_off
        self._sign = self._cut_off = ""
        if not why:
            return False
        self.count += 1
        self.why = why
        return True
