"""What processes hold while a soak goes on: memory, descriptors, sockets, threads, and the store's log; as samples, slopes and a picture."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

WARM_UP_SHARE = 0.3  # of the soak: what is loaded, cached and opened once
MB = 2.0**20
COLUMNS = ("memory", "descriptors", "sockets", "threads")


@dataclass(frozen=True)
class Held:
    """One look at one process. memory : MB that no file stands behind (RssAnon)"""

    memory: float
    descriptors: int
    sockets: int
    threads: int

    @classmethod
    def of(cls, pid: int) -> Held:
        """As /proc tells. Raises OSError for a process that is gone."""
        folder = Path(f"/proc/{pid}")
        words = dict(line.split(":", 1) for line in (folder / "status").read_text().splitlines() if ":" in line)
        links = []
        for entry in (folder / "fd").iterdir():
            try:
                links.append(os.readlink(entry))
            except OSError:
                continue  # closed while it was looked at
        memory = int(words["RssAnon"].split()[0]) * 1024 / MB
        return cls(memory, len(links), sum(link.startswith("socket:") for link in links), int(words["Threads"]))


class Watch:
    """Samples of some processes over simulated hours. pids : by name; log : the store's write-ahead log"""

    def __init__(self, pids: Mapping[str, int], log: Path) -> None:
        self._pids, self._log = dict(pids), log
        self.hours: list[float] = []
        self.held: dict[str, list[Held]] = {name: [] for name in pids}
        self.log_mb: list[float] = []

    def look(self, hour: float) -> None:
        """Take a sample. Raises OSError when a process is gone."""
        seen = {name: Held.of(pid) for name, pid in self._pids.items()}
        self.hours.append(hour)
        for name, held in seen.items():
            self.held[name].append(held)
        self.log_mb.append(self._log.stat().st_size / MB if self._log.exists() else 0.0)

    def series(self, name: str, column: str) -> NDArray[np.float64]:
        """(k,) one of COLUMNS of one process."""
        return np.array([getattr(held, column) for held in self.held[name]], dtype=np.float64)

    def warm(self) -> NDArray[np.bool_]:
        """(k,) which samples count."""
        hours = np.array(self.hours)
        return np.asarray(hours >= hours[0] + WARM_UP_SHARE * (hours[-1] - hours[0]))

    def growth(self, name: str, column: str) -> float:
        """Slope behind the warm-up, per simulated hour (median of the slopes between pairs, Theil and Sen)."""
        keep = self.warm()
        at, value = np.array(self.hours)[keep], self.series(name, column)[keep]
        if len(at) < 2:
            return float("nan")
        half = len(at) // 2
        return float(np.median((value[half : 2 * half] - value[:half]) / (at[half : 2 * half] - at[:half])))

    def floor_rise(self, name: str, column: str) -> int:
        """How many more the last quarter behind the warm-up has at least than the first: what comes and goes does not count."""
        value = self.series(name, column)[self.warm()]
        quarter = len(value) // 4 + 1
        return int(value[-quarter:].min() - value[:quarter].min()) if len(value) else 0


def picture(watches: Mapping[str, Watch], path: Path) -> None:
    """Memory of every process over simulated hours, one panel per soak, as a PNG."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 3.4 * len(watches)), layout="constrained")
    panels = figure.subplots(len(watches), 1, squeeze=False)[:, 0]
    for panel, (title, watch) in zip(panels, watches.items(), strict=True):
        for name in watch.held:
            panel.plot(watch.hours, watch.series(name, "memory"), label=name, linewidth=1.0)
        panel.plot(watch.hours, watch.log_mb, label="write-ahead log", linewidth=1.0, linestyle=":")
        panel.set(title=title, xlabel="simulated hours", ylabel="MB", ylim=(0.0, None))
        panel.grid(alpha=0.3)
        panel.legend(loc="center right", fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
