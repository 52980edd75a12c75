"""Compiled functions launched on Warp's device compute what they compute here (extra warp)."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.compiled import compiled
from stiction_envs.control import kernels, trapezoid
from stiction_envs.control.rotation import error_matrix
from stiction_envs.control.trajectory import GoalSequencer, MotionLimits
from stiction_envs.dither.kernels import sine

pytest.importorskip("warp")
from stiction_envs.engines.mirrors import Mirrors

N, n = 9, 7


def normal(*shape: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng([seed, *shape]).normal(size=shape)


def quaternions(seed: int = 0) -> np.ndarray:
    q = normal(N, 4, seed=seed)
    return q / np.linalg.norm(q, axis=1)[:, None]


def arrays(arguments: tuple) -> list[np.ndarray]:
    flat = [y for x in arguments for y in (arrays(x) if isinstance(x, tuple) else [x])]
    return [x for x in flat if isinstance(x, np.ndarray)]


def apart(function, *arguments) -> float:
    """Launch and call; return the largest difference of all arrays, relative to 1 or their size."""
    mirrors = Mirrors(N)
    mirrors.launch(function, *arguments)
    before = [x.copy() for x in arrays(arguments)]
    function(*arguments)
    assert any(not np.array_equal(a, b) for a, b in zip(before, arrays(arguments), strict=True))
    worst = 0.0
    for here in arrays(arguments):
        there = mirrors.of(here).numpy()
        assert there.shape == here.shape
        np.testing.assert_array_equal(np.isfinite(there), np.isfinite(here))
        good = np.isfinite(here)
        difference = np.abs(there[good].astype(float) - here[good])
        worst = max(worst, float((difference / np.maximum(1.0, np.abs(here[good]))).max(initial=0)))
    return worst


TIGHT = 1e-13
"""A processor may round a product and a sum at once."""


def impedance(*, null: bool, dither_after: bool, rate: float = 1.0) -> tuple:
    """Arguments of `kernels.impedance_cycle`."""
    reference = error_matrix(quaternions(1))
    return (
        *(normal(N, 3), quaternions(), normal(N, 6, n), normal(N, n), normal(N, n, seed=2)),
        *(normal(N, n, seed=3), dither_after, rate, np.full(n, 5.0), normal(N, 3, seed=4)),
        *(reference, normal(N, 6, 12), null, normal(N, n, seed=5), np.abs(normal(N, n, seed=6))),
        *(np.abs(normal(N, n, seed=7)), normal(N, n, n), np.zeros((N, 12))),
        *(np.zeros((N, n)), np.zeros((N, n)), normal(N, n, seed=8), np.zeros((N, n))),
    )


@pytest.mark.parametrize("dither_after", [False, True])
@pytest.mark.parametrize("null", [False, True])
def test_impedance_control(null, dither_after):
    """Every term: spring, damping, nullspace, dither on either side of the saturation, limits."""
    assert apart(kernels.impedance_cycle, *impedance(null=null, dither_after=dither_after)) < TIGHT


def test_impedance_control_of_what_is_not_a_number_and_of_half_a_turn():
    arguments = impedance(null=True, dither_after=False, rate=np.inf)
    arguments[3][0, 2] = np.nan
    arguments[1][1] = quaternions(1)[1]  # no error
    arguments[1][2] = -quaternions(1)[2]
    arguments[1][3] = quaternions(1)[3][[1, 0, 3, 2]] * [-1, 1, 1, -1]  # half a turn
    assert apart(kernels.impedance_cycle, *arguments) < TIGHT


@pytest.mark.parametrize("gain", [1.0, 0.3])
def test_torque_path(gain):
    states = normal(N, n, seed=1), normal(N, n, seed=2)
    given = (2 * normal(N, n), np.full((N, n), 0.5), gain, np.full((N, n), 1.2), *states)
    assert apart(kernels.pass_torque, *given, np.zeros((N, n))) < TIGHT


def test_pose_and_jacobian():
    moved = normal(N, 11, 3), normal(N, 11, 3, seed=1), normal(N, 3), quaternions()
    fixed = np.arange(1, n + 1), normal(4, 4), normal(3)
    written = np.zeros((N, 3)), np.zeros((N, 4)), np.zeros((N, 6, n))
    assert apart(kernels.site_kinematics, *moved, *fixed, *written) < TIGHT


@pytest.mark.parametrize("step", [1.0, 0.2])
def test_filter_of_the_reference(step):
    target, now = (normal(N, 3), quaternions()), (normal(N, 3, seed=1), quaternions(1))
    now[1][0] = -target[1][0]
    arguments = step, *target, *now, np.zeros((N, 4, 4))
    assert apart(kernels.advance_reference, *arguments) < TIGHT
    if step == 1.0:
        assert now[0].tobytes() == target[0].tobytes()
        assert now[1].tobytes() == target[1].tobytes()


def test_sine():
    amplitude = np.abs(normal(N, n)) * (normal(N, n, seed=1) > 0)
    time = np.linspace(0.0, 40.0, N)
    omega, phase = 2 * np.pi * np.abs(100 * normal(N, n, seed=2)), normal(N, n, seed=3)
    assert apart(sine, omega, phase, amplitude, time, np.full((N, n), np.nan)) < 1e-11


def sequencer(**limits) -> GoalSequencer:
    """Arms on their way to goals near and far, some of which turn and some of which do not."""
    out = GoalSequencer(N, MotionLimits(**limits), 3)
    goals, turns = 0.3 * normal(N, 3, 3), np.repeat(quaternions()[:, None], 3, axis=1)
    turns[:, 1], goals[1, 1] = quaternions(2), goals[1, 0]
    begin = np.linspace(0.0, 1.0, N)
    start = goals[:, 0] + 0.1 * normal(N, 3, seed=4), quaternions(3)
    out.start(None, goals, turns, *start, begin, np.linspace(0.5, 1.0, N))
    return out


@pytest.mark.parametrize("limits", [{}, {"synchronised": False, "patience": np.inf}], ids=str)
def test_goals_and_reference(limits):
    s = sequencer(**limits)
    written = [np.zeros((N, k)) for k in (3, 4, 3, 2)]
    for now in (0.0, 0.7, 1.9, 2.4, 3.0, 5.0, 9.0, 20.0, 30.0, 40.0, 60.0):
        begun = s.arguments[2][2]
        profile, segment = s.arguments[3:]
        sampled = now - begun, profile, segment, *written
        assert apart(trapezoid.write_sample, *sampled) < TIGHT
        near = written[0] + 0.02 * normal(N, 3, seed=5), written[1].copy()
        accepted, index = np.ones(N, dtype=bool), s.index
        arguments = *near, np.full(N, now), *s.arguments, accepted
        assert apart(trapezoid.accept, *arguments) < TIGHT
        assert np.array_equal(accepted, (s.index != index) & ~s.finished)
    assert s.finished.sum() >= N - 2
    assert np.isfinite(s.reached_at).sum() > 2 * N


@compiled
def swapped(a: np.ndarray, b: np.ndarray, flags: np.ndarray, counts: np.ndarray) -> None:
    """What the functions above do not do all of."""
    for i in range(len(a)):
        x, y = a[i, 0], a[i, 1]
        x, y = y, x
        a[i, 0] = a[i, 1] = x
        b[i] -= y**2
        if not x > 0.5:
            counts[i] += 2
            flags[i] = True
            continue
        for k in range(a.shape[1]):
            if k == 1:
                continue
            a[i, k] *= -1.5e300 * 1e-300
        counts[i] = -1


def test_words_that_have_to_be_put_in_others():
    flags, counts = np.zeros(N, dtype=bool), np.arange(N)
    assert apart(swapped, normal(N, 3), normal(N), flags, counts) < TIGHT
    assert 0 < flags.sum() < N
