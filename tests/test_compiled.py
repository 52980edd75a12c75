"""Compiled functions: cached if possible, and never in the way."""

import numpy as np

from stiction_envs.compiled import compiled
from tests.command_line import python


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
        "from stiction_envs.control.rotation import angle_one\n"
        "import numpy as np\n"
        "q = np.array([1.0, 0.0, 0.0, 0.0])\n"
        "print(angle_one(q, q))\n"
    )
    ran = python(code, HOME=str(tmp_path))
    assert ran.stdout.strip() == "0.0", ran.stderr
