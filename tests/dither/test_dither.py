import numpy as np
import pytest

from stiction_envs.dither.dither import Dither, check_frequency
from stiction_envs.dither.waveforms import BANDWIDTH, WAVEFORMS
from stiction_envs.dither.waveforms import SWEEP_CYCLES as CYCLES
from tests.refusal import refusal

F = 8.0  # Hz: 8 s hold 64 cycles, the period of chirp and random
PERIOD = CYCLES / F
SAMPLES = 2**15
NAMES = np.array(list(WAVEFORMS))


def one(waveform: str = "sine", **kwargs: object) -> Dither:
    fields: dict[str, object] = {"amplitude": [[1.0]], "frequency": F, "waveform": waveform}
    return Dither(**(fields | kwargs))  # type: ignore[arg-type]


def some_of(dither: Dither, ids: np.ndarray) -> Dither:
    """The dither of some simulations, made anew."""
    names = ("amplitude", "frequency", "phase", "seed", "offset", "gate_velocity")
    fields = {name: getattr(dither, name)[ids] for name in names}
    return Dither(**fields, waveform=NAMES[dither.waveform[ids]])


def series(dither: Dither, t: np.ndarray) -> np.ndarray:
    """Torque [N·m] of the first simulation's first joint at the times ``t`` [s]."""
    rows = 512
    many = some_of(dither, np.zeros(rows, dtype=int))
    padded = np.append(t, np.zeros(-len(t) % rows)).reshape(-1, rows)
    return np.concatenate([many.torque(x)[:, 0] for x in padded])[: len(t)]


def period(dither: Dither) -> tuple[np.ndarray, np.ndarray]:
    """One common period (64 cycles) and its line amplitudes, index = frequency in f/64."""
    # Half a sample aside, so that no sample falls on an edge of the square.
    w = series(dither, (np.arange(SAMPLES) + 0.5) * PERIOD / SAMPLES)
    return w, 2 * np.abs(np.fft.rfft(w)) / SAMPLES


def mixed(N: int, n: int = 7, seed: int = 0, **kwargs: object) -> Dither:
    """All waveforms, amplitudes (some zero), frequencies and phases mixed."""
    rng = np.random.default_rng(seed)
    a = rng.uniform(0.1, 2.0, (N, n)) * (rng.random((N, n)) < 0.7)
    fields: dict[str, object] = {
        "amplitude": a,
        "frequency": rng.uniform(5, 90, (N, n)),
        "phase": rng.uniform(-4, 4, (N, n)),
        "waveform": NAMES[rng.integers(0, len(WAVEFORMS), (N, n))],
        "seed": rng.integers(0, 2**62, N),
    }
    return Dither(**(fields | kwargs))  # type: ignore[arg-type]


def test_sine_is_equation_2_21():
    """d(t) = A sin(2πft), phase added."""
    d = one(amplitude=[[1.7]], frequency=15.0, phase=0.3)
    for t in (0.0, 0.001, 0.37, 12.345):
        assert d.torque(t)[0, 0] == pytest.approx(1.7 * np.sin(2 * np.pi * 15 * t + 0.3), abs=1e-11)
    assert one(frequency=50.0).torque(0.0)[0, 0] == 0.0


@pytest.mark.parametrize("waveform", WAVEFORMS)
def test_zero_mean_and_peak(waveform):
    for phase in (0.0, 1.0, -2.5):
        w, _ = period(one(waveform, phase=phase, seed=5))
        assert abs(w.mean()) < 1e-4 if waveform == "square" else abs(w.mean()) < 1e-9
        assert np.abs(w).max() <= 1.0
        assert np.abs(w).max() > 0.9


@pytest.mark.parametrize(
    ("waveform", "coefficient"),
    [("square", lambda k: 4 / (np.pi * k)), ("triangle", lambda k: 8 / (np.pi * k) ** 2)],
)
def test_square_and_triangle_have_odd_harmonics(waveform, coefficient):
    _, lines = period(one(waveform))
    for k in (1, 3, 5, 7, 9):
        assert lines[k * CYCLES] == pytest.approx(coefficient(k), rel=2e-3)
    for k in (2, 4, 6, 8):
        assert lines[k * CYCLES] < 1e-9


