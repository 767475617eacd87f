"""The control token: one console or client commands the cell, others watch; taking it over is explicit and recorded."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cellctl.cell.refusal import CONTROL, Refused
from cellctl.domain.messages import Command
from cellctl.domain.snapshot import Control
from config.by_hand import ByHand
from drivers.interfaces import Clock

FREE = frozenset({"stop", "record", "acknowledge", "take_control", "release_control", "present", "pages"})
"""Verbs that need no control. A stop is always possible (invariant 2)."""
Tell = Callable[[str, str, dict[str, Any]], None]


class ControlToken:
    """Who has control. tell : writes an event down (kind, text, data); found : data of the last such event of an earlier process"""

    def __init__(self, facts: ByHand, unix: Callable[[], float], tell: Tell, found: dict[str, Any] | None, wire: Clock) -> None:
        self._facts = facts
        self._unix = unix
        self._wire = wire
        self._tell = tell
        self.on_taken: Callable[[str], None] = lambda because: None
        self._holder, self._client, self._since = "", "", 0.0
        self._seen_at, self._heard_at = 0.0, wire.now()  # by the clock of day to be told, by the monotonic one to be measured
        if found and found.get("client"):
            self._holder, self._client = str(found["holder"]), str(found["client"])
            self._since = self._seen_at = float(found["since"])

    @property
    def view(self) -> Control | None:
        """For the snapshot; None while nobody has control."""
        if not self._client:
            return None
        return Control(self._holder, self._client, self._since, self._seen_at, self._silent_s > self._facts.control_absent_s)

    @property
    def _silent_s(self) -> float:
        return self._wire.now() - self._heard_at

    def _hear(self) -> None:
        self._seen_at, self._heard_at = self._unix(), self._wire.now()

    @property
    def name(self) -> str:
        """The holder in words."""
        where = self._client.removeprefix(f"{self._holder}/")
        return f"{self._holder} ({where})" if where != self._holder else self._holder

    def admit(self, command: Command) -> None:
        """Let a command of the holder pass, take control for the first one while nobody has it. Raises Refused."""
        client = client_of(command)
        if client == self._client:
            self._hear()
        elif command.verb not in FREE:
            if self._client:
                raise Refused(f"{command.verb}: {self._told()}", "take control over first, with a reason", CONTROL)
            self._give(command, f"{command.who} takes control, which nobody had")

    def take(self, command: Command) -> bool:
        """Give control to the sender; whether it was somebody else's. Raises Refused without a reason to take it over."""
        client = client_of(command)
        if client == self._client:
            return False
        if not self._client:
            self._give(command, f"{command.who} takes control")
            return False
        if not command.because.strip():
            raise Refused(f"take_control: {self._told()}; taking it over needs a reason", "say why", CONTROL)
        before = self.name
        self._give(command, f"{command.who} takes control over from {before}, because {command.because}", before)
        self.on_taken(f"control went to {self.name}")
        return True

    def release(self, command: Command) -> None:
        """Give control back; harmless for who has none. Raises Refused for another's."""
        if not self._client:
            return
        if client_of(command) != self._client:
            raise Refused(f"release_control: {self._told()}", "only who has control can give it back", CONTROL)
        self._tell("control", f"{self.name} gives control back", {"holder": "", "client": "", "since": self._unix()})
        self._holder = self._client = ""

    def _give(self, command: Command, text: str, before: str = "") -> None:
        now = self._unix()
        self._holder, self._client, self._since = command.who, client_of(command), now
        self._hear()
        data = {"holder": self._holder, "client": self._client, "since": now, "before": before, "because": command.because}
        self._tell("control", text, data)

    def _told(self) -> str:
        silent = f", not heard for {self._silent_s:.0f} s" if self._silent_s > self._facts.control_absent_s else ""
        return f"{self.name} has control{silent}"


def client_of(command: Command) -> str:
    """Which client sends a command; a person who does not tell one is one."""
    return command.client or command.who
