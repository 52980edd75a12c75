"""How near arms under position servos come to rest to their goals, with dither and without.

A command moves to its goal smoothly and stays. Where the arm stops differs from the goal by its
sag under gravity, which is where it would rest without friction, and by friction. A sine on the
command shakes the joint; it goes on for ever, or it fades once the command has arrived.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from stiction_envs.control.position_servo import ServoDrive
from stiction_envs.errors import ExperimentError, StictionError
from stiction_envs.experiments.rig import minimum_jerk
from stiction_envs.experiments.settings import experiment_settings
from stiction_envs.experiments.sje.poses import PoseLoads
from stiction_envs.friction.model import StickingModel, build
from stiction_envs.friction.parameters import load_friction
from stiction_envs.friction.servos import PositionServos
from stiction_envs.plant import CONTROL_DT, SLOW_STEPS, Plant
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
_DRAWN = 256  # poses drawn at once; assumed
_DRAWS = 200  # draws before a user hears that hardly any pose is free; assumed


@dataclass(frozen=True, kw_only=True, eq=False)
class Moves:
    """N moves of a command from rest at one pose to a goal."""

    start: Array
    """(N, n) where arms rest before [rad]."""
    goal: Array
    """(N, n) [rad]."""
    past: Array
    """(N, n) by how much the command goes past the goal [rad]; 0 for none."""
    amplitude: Array
    """(N, n) of the sine on the command [rad]."""
    frequency: Array
    """(N,) of the sine [Hz]."""
    phase: Array
    """(N, n) of the sine [rad]."""
    fades: NDArray[np.bool_]
    """(N,) whether the sine fades after the move."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rest:
    """Where N arms came to rest."""

    error: Array
    """(N, n) mean angle minus goal [rad]."""
    sag: Array
    """(N, n) the error of an arm without friction that is told the goal [rad]."""
    shaking: Array
    """(N, n) root mean square angle about its mean [rad]."""
    tip_speed: Array
    """(N,) root mean square speed of the flange [m/s]."""

    @property
    def friction_error(self) -> Array:
        """(N, n) the part of the error that friction makes [rad]."""
        return self.error - self.sag


def random_poses(arm: Arm, count: int, seed: int) -> Array:
    """Return (count, n) poses [rad] inside the joint limits, off the floor, without collision.

    Raises:
        StictionError: hardly any pose is.
    """
    s, rng = experiment_settings(), np.random.default_rng([seed, 28])
    low, high = arm.limits.position[:, 0] + s.reach.margin, arm.limits.position[:, 1]
    high = np.maximum(high - s.reach.margin, low)
    # friction plays no part here
    loads = PoseLoads(build(arm, load_friction("generic", arm.n).rigid()), s.poses)
    found, tried = np.empty((0, arm.n)), 0
    while len(found) < count:
        drawn = rng.uniform(low, high, (_DRAWN, arm.n))
        found, tried = np.concatenate([found, drawn[loads(drawn)[1]]]), tried + _DRAWN
        if tried >= _DRAWS * _DRAWN and len(found) < count:
            raise StictionError(
                f"{arm.name}: {len(found)} of {tried} random poses are free of collision: "
                f"expected {count}"
            )
    return found[:count]


def weights(sticking: StickingModel, servos: PositionServos, q: Array) -> tuple[Array, Array]:
    """Return what joints at rest at poses q (N, n) [rad] hold, each (N, n) [N·m].

    Returns:
        The torque that balances the arm, and stiction.
    """
    plant, ids = Plant(sticking, len(q), threads=1), np.arange(len(q))
    plant.reset(ids, q)
    return ServoDrive(servos, plant).weight(ids), plant.stiction.copy()


