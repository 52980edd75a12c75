"""The generator of blind logs: what each hidden cause does by itself."""

from __future__ import annotations

import numpy as np

from stiction_envs.testing.hidden_logs import make_case


def test_each_of_two_effects_is_measured_by_itself() -> None:
    case = make_case(
        4, ("torque_offset", "torque_scale"), motion="fourier", joint=2, size=0.6, seconds=8.0
    )
    offset = case.hidden[0].values["offset_nm"]
    assert case.alone.shape == (2, 7)
    assert np.isclose(case.alone[0, 1], abs(float(offset)), rtol=0.05)  # type: ignore[arg-type]
    assert np.all(case.effect <= case.alone.sum(axis=0) + 0.02)
    assert case.alone[:, 1].min() > 0.1


def test_a_single_effect_is_the_whole_one() -> None:
    case = make_case(4, ("torque_offset",), motion="fourier", joint=2, size=0.6, seconds=8.0)
    np.testing.assert_array_equal(case.alone, case.effect[None])
