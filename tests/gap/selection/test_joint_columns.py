import numpy as np

from stiction_envs.gap.selection.joint_columns import ROOM, JointColumns


def test_columns_keep_their_numbers_while_the_memory_grows() -> None:
    rng = np.random.default_rng(0)
    columns = JointColumns(2, 5)
    parts = [rng.normal(size=(k, 5)) for k in (3, ROOM, 1, 2 * ROOM)]
    at = [columns.add(0, part) for part in parts]
    assert [x[0] for x in at] == [0, 3, ROOM + 3, ROOM + 4]
    for numbers, part in zip(at, parts, strict=True):
        np.testing.assert_array_equal(columns.at(0, numbers), part.T)
    np.testing.assert_array_equal(columns.of(0), np.concatenate(parts).T)
    assert columns.width == [3 * ROOM + 4, 0]
    assert columns.of(1).shape == (5, 0)
    assert all(x.flags.c_contiguous for x in columns.of(0).T)


def test_columns_of_a_joint_that_was_freed_are_gone() -> None:
    columns = JointColumns(2, 5)
    for joint in (0, 1):
        columns.add(joint, np.ones((2, 5)))
    columns.free(0)
    assert columns.of(0).size == 0
    assert columns.of(1).shape == (5, 2)
