"""Status reports `<Run|MPos:...|...>` read into Status; what a report leaves out is kept from earlier ones."""

from __future__ import annotations

from drivers.cnc.events import Status

PAUSING = frozenset({"Hold", "Door", "Tool"})  # states in which no `ok` comes (M0 shows as Hold)
MOVING = frozenset({"Run", "Jog", "Home"})


class MalformedReport(ValueError):
    """The text between < and > is no status report."""


class StatusReader:
    """Reads reports for axes named `letters`; remembers offsets, overrides and tool, which come only now and then.

    WPos = MPos - WCO. Source: grbl 1.1 documentation, "Real-time Status Reports"; grblHAL adds `T:` and more axes.
    """

    def __init__(self, letters: tuple[str, ...]) -> None:
        self.letters = letters
        self.axes_reported = 0
        self.saw_line = False
        self.forget()

    def forget(self) -> None:
        """Drop what is remembered (the controller has reset)."""
        self._wco: dict[str, float] = {}
        self._overrides = (100, 100, 100)
        self._tool: int | None = None

    def read(self, text: str, now: float) -> Status:
        """One report, `<` and `>` included. Raises MalformedReport."""
        if len(text) < 3 or text[0] != "<" or text[-1] != ">":
            raise MalformedReport(text)
        state, _, rest = text[1:-1].partition("|")
        name, _, sub = state.partition(":")
        if not name.isalpha() or (sub and not sub.isdigit()):
            raise MalformedReport(text)
        fields = dict(part.partition(":")[::2] for part in rest.split("|")) if rest else {}
        try:
            return self._status(name, int(sub) if sub else None, fields, now)
        except (ValueError, IndexError):
            raise MalformedReport(text) from None

    def _status(self, name: str, sub: int | None, fields: dict[str, str], now: float) -> Status:
        if "WCO" in fields:
            self._wco = self._vector(fields["WCO"])
        if "Ov" in fields:
            feed, rapid, spindle = (int(value) for value in fields["Ov"].split(","))
            self._overrides = (feed, rapid, spindle)
        if "T" in fields:
            self._tool = int(fields["T"])
        machine, work = self._positions(fields)
        planner_free, rx_free = (int(value) for value in fields["Bf"].split(",")) if "Bf" in fields else (None, None)
        speeds = [float(value) for value in (fields.get("FS") or fields.get("F") or "0").split(",")]
        line = int(fields["Ln"]) if "Ln" in fields else None
        self.saw_line = self.saw_line or line is not None
        rpm = speeds[1] if len(speeds) > 1 else 0.0
        return Status(
            state=name, substate=sub, machine=machine, work=work, wco=dict(self._wco), line=line,
            feed_mm_min=speeds[0], rpm=rpm, planner_free=planner_free, rx_free=rx_free, tool=self._tool,
            pins=_pins(fields.get("Pn", "")), overrides=self._overrides, at=now,
            has_rpm=len(speeds) > 1,
        )  # fmt: skip

    def _positions(self, fields: dict[str, str]) -> tuple[dict[str, float], dict[str, float]]:
        if "MPos" in fields:
            machine = self._vector(fields["MPos"])
            return machine, {a: machine[a] - self._wco[a] for a in machine} if self._wco else {}
        if "WPos" in fields:
            work = self._vector(fields["WPos"])
            return {a: work[a] + self._wco[a] for a in work} if self._wco else {}, work
        return {}, {}

    def _vector(self, text: str) -> dict[str, float]:
        values = [float(value) for value in text.split(",")]
        self.axes_reported = len(values)
        if len(values) != len(self.letters):
            return dict(zip(self.letters, values, strict=False))
        return dict(zip(self.letters, values, strict=True))


def _pins(text: str) -> str:
    """Letters of the inputs that are active. Raises ValueError for anything else: no firmware reports it."""
    if text and not (text.isascii() and text.isalpha() and text.isupper()):
        raise ValueError(text)
    return text
