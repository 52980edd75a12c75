"""Compiled functions: cached if possible, and never in the way."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from stiction_envs.compiled import compiled

ROOT = Path(__file__).parents[1]


def test_division_by_zero_is_as_in_numpy():
    @compiled
    def ratio(a, b):
        return a / b

    assert ratio(1.0, 0.0) == np.inf
    assert np.isnan(ratio(0.0, 0.0))


def test_without_a_place_for_the_cache(tmp_path):
    """A package that is installed read-only, run by a user without a home."""
    code = (
        "import numba.core.caching as c\n"
        "c.CacheImpl._locator_classes = []\n"
        "from stiction_envs.control.rotation import slerp\n"
        "import numpy as np\n"
        "q = np.array([1.0, 0.0, 0.0, 0.0])\n"
        "print(slerp(q, q, 0.5)[0])\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "HOME": str(tmp_path)}
    ran = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert ran.stdout.strip() == "1.0", ran.stderr
