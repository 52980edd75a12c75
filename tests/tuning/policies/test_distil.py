"""The closest table and rule: those that made the data are found again."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.envs.agents import ConstantTable, GatedTable
from stiction_envs.measured import AmplitudeRow, read_amplitudes
from tests.tuning.policies.small import SPRINT
from tuning.policies.distil import distil, fit
from tuning.policies.settings import policy_settings

TOP = np.array([2.0, 2.0, 2.0])
SETTINGS = policy_settings().distil


def drawn(m: int = 3000, joints: int = 3):
    rng = np.random.default_rng(0)
    speed = 0.2 * rng.normal(size=(m, joints))
    torque = rng.normal(size=(m, joints))
    frequency = rng.uniform(20, 40, size=(m, joints))
    return rng, speed, torque, frequency


def test_a_gated_table_is_found_again():
    """A = a exp(−(q̇/v)²) on joint 1, constant on joint 2, nothing on joint 3."""
    _, speed, torque, frequency = drawn()
    amplitude = np.array([1.2, 0.7, 0.0]) * np.ones_like(speed)
    amplitude[:, 0] *= np.exp(-((speed[:, 0] / 0.15) ** 2))
    one, two, three = fit(speed, torque, amplitude, frequency, top=TOP, settings=SETTINGS)
    assert one.table_nm == pytest.approx(1.2, rel=1e-4)
    assert one.table_gate_rad_s == pytest.approx(0.15, rel=1e-4)
    assert one.table_r2 == pytest.approx(1.0, abs=1e-8)
    assert (two.table_nm, two.table_gate_rad_s, two.rule_threshold) == (pytest.approx(0.7), 0, 0)
    assert np.isnan(two.table_r2), "there is no variance to explain"
    assert (three.table_nm, three.rule_nm) == (0, 0)
    assert two.frequency_hz == pytest.approx(frequency[:, 1].mean())


def test_a_rule_is_found_again_and_a_table_explains_less():
    """A = a min(1, |τ|/θ) exp(−(q̇/v)²) with noise of a tenth."""
    rng, speed, torque, frequency = drawn()
    shape = np.minimum(1, np.abs(torque) / np.array([0.5, 1.0, 0.1]))
    amplitude = 1.5 * shape * np.exp(-((speed / 0.3) ** 2))
    noisy = np.clip(amplitude + 0.05 * rng.normal(size=amplitude.shape), 0, 2)
    fits = fit(speed, torque, noisy, frequency, top=TOP, settings=SETTINGS)
    assert [f.rule_threshold for f in fits] == pytest.approx([0.5, 1.0, 0.1], rel=0.05)
    assert [f.rule_gate_rad_s for f in fits] == pytest.approx([0.3] * 3, rel=0.05)
    assert [f.rule_nm for f in fits] == pytest.approx([1.5] * 3, rel=0.03)
    for f in fits[:2]:
        assert f.table_r2 < f.rule_r2 - 0.1
        expected = 1 - 0.05**2 / np.var(noisy[:, f.joint - 1])
        assert f.rule_r2 == pytest.approx(expected, abs=0.02)


def test_frequencies_count_with_their_power():
    _, speed, torque, _ = drawn()
    amplitude, frequency = np.ones_like(speed), np.full(speed.shape, 20.0)
    amplitude[::2], frequency[::2] = 0.5, 60.0
    (one, *_) = fit(speed, torque, amplitude, frequency, top=TOP, settings=SETTINGS)
    assert one.frequency_hz == pytest.approx((20 + 0.25 * 60) / 1.25)
    assert one.frequency_std_hz == pytest.approx(40 * 0.4)


def test_amplitudes_stay_within_the_bounds():
    _, speed, torque, frequency = drawn()
    amplitude = 4.0 * np.exp(-((speed / 0.1) ** 2))
    fits = fit(speed, torque, amplitude, frequency, top=TOP, settings=SETTINGS)
    assert all(f.table_nm <= 2.0 and f.rule_nm <= 2.0 for f in fits)


@pytest.mark.slow
def test_a_table_is_distilled_into_itself(tmp_path):
    """Nothing is lost where the policy is a gated table."""
    env = SPRINT.make(1)
    rows = [AmplitudeRow(6, 30.0, 0.5, gate_rad_s=0.2), AmplitudeRow(7, 20.0, 0.4, gate_rad_s=0.1)]
    distilled = distil(SPRINT, GatedTable(env, rows, speed=np.inf), episodes=4, seed=1)
    assert [r.joint for r in distilled.table] == [6, 7]
    assert [r.amplitude_nm for r in distilled.table] == pytest.approx([0.5, 0.4], rel=1e-3)
    assert [r.gate_rad_s for r in distilled.table] == pytest.approx([0.2, 0.1], rel=1e-3)
    assert distilled.lost["table"] == pytest.approx(0.0, abs=0.01)
    assert distilled.lost["rule"] == pytest.approx(0.0, abs=0.01)
    distilled.save(tmp_path)
    assert read_amplitudes(tmp_path / "final.csv", n_joints=7) == list(distilled.table)
    written = {"final.csv", "final.yaml", "rule.csv", "distilled.csv"}
    assert {p.name for p in tmp_path.iterdir()} == written


@pytest.mark.slow
def test_nothing_distils_into_nothing(tmp_path):
    distilled = distil(SPRINT, ConstantTable(SPRINT.make(1), []), episodes=2, seed=1)
    assert distilled.table == ()
    assert np.isnan(distilled.lost["table"])
    distilled.save(tmp_path)
    assert not (tmp_path / "final.csv").exists()
