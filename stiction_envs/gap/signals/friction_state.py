"""Dry friction of the nominal model along a recording, and the noise floor of what it leaves.

The noise floor is the part of a residual that no cause can explain: noise above the band and in its
upper half, where there is no motion. Slower noise cannot be distinguished from the model's error.

A joint at rest can hold any torque inside its friction band. Repeated poses show the scatter: equal
poses differ only by noise and friction.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from stiction_envs.arrays import Array
from stiction_envs.filters import spectrum
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.signals.bristle import bristles
from stiction_envs.gap.signals.recording import Recording

PRESLIDING_DISTANCE = 2e-4
"""Presliding distance of dry friction [rad]; assumed: 0.5 N·m on 2500 N·m/rad."""
PRESLIDING_DISTANCES = (2e-6, 2e-5, 6e-5, 2e-4, 6e-4)
"""Presliding distances, of which each joint's torque at reversals chooses one [rad]; assumed."""
FALLING_SPEED = 0.1
"""Speed scale with which friction may fall in the fit of presliding distances [rad/s]; assumed."""

LEAST_NOISE = 1e-4
"""Least noise that is assumed [N·m], so that perfect data do not divide by zero; assumed."""
SAME_POSE = 0.03
"""Distance over all joints below which poses are equal [rad]; assumed: 0.2 N·m of gravity in
7 N·m/rad, before the model is subtracted."""
LEAST_PAIRS = 10
"""Least number of pairs of equal poses for an estimate of their scatter [-]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FrictionState:
    """Each joint's dry friction before the search for causes; (n,) each."""

    presliding_distance: Array
    """Presliding distance of plain dry friction [rad]."""
    level: Array
    """Dry friction of the nominal model in motion, mean of both directions [N·m]."""
    bristle_lead_time: Array
    """σ1/σ0 of plain dry friction, the lead time of damped bristles; 0 if unknown [s]."""
    rotor: Array
    """Rotor inertia that the nominal model has [kg·m²]."""
    in_nominal: bool
    """Whether the nominal model has friction, so that it may also have too much."""

    @classmethod
    def of(cls, friction: FrictionParameters) -> "FrictionState":
        """Return the state for a nominal model with friction."""
        # the bristles' own damping, σ1 = 2ζ√(σ0 J) of the rotor, leads at reversals
        rotor, stiffness = friction.rotor_inertia, friction.bristle_stiffness
        return cls(
            presliding_distance=friction.stiction.mean(axis=-1) / friction.bristle_stiffness,
            level=(friction.stiction * friction.coulomb_ratio).mean(axis=-1),
            bristle_lead_time=2 * friction.bristle_damping_ratio * np.sqrt(rotor / stiffness),
            rotor=rotor,
            in_nominal=True,
        )

    @classmethod
    def unknown(cls, recording: Recording) -> "FrictionState":
        """Return the state for an arm without friction; its file may state rotors."""
        none = np.zeros(recording.n)
        in_front = recording.torque == "motor"  # behind the gear no rotor is seen
        return cls(
            presliding_distance=presliding_distances(recording, recording.tau - recording.rigid),
            level=none,
            bristle_lead_time=none,
            rotor=recording.arm.stated.armature * in_front,
            in_nominal=False,
        )


def friction_torque(
    recording: Recording, friction: FrictionParameters, state: FrictionState
) -> Array:
    """Return (T, n) torque of a nominal friction along a recording, filtered like it [N·m].

    The torque is our friction in steady sliding, with the direction of bristles, warm-up since the
    session began, ripple, rotor inertia (seen in front of the gear) and offset.
    """
    path = recording.reversal_path
    direction = recording.bristles(state.presliding_distance[:, None])[..., 0]
    direction = direction + state.bristle_lead_time * recording.path_rate(direction)
    speed = recording.path_rate(path)
    level = friction.stiction_at(np.abs(recording.along_path(recording.gravity)))
    stiction, ratio, stribeck = (
        _of_side(x, speed, level.shape)
        for x in (level, friction.coulomb_ratio, friction.stribeck_velocity)
    )
    g = stiction * (ratio + (1.0 - ratio) * np.exp(-np.square(speed / stribeck)))
    since = recording.since_session[:, None]
    warm = 1.0 + friction.warm_up_friction * np.exp(-since / friction.warm_up_time)
    level = direction * g * recording.along_path(warm)
    angle = friction.ripple_periods * path + friction.ripple_phase
    uneven = recording.smooth(level - friction.ripple_amplitude * np.sin(angle))
    # what follows is smooth, and the signals have passed the filter
    dq = recording.dq
    viscous = _of_side(friction.viscous, dq, (*dq.shape, 2))
    warm = 1.0 + friction.warm_up_viscous * np.exp(-since / friction.warm_up_time)
    clipped = np.clip(recording.gravity, -friction.load_high, friction.load_high)
    return np.asarray(
        uneven
        + viscous * warm * dq
        + (recording.torque == "motor") * friction.rotor_inertia * recording.ddq
        + friction.offset
        + friction.gravity_error * clipped
    )