@pytest.mark.parametrize(("waveform", "share"), [("chirp", 0.97), ("random", 1 - 1e-9)])
def test_chirp_and_random_stay_in_band(waveform, share):
    for seed in range(3):
        _, lines = period(one(waveform, seed=seed))
        low, high = int(CYCLES * (1 - BANDWIDTH / 2)), int(np.ceil(CYCLES * (1 + BANDWIDTH / 2)))
        power = lines**2
        inside = power[low : high + 1].sum() / power.sum()
        assert inside > share


def test_chirp_sweeps_up_and_down_linearly():
    """Frequency from zero crossings: f(1 − b/2) at the ends, f(1 + b/2) in the middle."""
    t = np.arange(SAMPLES) * PERIOD / SAMPLES
    w = series(one("chirp"), t)
    up = t[1:][(w[:-1] < 0) & (w[1:] >= 0)]
    f, at = 1 / np.diff(up), (up[1:] + up[:-1]) / 2
    expected = F * (1 + BANDWIDTH * (0.5 - np.abs(2 * at / PERIOD - 1)))
    np.testing.assert_allclose(f, expected, rtol=0.02)


def test_random_has_16_equal_tones_and_follows_its_seed():
    _, lines = period(one("random", seed=3))
    tones = lines[lines > 1e-9]
    assert tones.size == 16
    np.testing.assert_allclose(tones, tones[0], rtol=1e-9)
    again, other = one("random", seed=3), one("random", seed=4)
    assert again.torque(0.3) == one("random", seed=3).torque(0.3)
    assert again.torque(0.3) != other.torque(0.3)
    row = Dither(amplitude=np.ones((1, 7)), frequency=F, waveform="random").torque(0.3)
    assert np.unique(row).size == 7, "joints draw their own tones"


def test_square_edges_on_samples_do_not_flip():
    """50 Hz at 1 kHz has every edge on a sample: ten up, ten down, also on a summed-up clock."""
    d = one("square", frequency=50.0)
    t = np.r_[0.0, np.cumsum(np.full(199_999, 1e-3))]
    w = series(d, t).reshape(-1, 20)
    np.testing.assert_array_equal(w, np.tile(np.r_[np.ones(10), -np.ones(10)], (10_000, 1)))


def test_zero_amplitude_is_exactly_nothing():
    d = Dither.none(3, 7)
    assert repr(d) == "Dither(N=3, n=7, none)"
    out = d.torque(0.123)
    assert out.shape == (3, 7)
    assert not out.any()
    assert not np.signbit(out).any()
    d = mixed(50, offset=0.25)
    off = d.amplitude == 0
    assert off.any()
    assert (d.torque(0.123)[off] == 0.25).all()


def test_torque_is_fresh_and_fields_are_read_only():
    d = mixed(4)
    first = d.torque(0.1)
    first += 1
    assert not np.array_equal(first, d.torque(0.1))
    with pytest.raises(ValueError, match="read-only"):
        d.amplitude[0, 0] = 1.0


def test_gate_limits():
    """Full at rest, A/e at the gate velocity, nothing far above; the offset is never gated."""
    t = 0.01
    free = one(offset=0.3).torque(t)
    d = one(offset=0.3, gate_velocity=0.05)
    assert d.gated
    assert not one().gated
    np.testing.assert_array_equal(d.torque(t, np.zeros((1, 1))), free)
    half = d.torque(t, np.full((1, 1), -0.05))
    assert half[0, 0] == pytest.approx(0.3 + (free[0, 0] - 0.3) / np.e, rel=1e-12)
    assert d.torque(t, np.full((1, 1), 5.0))[0, 0] == 0.3
    speeds = np.linspace(0, 0.3, 50)
    size = [abs(d.torque(t, np.full((1, 1), v))[0, 0] - 0.3) for v in speeds]
    assert (np.diff(size) < 0).all()


@pytest.mark.parametrize("waveform", [*WAVEFORMS, "mixed"])
def test_rows_are_bit_identical_in_every_batch(waveform):
    """A row's bits depend neither on N, nor on its place, nor on what the other rows hold."""
    rng = np.random.default_rng(1)
    kwargs: dict[str, object] = {} if waveform == "mixed" else {"waveform": waveform}
    kwargs["offset"] = rng.normal(size=(64, 7)) * (rng.random((64, 1)) < 0.5)
    kwargs["gate_velocity"] = np.where(rng.random((64, 7)) < 0.5, 0.1, np.inf)
    full = mixed(64, **kwargs)
    qd = rng.normal(size=(64, 7)) * rng.choice([1e-3, 0.1, 10], (64, 7))
    for ids in (np.array([5]), np.arange(13), rng.permutation(64), np.repeat([3, 60], 50)):
        some = some_of(full, ids)
        for t in (0.0, 0.7321, 123.456):
            assert some.torque(t, qd[ids]).tobytes() == full.torque(t, qd)[ids].tobytes()


