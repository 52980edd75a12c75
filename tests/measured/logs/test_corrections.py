"""The reader finds and corrects defects in made-up logs with known truth."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.measured.logs.reader import JointLog
from tests.measured.logs.bad_logs import refuses, servo_log, torque_log

RATE = 1000.0
N = 3

Log = dict[str, np.ndarray]


def sway(seconds: float = 10.0, *, q_noise: float = 1e-5, tau_noise: float = 0.05) -> Log:
    """A clean log: three joints that sway, friction, white noise; six digits after the point."""
    rng = np.random.default_rng(7)
    t = np.arange(round(seconds * RATE)) / RATE
    omega = 2 * np.pi * np.array([0.2, 0.27, 0.33])
    angle = np.outer(t, omega) + np.arange(N)
    q = 0.6 * np.sin(angle)
    dq = 0.6 * omega * np.cos(angle)
    tau = 8 * np.sin(q) + 0.7 * np.tanh(dq / 0.02)
    return {
        "t": t,
        "q": np.round(q + q_noise * rng.normal(size=q.shape), 6),
        "dq": np.round(dq + 1e-3 * rng.normal(size=q.shape), 6),
        "tau": np.round(tau + tau_noise * rng.normal(size=q.shape), 4),
    }


def rows_of(log: Log, rows: np.ndarray) -> Log:
    return {name: array[rows] for name, array in log.items()}


def read(tmp_path: Path, log: Log) -> JointLog:
    np.savez(tmp_path / "log.npz", **log)
    return torque_log(tmp_path / "log.npz", N)


def corrected(log: JointLog) -> Counter[str]:
    """Rows corrected, by kind."""
    found = Counter()
    for correction in log.corrections:
        found[correction.kind] += correction.rows
    return found


def test_a_clean_log_is_left_alone(tmp_path: Path) -> None:
    truth = sway()
    log = read(tmp_path, truth)
    assert (log.corrections, log.warnings, log.breaks) == ((), (), ())
    assert all(np.array_equal(getattr(log, k), truth[k]) for k in ("t", "q", "dq", "tau"))


def test_repeated_rows_are_dropped_and_counted(tmp_path: Path) -> None:
    """The logger writes 300 samples twice: exactly those rows go, and the clock is the robot's."""
    truth = sway()
    rng = np.random.default_rng(0)
    twice = np.sort(rng.choice(np.arange(1, 9999), 300, replace=False))
    rows = np.sort(np.r_[np.arange(10_000), twice])
    log = rows_of(truth, rows)
    again = np.r_[False, rows[1:] == rows[:-1]]
    log["t"] = log["t"] + 4e-4 * again
    found = read(tmp_path, log)
    assert corrected(found) == {"repeat": 300}
    assert np.array_equal(found.q, truth["q"])
    assert np.allclose(found.t, truth["t"], atol=1e-12)


def test_a_robot_at_rest_may_repeat_itself(tmp_path: Path) -> None:
    """A simulated log without noise stands still for 2 s, to the last digit: nothing to correct."""
    truth = sway(q_noise=0, tau_noise=0)
    truth["dq"] = np.gradient(truth["q"], 1e-3, axis=0)
    stop = rows_of(truth, np.r_[np.arange(5000), np.full(2000, 5000), np.arange(5000, 10_000)])
    stop["t"] = np.arange(12_000) / RATE
    stop["dq"][5000:7000] = 0
    found = read(tmp_path, stop)
    assert len(found.t) == 12_000
    assert "frozen" not in corrected(found)
    assert found.breaks == ()


def test_a_frozen_log_becomes_a_gap(tmp_path: Path) -> None:
    """The logger hangs for 0.6 s and the arm moves on: those rows go, the log is split."""
    truth = sway()
    rows = np.arange(10_000)
    rows[4000:4600] = 3999
    found = read(tmp_path, rows_of(truth, rows) | {"t": truth["t"]})
    assert corrected(found) == {"frozen": 600, "gap": 1}
    assert found.breaks == (4000,)
    assert np.array_equal(found.q, truth["q"][np.r_[0:4000, 4600:10_000]])


