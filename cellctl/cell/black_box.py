"""The black box: where the run was at the last tick, in a memory-mapped file that outlives the process.

What a killed process wrote to the mapping stays with the kernel. Two slots are written in turn, each with a counter and a checksum:
a record torn by a kill is told by its checksum, and the one before it counts. The file lies in memory where there is such a place: a page
of a file on a disk that the kernel is just writing out would keep the tick waiting. So power loss takes it; the journal remains then.
"""

from __future__ import annotations

import hashlib
import math
import mmap
import os
import stat
import struct
import zlib
from dataclasses import dataclass, field
from pathlib import Path

MEMORY = Path("/dev/shm")
SLOT_BYTES = 512
JOB_BYTES = 128
_COUNT = struct.Struct("<8sQ")
_BODY = struct.Struct(f"<{JOB_BYTES}sdd iddd iddd idd ii? dddd")
_SUM = struct.Struct("<I")
_MAGIC = b"cellbox1"
_SUM_AT = _COUNT.size + _BODY.size


@dataclass(frozen=True)
class Place:
    """A place on a Program. line : index; fraction : 0..1 of it; arc_mm : path length of the tip up to there."""

    line: int = -1
    fraction: float = 0.0
    arc_mm: float = 0.0

    @property
    def document(self) -> dict[str, float | int]:
        """As it is written down in events."""
        return {"line": self.line, "fraction": round(self.fraction, 6), "arc_mm": round(self.arc_mm, 4)}


@dataclass(frozen=True)
class Moment:
    """What a tick knew. job : "" without a run; unix_at, wire_at : s.

    place : where the tip is by prediction; lit : the last place with the laser permitted and the gate open
    dark : where metal ends if nobody beats from this tick on, by the laser's dead-man; the same as lit with no permit
    rate : program seconds per wire second; executed, sent : counts of lines
    """

    job: str = ""
    unix_at: float = 0.0
    wire_at: float = 0.0
    place: Place = field(default_factory=Place)
    time_s: float = 0.0
    lit: Place = field(default_factory=Place)
    rate: float = 0.0
    dark: Place = field(default_factory=Place)
    executed: int = 0
    sent: int = 0
    is_permitted: bool = False
    laser_w: float = 0.0
    powder_g_min: float = 0.0
    carrier_gas_l_min: float = 0.0
    shield_gas_l_min: float = 0.0

    @property
    def document(self) -> dict[str, object]:
        """Its places as they are written down when the run ends in order: the light went with the permit."""
        return {"place": self.place.document, "metal_end": self.lit.document, "known_by": "tick"}


def box_file(run_dir: Path) -> Path:
    """Where the box of the cell process of a run directory lies: in memory, else in the run directory itself."""
    inside = run_dir / "black_box"
    name = hashlib.sha256(os.fsencode(run_dir.resolve())).hexdigest()[:24]
    path = MEMORY / f"cell-{os.getuid()}-{name}.box"
    try:
        if not path.exists():
            os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600))
        found = path.lstat()
    except OSError:
        return inside
    is_ours = stat.S_ISREG(found.st_mode) and found.st_uid == os.getuid()
    return path if is_ours else inside


class BlackBox:
    """One file of two slots. `last` is what the process before left, None if nothing can be read. Raises OSError."""

    def __init__(self, path: Path) -> None:
        self.path = path
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            if os.fstat(handle).st_size != 2 * SLOT_BYTES:
                os.ftruncate(handle, 2 * SLOT_BYTES)
            self._map = mmap.mmap(handle, 2 * SLOT_BYTES)
        finally:
            os.close(handle)
        self._count, self.last = self._newest()
        self.moment = Moment()

    def write(self, moment: Moment) -> None:
        """Keep this moment, in the older slot. A job's name is cut after JOB_BYTES."""
        self.moment = moment
        count = self._count + 1
        start = (count % 2) * SLOT_BYTES
        place, lit, dark = moment.place, moment.lit, moment.dark
        record = _COUNT.pack(_MAGIC, count) + _BODY.pack(
            _name(moment.job), moment.unix_at, moment.wire_at,
            place.line, place.fraction, place.arc_mm, moment.time_s,
            lit.line, lit.fraction, lit.arc_mm, moment.rate,
            dark.line, dark.fraction, dark.arc_mm, moment.executed, moment.sent, moment.is_permitted,
            moment.laser_w, moment.powder_g_min, moment.carrier_gas_l_min, moment.shield_gas_l_min,
        )  # fmt: skip
        self._map[start : start + _SUM_AT + _SUM.size] = record + _SUM.pack(zlib.crc32(record))
        self._count = count

    @property
    def is_odd(self) -> bool:
        """Whether an odd number of moments has been written."""
        return self._count % 2 == 1

    def of_job(self, job: str) -> Moment | None:
        """What an earlier process left of this job, None if it left nothing of it."""
        return self.last if self.last is not None and _name(self.last.job) == _name(job) else None

    def close(self) -> None:
        """Give the mapping back. Harmless twice."""
        self._map.close()

    def remove(self) -> None:
        """Close, and take the file away: the run ended in order."""
        self.close()
        self.path.unlink(missing_ok=True)

    def _newest(self) -> tuple[int, Moment | None]:
        found = [self._read(slot) for slot in (0, 1)]
        return max(found, key=lambda one: one[0])

    def _read(self, slot: int) -> tuple[int, Moment | None]:
        record = self._map[slot * SLOT_BYTES : (slot + 1) * SLOT_BYTES]
        magic, count = _COUNT.unpack_from(record)
        if magic != _MAGIC or _SUM.unpack_from(record, _SUM_AT)[0] != zlib.crc32(record[:_SUM_AT]):
            return 0, None
        v = _BODY.unpack_from(record, _COUNT.size)
        if not all(math.isfinite(value) for value in v if isinstance(value, float)):
            return int(count), None
        moment = Moment(
            v[0].rstrip(b"\0").decode("utf-8", "replace"), v[1], v[2], Place(v[3], v[4], v[5]), v[6],
            Place(v[7], v[8], v[9]), v[10], Place(v[11], v[12], v[13]), v[14], v[15], v[16], v[17], v[18], v[19], v[20],
        )  # fmt: skip
        return int(count), moment


def _name(job: str) -> bytes:
    return job.encode("utf-8", "replace")[:JOB_BYTES]