def test_set_rows():
    a, b = mixed(10, seed=1), mixed(3, seed=2, gate_velocity=0.5, offset=0.1)
    ids = [7, 0, 4]
    c = a.set_rows(ids, b)
    qd = np.zeros((10, 7))
    out, before = c.torque(0.2, qd), a.torque(0.2)
    np.testing.assert_array_equal(out[ids], b.torque(0.2, qd[:3]))
    rest = np.setdiff1d(np.arange(10), ids)
    np.testing.assert_array_equal(out[rest], before[rest])
    np.testing.assert_array_equal(a.torque(0.2), before)
    # tones come into a batch that has none, and go again
    a, b = Dither.none(4, 2), Dither(amplitude=[[1, 1]], frequency=9.0, waveform="random", seed=8)
    np.testing.assert_array_equal(a.set_rows([2], b).torque(0.4)[2], b.torque(0.4)[0])
    assert not a.set_rows([2], b).set_rows([2], Dither.none(1, 2)).torque(0.4).any()


@pytest.mark.parametrize("waveform", WAVEFORMS)
@pytest.mark.parametrize("t", [0.0, 0.4321, 3600.0123])
def test_retune_keeps_the_phase(waveform, t):
    d = one(waveform, phase=0.2, seed=4)
    for f in (3.0, 80.0, 15.0):
        new = d.retune(np.array([t]), frequency=np.array([[f]]), amplitude=np.array([[2.0]]))
        assert new.frequency[0, 0] == f
        assert new.torque(t)[0, 0] == pytest.approx(2 * d.torque(t)[0, 0], abs=1e-8)
        # and it runs on at the new frequency
        if waveform in ("sine", "triangle"):
            step = 1e-5
            slope = (new.torque(t + step) - new.torque(t)) / (d.torque(t + step) - d.torque(t))
            assert slope[0, 0] == pytest.approx(2 * f / F, rel=5e-3)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"amplitude": [1.0]}, r"shape \(1,\).*\(N, n\)"),
        ({"amplitude": [[-1.0]]}, "simulation 0, joint 1 is -1.0.*>= 0"),
        ({"amplitude": "a lot"}, "amplitude.*numbers"),
        ({"frequency": 0.0}, "frequency.*> 0 Hz"),
        ({"frequency": [[1.0, 2.0]]}, r"frequency.*\(1, 2\).*\(1, 1\)"),
        ({"phase": np.inf}, "phase.*finite"),
        ({"waveform": "saw"}, "'saw': expected one of sine, square, triangle, chirp, random"),
        ({"gate_velocity": 0.0}, "gate_velocity.*> 0"),
        ({"seed": -1}, "seed is -1.*integers"),
        ({"seed": [1, 2]}, "seed.*shape"),
    ],
)
def test_bad_arguments(kwargs, message):
    refusal(lambda: one(**kwargs), message)


def test_bad_calls():
    d = one(gate_velocity=0.1)
    refusal(lambda: d.torque(0.1), "qd has shape None")
    refusal(lambda: d.torque(0.1, np.zeros((2, 1))), r"qd has shape \(2, 1\)")
    refusal(lambda: d.set_rows([0], mixed(2)), "set_rows")


def test_check_frequency():
    assert check_frequency(99.9, 200) is None
    assert "sits at Nyquist: samples are ±A·sin φ" in str(check_frequency(100, 200))
    assert "aliases to 50 Hz" in str(check_frequency(150, 200))
    assert "aliases to a constant offset" in str(check_frequency(200, 200))
    refusal(lambda: check_frequency(201, 200), "201 Hz at a 200 Hz controller: expected at most")
    for f, rate in ((0, 200), (np.nan, 200), (50, 0), (50, np.inf)):
        refusal(lambda f=f, rate=rate: check_frequency(f, rate), "expected > 0")