def test_rows_with_an_old_position_are_dropped(tmp_path: Path) -> None:
    truth, log = sway(), sway()
    rng = np.random.default_rng(1)
    old = 2 * rng.choice(np.arange(50, 4950), 120, replace=False)
    log["q"][old] = log["q"][old - 1]
    found = read(tmp_path, log)
    # Where all joints are slow at once, an old position is as good as a new one.
    assert set(corrected(found)) == {"stale"}
    assert 114 <= corrected(found)["stale"] <= 120
    kept = np.round(found.t * RATE).astype(int)
    assert set(range(10_000)) - set(kept) <= set(old)
    assert np.abs(found.q - truth["q"][kept]).max() < 2e-3


def test_two_halves_of_a_sample_are_put_together(tmp_path: Path) -> None:
    """Torques that come a row late: one row too many for each, and nothing is lost."""
    truth = sway()
    late = np.arange(100, 9000, 100)
    rows = np.sort(np.r_[np.arange(10_000), late])
    log = rows_of(truth, rows)
    log["t"] = np.arange(len(rows)) / RATE
    first = np.searchsorted(rows, late)
    log["tau"][first] = log["tau"][first - 1]
    found = read(tmp_path, log)
    assert corrected(found)["stale"] == len(late)
    for name in ("q", "dq", "tau"):
        assert np.array_equal(getattr(found, name), truth[name])


def test_old_torques_are_interpolated(tmp_path: Path) -> None:
    truth, log = sway(), sway()
    old = np.arange(500, 9500, 300)
    log["tau"][old] = log["tau"][old - 1]
    found = read(tmp_path, log)
    assert corrected(found) == {"stale": len(old)}
    expected = (truth["tau"][old - 1] + truth["tau"][old + 1]) / 2
    assert np.allclose(found.tau[old], expected)


