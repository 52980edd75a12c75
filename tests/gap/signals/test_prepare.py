"""Signals from logs whose truth is known: sines, and motions with friction and noise."""

import dataclasses

import numpy as np
import pytest

from stiction_envs.errors import StictionError
from stiction_envs.filters import lowpass
from stiction_envs.gap.signals.prepare import Signals, prepare
from stiction_envs.measured.logs.reader import JointLog
from tests.refusal import refusal

N = 3


def log_of(t: np.ndarray, q: np.ndarray, tau: np.ndarray, **other: object) -> JointLog:
    return JointLog(source="made up", t=t, q=q, dq=None, tau=tau, **other)  # type: ignore[arg-type]


class Motion:
    """Fourier series of five harmonics for each joint, with exact derivatives, and friction."""

    def __init__(self, seed: int = 0, base_hz: float = 0.1) -> None:
        rng = np.random.default_rng(seed)
        self.omega = 2 * np.pi * base_hz * np.arange(1, 6)
        self.size = rng.normal(size=(5, N)) * 0.3 / np.arange(1, 6)[:, None]
        self.phase = rng.uniform(0, 2 * np.pi, (5, N))

    def at(self, t: np.ndarray) -> tuple[np.ndarray, ...]:
        """q, dq, ddq, tau, (T, N) each."""
        angle = t[:, None, None] * self.omega[:, None] + self.phase
        w = self.omega[:, None]
        q = (self.size * np.sin(angle)).sum(axis=1)
        dq = (self.size * w * np.cos(angle)).sum(axis=1)
        ddq = -(self.size * w**2 * np.sin(angle)).sum(axis=1)
        return q, dq, ddq, 20 * np.sin(q) + 2 * ddq + np.tanh(dq / 0.01)


def noisy(
    q_noise: float, tau_noise: float, *, seconds: float = 40, rate: float = 1000, seed: int = 0
) -> JointLog:
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    q, _, _, tau = Motion().at(t)
    return log_of(
        t, q + q_noise * rng.normal(size=q.shape), tau + tau_noise * rng.normal(size=q.shape)
    )


OTHER = JointLog(source="other", t=np.arange(2.0), q=np.ones((2, 6)), dq=None, tau=np.ones((2, 6)))


def only(signals: Signals) -> Signals:
    assert len(signals.runs) == 1
    return signals


def acceleration_error(log: JointLog, cutoff: float | None) -> float:
    """Error of the acceleration as a share of its root mean square."""
    segment = only(prepare([log], cutoff_hz=cutoff))
    ddq = Motion().at(segment.t)[2]
    return float(np.std(segment.ddq - ddq) / np.std(ddq))


# ---- derivatives and phase ----


@pytest.mark.parametrize("hz", [0.05, 0.5, 2.0])
def test_a_sine_is_differentiated_without_lag(hz: float) -> None:
    """q = sin ωt far below the cutoff: dq = ω cos ωt, ddq = −ω² sin ωt, torque unchanged."""
    t = np.arange(20_000) / 1000
    w = 2 * np.pi * hz
    q = np.sin(w * t)[:, None] * np.ones(N)
    segment = only(prepare([log_of(t, q, 5 * q)], cutoff_hz=20.0))
    at = segment.t[:, None]
    assert np.abs(segment.q - np.sin(w * at)).max() < 2e-5
    assert np.abs(segment.dq - w * np.cos(w * at)).max() < 2e-4 * max(w, 0.1)
    # At the very ends the filter guesses; inside, all is as exact as the differences.
    inner = slice(200, -200)
    assert np.abs(segment.ddq - -(w**2) * np.sin(w * at))[inner].max() < 1e-5 + 1e-4 * w**2
    assert np.abs(segment.tau - 5 * segment.q).max() < 1e-9


def test_uneven_times_are_put_on_an_even_grid() -> None:
    """Lost samples, and true uneven stamps: derivatives as from an even log."""
    rng = np.random.default_rng(0)
    lattice = np.arange(40_000) / 1000
    for t in (
        lattice[rng.random(40_000) > 0.1],
        np.cumsum(1e-3 * (0.6 + 0.8 * rng.random(40_000))),
    ):
        q, _, _, tau = Motion().at(t)
        signals = prepare([log_of(t, q, tau)], cutoff_hz=10.0)
        segment = only(signals)
        assert np.abs(np.diff(segment.t) - signals.dt).max() < 1e-9
        _, dq, ddq, _ = Motion().at(segment.t)
        assert np.std(segment.dq - dq) < 2e-4
        assert np.std(segment.ddq - ddq) < 5e-3


# ---- cutoff and noise ----


@pytest.mark.parametrize(
    ("q_noise", "tau_noise"), [(1e-6, 0.02), (1e-5, 0.05), (1e-4, 0.2), (1e-3, 1.0)]
)
def test_the_cutoff_fits_the_noise(q_noise: float, tau_noise: float) -> None:
    """The acceleration is good, to 1 % or to 0.05 rad/s² and what one octave of luck allows."""
    log = noisy(q_noise, tau_noise)
    signals = prepare([log])
    assert 3 < signals.cutoff <= 100
    ddq = Motion().at(only(signals).t)[2]
    wrong = np.std(only(signals).ddq - ddq, axis=0)
    assert np.all(wrong < 2 * np.maximum(0.05, 0.01 * np.std(ddq, axis=0)))
    assert acceleration_error(log, 4 * signals.cutoff) > 2 * acceleration_error(log, None)


