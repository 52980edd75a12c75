"""Motions for the blind tests, as a person would record them, in random variants."""

from collections.abc import Callable

import numpy as np
from scipy.ndimage import uniform_filter1d

from stiction_envs.arrays import Array
from stiction_envs.hidden.worlds import CENTRE, REACH

Motion = Callable[[np.random.Generator, Array], Array]


def fade(t: Array) -> Array:
    """Return a factor that rises from 0 to 1 in the first second."""
    x = np.clip(t, 0, 1)
    return np.asarray(x**3 * (10 - 15 * x + 6 * x * x))


def rest_to_rest(t: Array, at: Array, poses: Array, seconds: float) -> Array:
    """Return fifth-order polynomials: to ``poses[i + 1]`` from time ``at[i]``."""
    out = np.tile(poses[0], (len(t), 1))
    for i, start in enumerate(at):
        x = np.clip((t - start) / seconds, 0, 1)[:, None]
        out += (poses[i + 1] - poses[i]) * x**3 * (10 - 15 * x + 6 * x * x)
    return out


def centre(rng: np.random.Generator) -> Array:
    """Return (7,) angles about which a motion swings [rad]."""
    return CENTRE + rng.uniform(-0.3, 0.3, 7)


def _series(rng: np.random.Generator, t: Array, harmonics: int, speed: float) -> Array:
    k = np.arange(1, harmonics + 1)
    a = rng.normal(size=(harmonics, 7)) / np.sqrt(k)[:, None]
    b = rng.normal(size=(harmonics, 7)) / np.sqrt(k)[:, None]
    w = 2 * np.pi * 0.08 * rng.uniform(0.9, 1.1) * k
    x = np.sin(np.outer(t, w)) @ (a / k[:, None]) + np.cos(np.outer(t, w)) @ (b / k[:, None])
    v = np.gradient(x, t[1] - t[0], axis=0)
    scale = np.minimum(REACH / np.abs(x).max(axis=0), speed / np.abs(v).max(axis=0))
    return np.asarray(x * scale * rng.uniform(0.7, 1.0, 7))


def fourier(rng: np.random.Generator, t: Array) -> Array:
    """Return Fourier series of all joints, up to about 0.5 Hz."""
    return np.asarray(centre(rng) + fade(t)[:, None] * _series(rng, t, 6, 1.2))


def fast(rng: np.random.Generator, t: Array) -> Array:
    """Return Fourier series up to about 1.5 Hz."""
    return np.asarray(centre(rng) + fade(t)[:, None] * _series(rng, t, 18, 1.5))


def chirp(rng: np.random.Generator, t: Array) -> Array:
    """Return chirps of 0.4 to 4 Hz, the joints at different times, on a slow series."""
    x = centre(rng) + fade(t)[:, None] * _series(rng, t, 3, 0.5)
    for j in range(7):
        period = rng.uniform(6, 9)
        f = 0.4 * 10 ** (0.5 - 0.5 * np.cos(2 * np.pi * (t / period + rng.uniform())))
        w = 2 * np.pi * f
        phase = np.cumsum(w) * (t[1] - t[0])
        x[:, j] += fade(t) * np.minimum(0.6 / w, 6.0 / w**2) * np.sin(phase)
    return np.asarray(x)


def reversals(rng: np.random.Generator, t: Array) -> Array:
    """Return slow reversals of all joints, 2 to 80 mrad, about changing poses."""
    count = int(t[-1] // 6)
    poses = CENTRE + rng.uniform(-0.8, 0.8, (count + 1, 7)) * REACH
    at = 6.0 * np.arange(count) + 5.0
    x = rest_to_rest(t, np.asarray(at, np.float64), poses, 1.0)
    step = t[1] - t[0]
    for j in range(7):
        way = np.zeros_like(t)
        now, k, side = 0.0, 0, 1.0
        while k < len(t):
            length = np.exp(rng.uniform(np.log(0.004), np.log(0.15)))
            speed = np.clip(length / rng.uniform(0.4, 1.2), 0.01, 0.25)
            rows = min(int(length / speed / step) + 1, len(t) - k)
            goal = side * length / 2
            way[k : k + rows] = now + (goal - now) * np.arange(1, rows + 1) / rows
            now, k, side = goal, k + rows, -side
        x[:, j] += uniform_filter1d(way, int(0.1 / step), mode="nearest") * fade(t)
    return np.asarray(x)


def _sweeps(rng: np.random.Generator, t: Array, settle: bool) -> Array:
    step = t[1] - t[0]
    x = np.tile(centre(rng), (len(t), 1))
    for j in range(7):
        v, extra = np.zeros_like(t), np.zeros_like(t)
        k, place = int(rng.uniform(0.2, 1.0) / step), 0.0
        while k < len(t):
            speed = np.exp(rng.uniform(np.log(0.015), np.log(0.8)))
            span = min(speed * rng.uniform(1.0, 2.0), 1.2 * REACH[j])
            side = -1.0 if place > 0 else 1.0
            rows = int(span / speed / step)
            v[k : k + rows] = side * speed
            place += side * span
            k += rows + int(0.25 / step)
            if settle:
                s = np.arange(0, 0.9, step)
                s = s[: max(0, len(t) - k)]
                extra[k : k + len(s)] = 4e-3 * (1 - s / 0.9) * np.sin(2 * np.pi * 3.3 * s)
                k += len(s)
            k += int(rng.uniform(0.3, 0.9) / step)
        v = uniform_filter1d(uniform_filter1d(v, int(0.12 / step)), int(0.12 / step))
        x[:, j] += np.cumsum(v) * step + extra
    return x


def sweeps(rng: np.random.Generator, t: Array) -> Array:
    """Return constant speeds of 15 mrad/s to 0.8 rad/s there and back, with short rests."""
    return _sweeps(rng, t, settle=False)


def rests(rng: np.random.Generator, t: Array) -> Array:
    """Return sweeps whose rests begin with a decaying wiggle of 4 mrad, which relaxes friction."""
    return _sweeps(rng, t, settle=True)


def poses(rng: np.random.Generator, t: Array) -> Array:
    """Return poses all over the range, and slow transits between them."""
    count = int(t[-1] // 2.4)
    where = CENTRE + rng.uniform(-1, 1, (count + 1, 7)) * REACH
    return rest_to_rest(t, np.asarray(2.4 * np.arange(count) + 0.8), where, 1.6)


def still(rng: np.random.Generator, t: Array) -> Array:
    """Return a motion without movement."""
    return np.tile(centre(rng), (len(t), 1))


def one_way(rng: np.random.Generator, t: Array) -> Array:
    """Return a motion of every joint in one direction, at changing speeds."""
    side, v = rng.choice([-1.0, 1.0], 7), np.zeros((len(t), 7))
    for j in range(7):
        f = rng.uniform(0.08, 0.25, 3)
        v[:, j] = 1.1 + np.sin(2 * np.pi * np.outer(t, f) + rng.uniform(0, 6, 3)).mean(axis=1)
    way = np.cumsum(v * fade(t)[:, None], axis=0)
    return np.asarray(CENTRE + REACH * side * (2 * way / way[-1] - 1))


MOTIONS: dict[str, Motion] = {
    f.__name__: f for f in (fourier, fast, chirp, reversals, sweeps, rests, poses)
}
"""Motions that a person would record."""
BLIND_MOTIONS: dict[str, Motion] = {f.__name__: f for f in (still, one_way)}
"""Motions that cannot show everything."""
