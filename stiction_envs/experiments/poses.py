"""The *load* and *no load* pose of each joint, found by search.

The thesis (3.2) moved the arm by hand and read the sensed torques: the load pose has the largest
|torque| on the joint, the no-load pose the one closest to zero. Here the same quantity is searched
(`friction.load_sensor`): the gravity torque, or for a joint that never sees one (joint 1 of an
upright arm) the tilting moment on its bearing.
"""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch

from stiction_envs.arrays import Array, Bools
from stiction_envs.errors import StictionError
from stiction_envs.friction.load_sensor import load_sensor, read_loads
from stiction_envs.friction.model import StickingModel, build
from stiction_envs.friction.parameters import load_friction
from stiction_envs.precomputed import store
from stiction_envs.robots import Arm

_TOGETHER = 1024  # poses computed at once; assumed
SWING = 0.15  # The experiment moves the joint this far each way [rad]; thesis 3.2
MARGIN = 0.3
"""Distance of the joint under test from its limits [rad]; assumed: swing, start tolerance,
overshoot."""
OTHERS_MARGIN = 0.1  # Distance of the other joints from their limits [rad]; assumed
FLOOR = 0.05  # Least height of the outer links of an upright arm over its base plane [m]; assumed
REST_PULL = 0.02
"""Weight of the distance (root mean square, over the range) from the rest pose [N·m]; assumed."""
SAMPLES, KEPT, ROUNDS = 2048, 64, 14
"""Random poses at the beginning, best poses that each round keeps, and rounds [-]; assumed."""
FIRST_STEP, SHRINK = 0.2, 0.7
"""Standard deviation of the first round's steps over the range, and its factor from round to round
[-]; assumed."""
_METHOD = SWING, MARGIN, OTHERS_MARGIN, FLOOR, REST_PULL, SAMPLES, KEPT, ROUNDS, FIRST_STEP, SHRINK


@dataclass(frozen=True, kw_only=True)
class Poses:
    """Poses and loads of all joints."""

    q: Array  # (n, 2, n) pose for joint [first axis] under [load, no_load] [rad]
    signed: Array  # (n, 2) signed load of the joint there [N·m]
    load: Array  # (n, 2) absolute load there [N·m]
    bearing: Bools  # (n,) joints whose load is their bearing's tilting moment


class PoseLoads:
    """Loads and validity of many poses at once, on the rigid arm with contacts."""

    def __init__(self, sticking: StickingModel) -> None:
        self.arm = sticking.arm
        model = copy.copy(sticking.model)
        # contacts on: they show self-collision
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self.batch = Batch(model, _TOGETHER)
        self.sticking = sticking
        self.sensor = load_sensor(sticking, self.batch)
        self.floor = self.arm.on_floor and self.arm.tilt == (0.0, 0.0)

    def __call__(self, q: Array) -> tuple[Array, Bools]:
        """Return signed loads (M, n) [N·m] and validity (M,) of poses q (M, n) [rad]."""
        signed, valid = np.empty_like(q), np.empty(len(q), dtype=bool)
        for start in range(0, len(q), self.batch.nsim):
            part = q[start : start + self.batch.nsim]
            ids = np.arange(len(part))
            qpos = np.zeros((len(part), self.sticking.model.nq))
            qpos[:, self.sticking.motor] = part
            self.batch.bind("qpos")[ids] = qpos
            contacts, height = self.batch.bind("ncon"), self.batch.bind("xpos")
            self.batch.forward(ids)
            signed[start : start + len(part)] = read_loads(ids, self.sensor)
            ok = contacts[ids].reshape(len(part)) == 0
            if self.floor:
                ok &= height[ids][:, 4:, 2].min(axis=1) > FLOOR
            valid[start : start + len(part)] = ok
        return signed, valid


def fingerprint(arm: Arm) -> str:
    """Return a hash of everything that an arm's poses depend on."""
    return store.digest(arm.fingerprint, _METHOD)


def find_poses(arm: Arm) -> Poses:
    """Return the load and no-load poses of an arm; the search has a fixed seed.

    Raise a StictionError where no pose within the joint limits is free of self-collision.
    """
    key = fingerprint(arm)
    found = store.recall("poses", key).get("poses")
    if found is None:
        # friction plays no part here; the rigid model is only asked for gravity and contacts
        sticking = build(arm, load_friction("generic", arm.n).rigid())
        evaluate = PoseLoads(sticking)
        q, signed = np.empty((arm.n, 2, arm.n)), np.empty((arm.n, 2))
        for joint in range(arm.n):
            for k in range(2):
                q[joint, k] = _search(evaluate, joint, largest=k == 0)
                signed[joint, k] = evaluate(q[joint, k][None])[0][0, joint]
        found = {"q": q.tolist(), "signed": signed.tolist(), "bearing": sticking.bearing.tolist()}
        store.keep("poses", key, {"poses": found})
    signed = np.array(found["signed"])
    return Poses(
        q=np.array(found["q"]),
        signed=signed,
        load=np.abs(signed),
        bearing=np.array(found["bearing"]),
    )


def _search(evaluate: PoseLoads, joint: int, *, largest: bool) -> Array:
    """Search at random, then by shrinking random steps around the best poses."""
    arm = evaluate.arm
    rng = np.random.default_rng([joint, int(largest)])
    margin = np.where(np.arange(arm.n) == joint, MARGIN, OTHERS_MARGIN)
    low, high = arm.limits.position[:, 0] + margin, arm.limits.position[:, 1] - margin
    span = high - low
    if (span <= 0).any():
        j = int(np.argmin(span))
        raise StictionError(
            f"{arm.name}: joint {j + 1} has a range of {span[j] + 2 * margin[j]:.3f} rad, the "
            f"experiment needs more than {2 * margin[j]:.1f} rad"
        )

    def cost(q: Array) -> Array:
        """Return minus the load (or the largest within the swing) plus a pull to the rest pose."""
        values = np.zeros(len(q))
        ok = np.ones(len(q), dtype=bool)
        for shift in (-SWING, 0.0, SWING):
            moved = q.copy()
            moved[:, joint] += shift
            signed, valid = evaluate(moved)
            ok &= valid
            load = np.abs(signed[:, joint])
            if largest and shift == 0.0:
                values = -load
            elif not largest:
                values = np.maximum(values, load)
        away = np.sqrt((((q - arm.rest) / span) ** 2).mean(axis=1))
        return np.where(ok, values + REST_PULL * away, np.inf)

    q = np.concatenate(
        [np.clip(arm.rest, low, high)[None], rng.uniform(low, high, (SAMPLES, arm.n))]
    )
    costs = cost(q)
    scale = FIRST_STEP
    for _ in range(ROUNDS):
        best = np.argsort(costs, kind="stable")[:KEPT]
        q, costs = q[best], costs[best]
        step = rng.normal(size=(4 * KEPT, arm.n)) * scale * span
        new = np.clip(np.tile(q, (4, 1)) + step, low, high)
        q, costs = np.concatenate([q, new]), np.concatenate([costs, cost(new)])
        scale *= SHRINK
    winner = int(np.argmin(costs))
    if not np.isfinite(costs[winner]):
        raise StictionError(f"{arm.name}: no collision-free pose found for joint {joint + 1}")
    return q[winner]
