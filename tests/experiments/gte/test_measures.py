"""What a run is judged by, on runs whose numbers are known."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.experiments.gte import experiment as gte
from stiction_envs.experiments.gte import measures as gte_measures
from stiction_envs.experiments.gte import rows as gte_table
from tests.experiments.gte.made_up import made_up

NAN = float("nan")


def constant(*values: float) -> np.ndarray:
    """Errors (2, 700, 6) of two iterations, the second the negative of the first."""
    one = np.tile(values, (700, 1))
    return np.stack([one, -one])


VALUES = (1e-3, -2e-3, 3e-3, 0.01, -0.02, 0.03)


def test_error_is_small_where_roll_passes_pi():
    """At roll = π, errors of either sign stay what they are."""
    np.testing.assert_allclose(made_up(constant(*VALUES)).error, constant(*VALUES), atol=1e-12)


def test_window_has_200_samples():
    m = gte_measures.measure(made_up(constant(*VALUES)))
    np.testing.assert_allclose(m.window_sum, np.tile(200 * np.abs(VALUES), (2, 1)))


def test_window_lies_around_each_iterations_own_last_point():
    """1 s before to 1 s after it; an error that counts samples shows which ones were taken."""
    error = np.broadcast_to(np.arange(700.0)[:, None] * 1e-4, (2, 700, 6))
    run = made_up(error, accepted=[[0, 2, 4], [0, 2.1, 4.1]])
    taken = gte_measures.measure(run).window_sum[:, 0] * 1e4
    np.testing.assert_allclose(taken, [np.arange(k, k + 200).sum() for k in (300, 310)])


def test_measures_are_over_the_motion():
    """RMS, mean, maximum, shaking and energy: until the last goal is reached, at 6 s."""
    error = np.zeros((2, 700, 6))
    error[:, :300, 0], error[:, 600:] = 0.02, 9.0
    m = gte_measures.measure(made_up(error))
    np.testing.assert_allclose(m.rms[:, 0], 0.02 / np.sqrt(2))
    np.testing.assert_allclose(m.mean[:, 0], 0.01)
    np.testing.assert_allclose(m.maximum[:, 0], 0.02)
    assert not m.maximum[:, 1:].any()
    np.testing.assert_allclose(m.total_error[:, :2], [[300 * 0.02 + 100 * 9.0, 100 * 9.0]] * 2)
    np.testing.assert_allclose(m.vibration, np.tile([3e-3, 4e-3, 0, 0, 0, 12e-3], (2, 1)))
    np.testing.assert_allclose(m.shaking, 13e-3)
    np.testing.assert_allclose(m.shaking_at_rest, 13e-3)
    row = gte_table.run_row(made_up(error), m, "panda")
    assert row.vibration_m == pytest.approx(13e-3)
    assert row.vibration_turning_m == pytest.approx(12e-3)
    np.testing.assert_allclose(m.dither_energy, 2.0 * 6.0)
    np.testing.assert_allclose(m.torque_rate, 7.0)
    np.testing.assert_allclose(m.duration, 6.0)


def test_corner_and_settling_errors():
    """Before the reference goes to the measured pose; at the last goal, after the tail."""
    error = np.broadcast_to(np.arange(700.0)[:, None] * 1e-5, (2, 700, 6))
    m = gte_measures.measure(made_up(error))
    assert m.corner.shape == (2, 2, 6)
    assert m.settling.shape == (2, 3, 6)
    np.testing.assert_allclose(m.corner[:, :, 0], [[199e-5, 399e-5]] * 2)
    np.testing.assert_allclose(m.settling[:, :, 0], [[199e-5, 399e-5, 699e-5]] * 2)
    assert not m.missed.any()


def test_missed_goals():
    """0.03 m in x and y is 0.042 m: beyond the generator's 0.04 m; so is 0.3 rad of 0.25."""
    far = gte_measures.measure(made_up(constant(0.03, 0.03, 0, 0, 0, 0)))
    assert far.missed.all()
    turned = gte_measures.measure(made_up(constant(0, 0, 0, 0, 0.3, 0)))
    assert turned.missed.all()
    assert not gte_measures.measure(made_up(constant(0.03, 0, 0, 0, 0.2, 0))).missed.any()


def test_measures_of_a_run_that_never_ends():
    """The whole record counts; what belongs to goals never reached is NaN."""
    run = made_up(
        np.full((1, 700, 6), 0.01), iterations=1, accepted=(0, 2, NAN), reached=(2, NAN, NAN)
    )
    m = gte_measures.measure(run)
    np.testing.assert_allclose(m.rms, 0.01)
    np.testing.assert_allclose(m.dither_energy, 14.0)
    assert np.isnan(m.window_sum).all(), "the last goal was never accepted"
    assert np.isnan(m.duration).all()
    assert np.isnan(m.shaking_at_rest).all()
    np.testing.assert_array_equal(np.isnan(m.settling[0, :, 0]), [False, True, True])
    np.testing.assert_array_equal(m.missed, [[False, True, True]])
    row = gte_table.run_row(run, m, "panda")
    assert (row.unfinished, row.goals_missed) == (1, 2)


def test_path_of_one_goal_has_no_corner():
    run = made_up(constant(*VALUES))
    one = gte.Run(
        **{
            **{k: getattr(run, k) for k in run.__dataclass_fields__},
            "accepted": run.accepted[:, :1],
            "reached": run.reached[:, 2:],
        }
    )
    m = gte_measures.measure(one)
    assert m.corner.shape == (2, 0, 6)
    row = gte_table.error_rows(one, m, "panda")[0]
    assert np.isnan(row.corner)
    assert row.settling == pytest.approx(1e-3)


def test_written_tables_have_their_columns(tmp_path):
    run = made_up(constant(*VALUES), dithered=True)
    m = gte_measures.measure(run)
    gte_table.write_rows(tmp_path / "errors.csv", gte_table.error_rows(run, m, "panda"))
    gte_table.write_rows(tmp_path / "runs.csv", [gte_table.run_row(run, m, "panda")])
    gte_table.write_points(tmp_path / "points.csv", [(run, m)])
    gte_table.write_trace(tmp_path / "trace.csv", [run])
    lines = {p.stem: p.read_text().splitlines() for p in tmp_path.iterdir()}
    assert {k: len(v) for k, v in lines.items()} == {
        "errors": 7,
        "runs": 2,
        "points": 4,
        "trace": 701,
    }
    assert lines["points"][0] == (
        "case,goal,accepted_s,reached_s,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad"
    )
    assert lines["points"][2].startswith("dither,2,2.0,4.0,0.00")
    assert all(len(line.split(",")) == 14 for line in lines["trace"])
    assert lines["errors"][1].startswith("panda,triangle,200.0,20.0,0.0,dither,x,m,")
