"""Names of rows: random, and in the order of their making."""

from __future__ import annotations

import secrets


def new_id(kind: str, at: float) -> str:
    """`<kind>-<milliseconds in hex><random>`, e.g. job-019ab3f0c2d8a1b2c3. `at` is Unix time, s."""
    return f"{kind}-{int(at * 1000):012x}{secrets.token_hex(4)}"