def _of_side(x: Array, speed: Array, shape: tuple[int, ...]) -> Array:
    """Return (..., n) values of two directions (..., n, 2) for the sign of a speed (..., n)."""
    side = (speed < 0).astype(int)[..., None]
    return np.take_along_axis(np.broadcast_to(x, shape), side, axis=-1)[..., 0]


def presliding_distances(recording: Recording, residual: Array) -> Array:
    """Return (n,) the presliding distances with which friction explains most of a residual [rad].

    They delay the sign change of friction by some milliseconds, which affects other causes. The
    residual (T, n) is measured less nominal torque [N·m].
    """
    dq, ddq, runs = recording.dq, recording.ddq, recording.path_runs
    out, distances = np.empty(recording.n), np.array([PRESLIDING_DISTANCES])
    for j in range(recording.n):
        path = recording.reversal_path[:, [j]]
        zeta = recording.smooth(bristles(path, runs, distances)[:, 0])
        falls = np.exp(-np.abs(dq[:, j]) / FALLING_SPEED)
        common = np.stack([dq[:, j], ddq[:, j], np.ones(len(dq))], axis=1)
        left = []
        for k in range(len(PRESLIDING_DISTANCES)):
            # friction's fall with speed may show apart from when it turns
            x = np.column_stack([common, zeta[:, k], zeta[:, k] * falls])
            r = residual[:, j]
            xx = x.T @ x
            c = np.linalg.lstsq(xx, x.T @ r, rcond=None)[0]
            left.append(float(np.sum(np.square(r - x @ c))))
        out[j] = PRESLIDING_DISTANCES[int(np.argmin(left))]
    return out


def noise_floor(recording: Recording, residual: Array) -> Array:
    """Return (n,) noise of a residual (T, n), measured less nominal torque [N·m]."""
    moving = np.all(np.isfinite(recording.noise_tau))
    return _floor(recording, residual) if moving else _scatter(recording.q, residual)


def _scatter(q: Array, residual: Array) -> Array:
    """Return (n,) scatter of a residual (T, n) between poses (T, n) that are equal [N·m]."""
    least = np.full(q.shape[1], LEAST_NOISE)
    if len(q) < 2:
        return least
    distance, nearest = cKDTree(q).query(q, k=2)
    first = np.flatnonzero(distance[:, 1] < SAME_POSE)
    pairs = np.unique(np.sort(np.stack([first, nearest[first, 1]], axis=1), axis=1), axis=0)
    if len(pairs) < LEAST_PAIRS:
        return least
    difference = residual[pairs[:, 0]] - residual[pairs[:, 1]]
    return np.asarray(np.sqrt(np.mean(np.square(difference), axis=0) / 2) + least)


def _floor(recording: Recording, residual: Array) -> Array:
    """Return (n,) noise of the residual along a motion [N·m]: of torque and acceleration.

    The acceleration's noise grows with frequency: the upper half of the filter's band contains all
    of it and half of the torque's. Medians over windows ignore the few that contain a jump of
    friction.
    """
    q, dq, ddq, runs = recording.q, recording.dq, recording.ddq, recording.runs
    torque = np.maximum(recording.noise_tau, LEAST_NOISE)
    distances = np.full((q.shape[1], 1), PRESLIDING_DISTANCE)
    direction = recording.smooth(recording.bristles(distances)[..., 0])
    longest = max(runs, key=lambda r: r.stop - r.start)
    window = int(min(longest.stop - longest.start, max(32, 1.0 / recording.dt)))
    out = torque.copy()
    for j in range(q.shape[1]):
        x = np.stack([direction[:, j], dq[:, j], ddq[:, j], np.ones(len(q))], axis=1)
        left = residual[:, j] - x @ np.linalg.lstsq(x, residual[:, j], rcond=None)[0]
        f, power = spectrum(left[longest], 1 / recording.dt, window, padded=8, median=True)
        high = (f > 0.5 * recording.cutoff) & (f < 1.5 * recording.cutoff)
        upper = float(power[high].sum() * f[1])
        out[j] = np.sqrt(upper + min(0.5 * torque[j] ** 2, upper)) + LEAST_NOISE
    return out
