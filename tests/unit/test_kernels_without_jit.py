"""Compiled kernels compute what their Python says: the same chain with and without the compiler, no warning in either."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from tests.unit.kernel_chain import chain

ROOT = Path(__file__).parents[2]
DIGITS = 1e-12  # share of the largest number of each table


def test_the_chain_without_the_compiler_gives_the_same_numbers_and_no_warning(tmp_path: Path) -> None:
    target = tmp_path / "plain.npz"
    ran = subprocess.run(
        [sys.executable, "-W", "error::RuntimeWarning", "-m", "tests.unit.kernel_chain", str(target)],
        cwd=ROOT,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr[-2000:]
    compiled, plain = chain(), np.load(target)
    assert set(compiled) == set(plain.files) and len(compiled) > 30
    for name, table in compiled.items():
        assert plain[name].shape == table.shape, name
        size = max(1.0, float(np.abs(table).max(initial=0.0)))
        np.testing.assert_allclose(plain[name], table, rtol=0.0, atol=DIGITS * size, err_msg=name)