def test_angles_polled_in_turn_are_used_when_they_are_new(tmp_path: Path) -> None:
    """Each joint is read every fourth row; in between its last angle is written again."""
    truth = sway(q_noise=1e-6)
    log = {name: array.copy() for name, array in truth.items() if name != "dq"}
    row = np.arange(len(log["t"]))
    for j in range(N):
        log["q"][:, j] = truth["q"][np.maximum((row - j) // 4 * 4 + j, 0), j]
    held = np.abs(log["q"] - truth["q"]).max()
    found = read(tmp_path, log)
    assert corrected(found) == {"held": len(row)}
    assert found.held == 4
    assert "q of 3 joints stands for 4 rows" in found.corrections[0].text
    assert np.abs(found.q - truth["q"])[10:-10].max() < 0.01 * held
    np.testing.assert_array_equal(found.tau, truth["tau"])


def test_coarse_encoders_hold_no_values(tmp_path: Path) -> None:
    """Slow joints stay on one step of the encoder for several rows."""
    log = sway(q_noise=0.0)
    del log["dq"]
    log["q"] = np.round(log["q"] / 3e-3) * 3e-3
    found = read(tmp_path, log)
    assert "held" not in corrected(found)
    assert found.held == 1


def test_single_missing_values_are_interpolated(tmp_path: Path) -> None:
    truth, log = sway(), sway()
    log["q"][[200, 201, 5000], 1] = np.nan
    log["tau"][300, 0] = np.nan
    log["dq"][0] = np.nan  # what a difference leaves behind
    for name in ("q", "dq", "tau"):
        log[name][7000:7004] = np.nan  # rows without any value
    found = read(tmp_path, log)
    assert corrected(found) == {"missing": 4 + 1 + 4}
    assert len(found.t) == 10_000 - 5
    rest = np.delete(np.arange(10_000), [0, *range(7000, 7004)])
    assert np.abs(found.q - truth["q"][rest]).max() < 1e-4
    assert np.abs(found.tau - truth["tau"][rest]).max() < 0.3


def test_speeds_that_are_mostly_missing_are_not_used(tmp_path: Path) -> None:
    log = sway()
    log["dq"][::2, 1] = np.nan
    found = read(tmp_path, log)
    assert found.dq is None
    assert found.warnings == ("dq2 has no value in 5000 of 10000 rows: dq is not used",)


def jittered(kind: str, t: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(5)
    if kind == "slight":
        return t + 5e-5 * rng.normal(size=len(t))
    if kind == "half a step":
        return t + 4e-4 * (2 * rng.random(len(t)) - 1)
    if kind == "late":
        return np.maximum.accumulate(t + 2e-4 * rng.exponential(size=len(t))) + 1e-9 * t
    if kind == "drifting":
        return t * (1 + 5e-5) + 3e-4 * (2 * rng.random(len(t)) - 1)
    return np.floor(t / 4e-3) * 4e-3


@pytest.mark.parametrize(
    ("kind", "lost"),
    [("slight", 0.0), ("half a step", 0.06), ("late", 0.0), ("drifting", 0.06), ("coarse", 0.06)],
)
def test_the_robot_clock_is_rebuilt(tmp_path: Path, kind: str, lost: float) -> None:
    """Stamps wrong by up to half a step or more, samples lost: steps right in every row."""
    truth = sway()
    rows = np.flatnonzero(np.random.default_rng(2).random(10_000) >= lost)
    log = rows_of(truth, rows)
    log["t"] = jittered(kind, log["t"])
    found = read(tmp_path, log)
    assert "clock" in corrected(found)
    assert len(found.t) == len(rows)
    wrong = np.abs(np.diff(found.t) - np.diff(truth["t"][rows])) > 1e-7
    # At both ends there is nothing to compare with on one side; jittered stamps stay there.
    assert wrong[30:-30].mean() < (0.002 if kind != "coarse" else 0.02)


def test_uneven_sampling_that_is_true_is_left_alone(tmp_path: Path) -> None:
    """Samples at random times with true stamps: the motion agrees with them."""
    rng = np.random.default_rng(4)
    t = np.cumsum(1e-3 * (0.5 + rng.random(8000)))
    omega = 2 * np.pi * np.array([0.2, 0.27, 0.33])
    q = 0.6 * np.sin(np.outer(t, omega)) + 1e-5 * rng.normal(size=(8000, N))
    found = read(tmp_path, {"t": t, "q": q, "tau": 8 * q + 0.05 * rng.normal(size=q.shape)})
    assert (found.corrections, found.warnings) == ((), ())
    assert np.array_equal(found.t, t)


def test_jitter_that_the_noise_hides_is_left_alone(tmp_path: Path) -> None:
    log = sway(q_noise=2e-3)
    log["t"] = jittered("half a step", log["t"])
    found = read(tmp_path, log)
    assert "clock" not in corrected(found)
    assert np.array_equal(found.t, log["t"])


def test_gaps_split_the_log(tmp_path: Path) -> None:
    truth = sway()
    keep = np.r_[0:3000, 3500:6000, 6030:10_000]
    found = read(tmp_path, rows_of(truth, keep))
    assert corrected(found) == {"gap": 2}
    assert found.breaks == (3000, 5500)
    # A few lost samples are no gap.
    assert read(tmp_path, rows_of(truth, np.r_[0:3000, 3015:10_000])).breaks == ()


def test_speeds_that_lag_are_found(tmp_path: Path) -> None:
    log = sway()
    log["dq"] = np.roll(log["dq"], 7, axis=0)
    log["dq"][:7] = log["dq"][7]
    (warning,) = read(tmp_path, log).warnings
    assert "dq lags the derivative of q by 7" in warning


def test_wrong_speeds_are_found(tmp_path: Path) -> None:
    log = sway()
    assert any("opposite sign" in w for w in read(tmp_path, log | {"dq": -log["dq"]}).warnings)
    assert any("0.5 times" in w for w in read(tmp_path, log | {"dq": 0.5 * log["dq"]}).warnings)
    wrong = log | {"dq": np.rad2deg(log["dq"])}
    refuses(lambda: read(tmp_path, wrong), r"log\.npz: dq is 57\.3 times")


def test_a_commanded_position_is_found(tmp_path: Path) -> None:
    """The arm shakes at 20 to 30 Hz; speed and torque show it, the logged angle does not."""
    log = sway(20)
    rng = np.random.default_rng(9)
    t = log["t"]
    shake = sum(
        np.sin(2 * np.pi * f * t + p)
        for f, p in zip(rng.uniform(18, 30, 40), rng.uniform(0, 7, 40), strict=True)
    )[:, None]
    log["dq"] = log["dq"] + 0.005 * shake
    log["tau"] = log["tau"] + 0.05 * shake
    (warning,) = read(tmp_path, log).warnings
    assert "q may be the commanded position" in warning
    # Where the angle shakes along, it is a measurement.
    log["q"] = log["q"] + np.cumsum(0.005 * shake, axis=0) * 1e-3
    assert read(tmp_path, log).warnings == ()


def test_noisy_speeds_are_no_sign_of_commanded_positions(tmp_path: Path) -> None:
    log = sway()
    log["dq"] = log["dq"] + 0.05 * np.random.default_rng(0).normal(size=log["dq"].shape)
    assert read(tmp_path, log).warnings == ()


def test_saturated_and_dead_torques_are_found(tmp_path: Path) -> None:
    log = sway()
    log["tau"][:, 1] = np.clip(log["tau"][:, 1], -9, 3.5)
    log["tau"][:, 2] = 0.25
    warnings = read(tmp_path, log).warnings
    assert len(warnings) == 2
    assert warnings[0] == "tau3 is always 0.25 although the joint moves"
    assert warnings[1].startswith("tau2 stays at its largest value 3.5 N·m in ")


def test_coarse_torques_are_not_saturated(tmp_path: Path) -> None:
    log = sway()
    log["tau"] = np.round(log["tau"] / 0.2) * 0.2
    assert read(tmp_path, log).warnings == ()


def test_two_steps_of_a_coarse_sensor_at_rest_are_not_saturated(tmp_path: Path) -> None:
    log = sway()
    log["q"][:, 0], log["dq"][:, 0] = 0.5, 0.0
    for levels in (2, 3, 6):
        noise = np.random.default_rng(levels).integers(0, levels, len(log["t"]))
        log["tau"][:, 0] = 0.0264 * np.repeat(noise[: len(noise) // 8], 8)
        assert read(tmp_path, log).warnings == ()


def wrapped(x: np.ndarray, low: float = -np.pi) -> np.ndarray:
    return low + (x - low) % (2 * np.pi)


@pytest.mark.parametrize("low", [-np.pi, 0.0])
def test_wrapped_angles_are_unwrapped_and_said(tmp_path: Path, low: float) -> None:
    """A joint that turns round and round, with missing values; the others stay as they are."""
    log = sway()
    turning = 1.7 * log["t"] + 0.2 * np.sin(log["t"])
    log["q"][:, 1], log["dq"][:, 1] = wrapped(turning, low), 1.7 + 0.2 * np.cos(log["t"])
    log["q"][100:103, 1] = np.nan
    found = read(tmp_path, log)
    np.testing.assert_allclose(found.q[:, 1] - found.q[0, 1], turning, atol=1e-5)
    np.testing.assert_array_equal(found.q[:, 0], log["q"][:, 0])
    (text,) = [c.text for c in found.corrections if c.kind == "wrap"]
    assert text == "q2: angles within one turn, which jump at its ends: unwrapped"
    assert found.warnings == ()


def test_a_command_that_is_wrapped_elsewhere_is_a_turn_away(tmp_path: Path) -> None:
    log = sway()
    q = np.column_stack([log["q"][:, 0], np.pi + log["q"][:, 1]])
    told = np.column_stack([q[:, 0] + 0.01, wrapped(q[:, 1] + 0.01, -0.5 * np.pi)])
    np.savez(tmp_path / "log.npz", t=log["t"], q=wrapped(q), q_cmd=told)
    found = servo_log(tmp_path / "log.npz", 2)
    np.testing.assert_allclose(found.q_cmd - found.q, 0.01, atol=1e-9)
    assert any("q2, q_cmd2: angles within one turn" in c.text for c in found.corrections)


def test_degrees_are_not_unwrapped(tmp_path: Path) -> None:
    """A step of 6.28 degrees is no turn of radians."""
    log = sway()
    log["q"][:, 1] = np.round(log["q"][:, 1] / 0.6 * 90 / (2 * np.pi)) * 2 * np.pi
    refuses(lambda: read(tmp_path, log), "looks like degrees")
