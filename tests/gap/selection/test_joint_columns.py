import numpy as np
import pytest

from stiction_envs.gap.selection.joint_columns import JointColumns


def test_columns_keep_their_numbers_and_are_not_copied() -> None:
    rng = np.random.default_rng(0)
    columns = JointColumns(2, 5)
    parts = [rng.normal(size=(k, 5)) for k in (3, 256, 1, 512)]
    at = [columns.add(0, part) for part in parts]
    assert [x[0] for x in at] == [0, 3, 259, 260]
    for numbers, part in zip(at, parts, strict=True):
        assert columns.at(0, numbers) is part
    np.testing.assert_array_equal(np.concatenate(columns.parts[0]), np.concatenate(parts))
    assert columns.width == [772, 0]
    assert columns.at(0, ()).shape == (0, 5)  # of a candidate that no motion shows
    assert np.concatenate(columns.parts[1]).shape == (0, 5)


def test_only_columns_that_are_kept_are_left() -> None:
    columns, part = JointColumns(2, 5), np.ones((2, 5))
    first, second = (columns.add(0, x) for x in (np.zeros((3, 5)), part))
    columns.add(1, part)
    columns.keep(0, [second])
    assert columns.at(0, second) is part
    assert columns.holds(0, second)
    assert not columns.holds(0, first)
    with pytest.raises(KeyError):
        columns.at(0, first)
    assert np.concatenate(columns.parts[0]).shape == (0, 5)
    assert np.concatenate(columns.parts[1]).shape == (2, 5)
