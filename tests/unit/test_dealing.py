"""The modules that several pytest processes share: each goes to one, what is long first, and what is listed as long is there."""

from __future__ import annotations

from pathlib import Path

from tests.dealing import LANES, LONGEST, PURE, SERVED, take, wanted

ROOT = Path(__file__).resolve().parents[2]
PATHS = [str(path.relative_to(ROOT)) for path in sorted((ROOT / "tests").rglob("test_*.py"))]


def test_what_is_listed_is_there() -> None:
    assert set(LONGEST) <= set(PATHS)
    assert all(any(path.startswith(start) for path in PATHS) for start in (*SERVED, *PURE))


def test_two_lanes_would_run_everything_and_the_third_only_what_computes_by_itself() -> None:
    served, computed, gaps = (wanted(PATHS, lane) for lane in LANES)
    assert sorted(served) == sorted(computed) == sorted(PATHS)
    assert gaps and all(path.startswith(PURE) and path not in LONGEST for path in gaps)
    assert served[0] == LONGEST[0] and computed[0] == next(path for path in LONGEST if not path.startswith(SERVED))


def test_a_module_is_taken_once_whoever_asks_first(tmp_path: Path) -> None:
    assert take(tmp_path / "tests.unit.test_dealing.py")
    assert not take(tmp_path / "tests.unit.test_dealing.py")
    assert take(tmp_path / "tests.unit.test_setup.py")
