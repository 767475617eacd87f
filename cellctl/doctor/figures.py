"""Figures of a series of measured times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def times_text(taken_s: Sequence[float]) -> tuple[float, float, str]:
    """p50 and p99 (s) of times (s), and both in words; of fewer than 100 the p99 is the longest."""
    middle = float(np.percentile(taken_s, 50.0))
    late = float(np.percentile(taken_s, 99.0, method="higher"))
    return middle, late, f"p50 {1e3 * middle:.1f} ms, p99 {1e3 * late:.1f} ms of {len(taken_s)}"
