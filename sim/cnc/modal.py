"""Modal state of the G-code interpreter and the groups that its words belong to."""

from __future__ import annotations

from dataclasses import dataclass, field

# G-codes x 10 -> modal group (RS274NGC table 4; grblHAL gcode.c)
G_GROUP = {
    0: "motion", 10: "motion", 20: "motion", 30: "motion", 800: "motion",
    40: "once", 100: "once", 280: "once", 281: "once", 300: "once", 301: "once", 530: "once", 920: "once", 921: "once",
    170: "plane", 180: "plane", 190: "plane", 200: "units", 210: "units", 900: "distance", 910: "distance",
    911: "arc_distance", 930: "feed_mode", 940: "feed_mode", 400: "cutter", 431: "length", 490: "length", 610: "path",
    540: "system", 550: "system", 560: "system", 570: "system", 580: "system", 590: "system",
}  # fmt: skip
M_GROUP = {
    0: "stop", 1: "stop", 2: "stop", 30: "stop", 6: "change", 3: "spindle", 4: "spindle", 5: "spindle",
    7: "coolant", 8: "coolant", 9: "coolant", 62: "output", 63: "output", 64: "output", 65: "output",
    48: "override", 49: "override",
}  # fmt: skip
TAKES_AXIS_WORDS = frozenset({100, 280, 300, 920, 431})
PLANES = {170: (0, 1, "IJ"), 180: (2, 0, "KI"), 190: (1, 2, "JK")}
INCH_MM = 25.4
LINE_NUMBER_MAX = 10_000_000  # grbl: MAX_LINE_NUMBER
TOOL_MAX = 99
OUTPUTS = 8


@dataclass
class Modal:
    """What a line leaves set for the next one. A reset brings the defaults back; offsets and the tool in the spindle stay."""

    motion: int = 0
    plane: int = 170
    units: int = 210
    distance: int = 900
    feed_mode: int = 940
    system: int = 540
    length_offset_mm: float = 0.0
    feed_mm_min: float = 0.0
    rpm: float = 0.0
    spindle: int = 5
    flood: bool = False
    mist: bool = False
    tool_selected: int = 0

    def words(self, tool: int) -> str:
        """The `[GC:...]` report."""

        def g(code: int) -> str:
            return f"G{code // 10}" + (f".{code % 10}" if code % 10 else "")

        length = "G43.1" if self.length_offset_mm else "G49"
        coolant = " ".join(word for word, on in (("M7", self.mist), ("M8", self.flood)) if on) or "M9"
        codes = (self.motion, self.system, self.plane, self.units, self.distance, self.feed_mode)
        return f"[GC:{' '.join(g(code) for code in codes)} {length} M{self.spindle} {coolant} T{tool} F{self.feed_mm_min:g} S{self.rpm:g}]"


@dataclass
class Offsets:
    """Coordinate systems G54 to G59, G28, G30 and G92: machine coordinates or shifts, in the order of the axes."""

    count: int
    systems: dict[int, list[float]] = field(default_factory=dict)
    g28: list[float] = field(default_factory=list)
    g30: list[float] = field(default_factory=list)
    g92: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        for code in range(540, 600, 10):
            self.systems.setdefault(code, [0.0] * self.count)
        self.g28 = self.g28 or [0.0] * self.count
        self.g30 = self.g30 or [0.0] * self.count
        self.g92 = self.g92 or [0.0] * self.count
