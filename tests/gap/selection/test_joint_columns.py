import numpy as np

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
    assert np.concatenate(columns.parts[1]).shape == (0, 5)


def test_columns_of_a_joint_that_was_freed_are_gone() -> None:
    columns = JointColumns(2, 5)
    for joint in (0, 1):
        columns.add(joint, np.ones((2, 5)))
    columns.free(0)
    assert np.concatenate(columns.parts[0]).size == 0
    assert np.concatenate(columns.parts[1]).shape == (2, 5)