def reach(
    sticking: StickingModel,
    servos: PositionServos,
    moves: Moves,
    *,
    hold_steps: int = 1,
    threads: int = 0,
) -> Rest:
    """Return where arms come to rest; every one of its own, whatever the others do.

    Args:
        sticking: a model under these servos (`put_under_servos`).
        servos: that drive it.
        moves: N of them.
        hold_steps: control steps of 1 ms for which a command is held.
        threads: threads, 0 for all processors.

    Raises:
        ExperimentError: an arm that its servos cannot hold.
    """
    s, n = experiment_settings().reach, len(moves.goal)
    plant, ids = Plant(sticking, n, threads=threads), np.arange(n)
    drive = ServoDrive(servos, plant)
    sag = _equilibrium(drive, moves.goal) - moves.goal
    plant.reset(ids, moves.start)
    first = moves.start + drive.weight(ids) / servos.stiffness
    drive.reset(ids, first)
    shaken = s.move_time + s.shaken_time
    length = shaken + s.fade_time + s.still_time + s.watched_time
    steps, watched = round(length / CONTROL_DT), round(s.watched_time / CONTROL_DT)
    last = np.empty((n, watched, sticking.n))
    for k in range(0, steps, SLOW_STEPS):
        tick = (np.arange(k, min(k + SLOW_STEPS, steps)) // hold_steps) * hold_steps
        time = tick * CONTROL_DT
        x = minimum_jerk(time / s.move_time)[None, :, None]
        command = (1.0 - x) * first[:, None] + x * (moves.goal + moves.past)[:, None]
        size = np.where(
            moves.fades[:, None], np.clip(1.0 - (time - shaken) / s.fade_time, 0.0, 1.0), 1.0
        )
        angle = 2 * np.pi * moves.frequency[:, None] * time
        wave = np.sin(angle[:, :, None] + moves.phase[:, None])
        command += size[:, :, None] * moves.amplitude[:, None] * wave
        q = drive.run(command, ids)
        into = k - (steps - watched)
        if into + len(tick) > 0:
            last[:, max(into, 0) : into + len(tick)] = q[:, max(-into, 0) :]
    mean = last.mean(axis=1)
    speed = np.diff(last, axis=1) / CONTROL_DT
    return Rest(
        error=mean - moves.goal,
        sag=sag,
        shaking=np.sqrt(((last - mean[:, None]) ** 2).mean(axis=1)),
        tip_speed=_tip_speed(sticking, mean, speed),
    )


def _equilibrium(drive: ServoDrive, command: Array) -> Array:
    """Return (N, n) where arms without friction rest under a command (N, n) [rad].

    Raises:
        ExperimentError: gravity pulls harder than the servos hold.
    """
    s, ids = experiment_settings().reach, np.arange(len(command))
    low, high = drive.plant.sticking.arm.limits.position.T
    stiffness, limit = drive.servos.stiffness, drive.servos.torque_limit
    q = np.clip(command, low, high)
    for _ in range(s.equilibrium_rounds):
        drive.plant.reset(ids, q)
        weight = drive.weight(ids)
        now = np.clip(command - weight / stiffness, low, high)
        change, q = np.abs(now - q), now
        if change.max() < s.equilibrium_tolerance:
            break
    wrong = (change >= s.equilibrium_tolerance) | (np.abs(weight) >= limit)
    if wrong.any():
        i, j = np.argwhere(wrong)[0]
        raise ExperimentError(
            f"joint {j + 1} cannot be held at {np.round(command[i], 3).tolist()} rad: gravity "
            f"pulls with {abs(weight[i, j]):.3g} N·m, its servo holds {limit[j]:.3g} N·m with "
            f"{stiffness[j]:.3g} N·m/rad"
        )
    return q


def _tip_speed(sticking: StickingModel, q: Array, speed: Array) -> Array:
    """Return (N,) the RMS speed [m/s] of the flange at poses q (N, n), of speeds (N, K, n)."""
    model, out = sticking.model, np.empty(len(q))
    data, site = mujoco.MjData(model), model.site(sticking.arm.end_effector).id
    jacobian = np.zeros((3, model.nv))
    for i in range(len(q)):
        data.qpos[sticking.motor] = q[i]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_jacSite(model, data, jacobian, None, site)
        v = speed[i] @ jacobian[:, sticking.motor].T
        out[i] = np.sqrt((v * v).sum(axis=1).mean())
    return out
