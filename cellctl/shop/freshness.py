"""What is known of the cell at this moment, and that nothing is known once it is silent."""

from __future__ import annotations

from dataclasses import dataclass

from cellctl.domain.snapshot import Snapshot

SILENT_S = 1.5  # a cell says something ten times a second; with a look every 0.1 s its silence is told within 2 s
READING_STALE_S = 1.5  # a device's reading above this age is not told


@dataclass
class Known:
    """The newest snapshot and when it came. cell : name; a snapshot of another cell is not taken

    `completed` : ids of the jobs that were completed; None while the service has not told them.
    """

    cell: str
    snapshot: Snapshot | None = None
    came_at: float = 0.0
    completed: set[str] | None = None
    other_cell: str = ""

    def take(self, snapshot: Snapshot, now: float) -> None:
        """A snapshot came at `now` (s, monotonic). The same one again, as after a reconnection, is no sign of life."""
        if snapshot.cell != self.cell:
            self.other_cell = snapshot.cell
            return
        self.other_cell = ""
        if self.snapshot is not None and snapshot.at > self.snapshot.at:
            self.came_at = now
        elif self.snapshot is None:
            self.came_at = now - SILENT_S  # of the first one nobody knows how long it lay; the second tells
        self.snapshot = snapshot

    def fresh(self, now: float) -> Snapshot | None:
        """The snapshot, None while the service or the cell is silent."""
        is_fresh = self.snapshot is not None and now - self.came_at < SILENT_S and not self.other_cell
        return self.snapshot if is_fresh else None


def is_read(connected: bool, age_s: float) -> bool:
    """Whether a device's readings may be told."""
    return connected and age_s <= READING_STALE_S