@pytest.mark.parametrize("cutoff", [None, 3.0, 30.0])
@pytest.mark.parametrize("size", [0.01, 0.3])
def test_noise_of_the_torque_is_right_to_20_per_cent(cutoff: float | None, size: float) -> None:
    """White noise of known size behind the filter, under a signal with jumps."""
    log, clean = noisy(1e-5, size), noisy(1e-5, 0.0)
    signals = prepare([log], cutoff_hz=cutoff)
    left = only(signals).tau - only(prepare([clean], cutoff_hz=signals.cutoff)).tau
    assert signals.noise_tau == pytest.approx(np.std(left, axis=0), rel=0.2)


def test_filtered_torques_are_told() -> None:
    clean = noisy(1e-5, 0.0)
    smooth = np.round(lowpass(clean.tau, 1000.0, 20.0), 4)
    notes = prepare([log_of(clean.t, clean.q, smooth)]).notes
    assert any("filtered before they were logged" in note for note in notes)
    assert not any("filtered before" in note for note in prepare([noisy(1e-5, 0.05)]).notes)


# ---- segments, logs, long logs ----


def test_segments_and_logs_keep_their_order_and_their_ends_are_cut() -> None:
    t = np.arange(20_000) / 1000
    t[8000:] += 1.0
    q, _, _, tau = Motion().at(t)
    split = log_of(t, q, tau, breaks=(8000,))
    whole = noisy(1e-5, 0.05, seconds=10)
    signals = prepare([whole, split], cutoff_hz=20.0)
    assert [signals.log[run.start] for run in signals.runs] == [0, 1, 1]
    for run, start, end in zip(signals.runs, (0, 0, 9), (9.999, 7.999, 20.999), strict=True):
        assert signals.t[run.start] - start == pytest.approx(0.1, abs=0.005)
        assert end - signals.t[run.stop - 1] == pytest.approx(0.1, abs=0.005)
    assert (signals.dt, signals.every) == (6e-3, 6)


def test_segments_too_short_for_the_filter_are_left_out() -> None:
    t = np.arange(10_000) / 1000
    t[9800:] += 1.0
    q, _, _, tau = Motion().at(t)
    signals = prepare([log_of(t, q, tau, breaks=(9800,))], cutoff_hz=5.0)
    assert len(signals.runs) == 1
    assert any("1 segment shorter than 1 s left out" in note for note in signals.notes)
    with pytest.raises(StictionError, match=r"made up: no segment of 50 s without a gap"):
        prepare([log_of(t, q, tau, breaks=(9800,))], cutoff_hz=0.1)


def test_long_logs_get_fewer_rows_and_a_lower_cutoff_and_say_so() -> None:
    log = noisy(1e-5, 0.05)
    thin = prepare([log], cutoff_hz=20.0, most_samples=4000)
    assert thin.dt == pytest.approx(0.01)
    assert len(only(thin).t) <= 4000
    chosen = prepare([log], most_samples=1000)
    assert chosen.cutoff == pytest.approx(1 / (4 * chosen.dt))
    assert any("the cutoff is lowered" in note for note in chosen.notes)


def test_poses_are_static_and_not_filtered() -> None:
    rng = np.random.default_rng(0)
    q, tau = rng.normal(size=(30, N)), rng.normal(size=(30, N))
    poses = log_of(np.arange(30.0), q, tau, static=True)
    alone = prepare([poses])
    assert len(alone.runs) == 30
    assert alone.static.all()
    assert np.array_equal(alone.q, q)
    assert np.array_equal(alone.tau, tau)
    assert not alone.dq.any()
    assert not alone.ddq.any()
    assert np.isnan(alone.cutoff)
    both = prepare([poses, noisy(1e-5, 0.05)])
    assert both.static.tolist() == [True] * 30 + [False] * (len(both.t) - 30)
    assert np.isfinite(both.noise_tau).all()


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        ({"cutoff_hz": 0.0}, "cutoff 0.0 Hz: expected numbers above 0"),
        ({"cutoff_hz": float("nan")}, "cutoff nan Hz"),
        ({"logs": [OTHER, noisy(1e-5, 0.05, seconds=2)]}, "made up: 3 joints, but other has 6"),
    ],
)
def test_bad_arguments(bad: dict, says: str) -> None:
    refusal(lambda: prepare(**{"logs": [noisy(1e-5, 0.05, seconds=2)], **bad}), says)


def test_no_cutoff_is_above_what_new_values_carry() -> None:
    """Held values and gaps carry less than the rows seem to; the note says which it was."""
    log = noisy(1e-6, 1e-3, rate=200.0)
    free = prepare([log])
    assert free.cutoff > 5.0
    held = prepare([dataclasses.replace(log, held=8)])
    assert held.cutoff == pytest.approx(2.5)
    assert "0.1 of the 25 new values a second" in held.notes[0]
    keep = np.ones(len(log.t), bool)
    for start in range(100, len(keep), 300):
        keep[start : start + 16] = False
    rows = {name: getattr(log, name)[keep] for name in ("t", "q", "tau")}
    assert prepare([dataclasses.replace(log, **rows)]).cutoff == pytest.approx(25 / 8.5, rel=0.01)
