"""Simulated joint logs of a Panda with hidden causes, written as a robot writes them.

This file shares no code with the diagnosis. ``mj_step`` simulates the arm, the reference law its
friction, and every cause acts where it belongs. The nominal model (`HiddenLogs.nominal`) has the
known dry and viscous friction and rotors, or none (``"rigid"``); hidden causes come on top.
"""

import copy
import dataclasses
import tempfile
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.friction.parameters import FrictionParameters, from_table
from stiction_envs.hidden.friction_law import LuGre
from stiction_envs.hidden.hidden_motions import BLIND_MOTIONS, MOTIONS
from stiction_envs.hidden.torque_effects import EFFECTS, FRICTION, ROTOR, Draw, cause_of
from stiction_envs.hidden.worlds import PRESLIDING_DISTANCE, STEP, World, with_scattered_links
from stiction_envs.measured.logs.reader import JointLog, read_logs
from stiction_envs.robots import Arm, load_arm

LINKS = 27  # number of the random stream of links, apart from that of all else
STEPS_PER_ROW = 2  # steps per logged row: 500 Hz; assumed
SECOND_MOTIONS = ("fourier", "fast", "sweeps", "poses")
"""Names of the `MOTIONS` that go all over the range: on which a model is to hold."""
TAU_NOISE = np.array([0.08, 0.08, 0.08, 0.08, 0.03, 0.03, 0.03])
"""(7,) standard deviation of logged torques [N·m]; assumed."""


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """One hidden cause: the truth."""

    name: str
    """Name of the cause, as the diagnosis should say it."""
    joint: int
    """From 1; 0 for the whole arm."""
    values: dict[str, float | list[float]]
    """Under the names of ``diagnosis.json``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HiddenLogs:
    """Logs and arm that a blind test sees, and the truth."""

    logs: list[JointLog]
    robot: Arm
    """As its makers know it, but for friction."""
    nominal: FrictionParameters | str
    hidden: tuple[Hidden, ...]
    effect: Array
    """(7,) root mean square of what the hidden causes do to the torques [N·m]."""
    alone: Array
    """(k, 7) the same of each by itself, along the same motion [N·m]."""
    motion: str
    seed: int
    second: list[JointLog]
    """Logs of another motion of the same arm with the same hidden causes; [] unless asked for."""
    second_motion: str
    unhidden: list[JointLog]
    """Logs of the motion of `second`, of the arm without hidden causes."""
    bare: World
    """The arm without hidden causes, its links a little off where asked for."""


def make_case(
    seed: int,
    causes: tuple[str, ...] = (),
    *,
    motion: str | None = None,
    seconds: float = 26.0,
    known: bool | None = None,
    joint: int | None = None,
    size: float | None = None,
    second: float = 0.0,
    scatter: float = 0.0,
) -> HiddenLogs:
    """Hide some causes of random size, joint and sign in a log.

    Args:
        seed: of everything.
        causes: names of `EFFECTS`.
        motion: of `MOTIONS` or `BLIND_MOTIONS`; by default one that excites all of them.
        seconds: length of the log [s].
        known: whether the robot has known friction and rotors; by default as the causes need, or
            at random.
        joint: from 1; random by default.
        size: of the effect, 0 (just visible) to 1 (large); random by default.
        second: length of a log of another kind of motion [s]; 0 for none.
        scatter: how far every link is off what the makers know [-] (`hidden.worlds.scattered`):
            0.03 is 3 % of the mass and 3 mm. It is no hidden cause.

    Raises:
        StictionError: a scatter out of range, or an arm that leaves its torque limits.
    """
    stream = [seed, *(sum(map(ord, name)) for name in causes)]
    rng = np.random.default_rng(stream)
    if motion is None:
        options = list(MOTIONS)
        for name in causes:
            motions = EFFECTS[name].motions
            options = [m for m in options if m in motions] or list(motions)
        motion = str(rng.choice(options))
    if known is None:
        effects = [EFFECTS[name] for name in causes]
        known = any(x.needs_friction or x.expected for x in effects) or bool(rng.random() < 0.5)
    bare = World()
    if known:
        bare.coulomb = FRICTION * rng.uniform(0.6, 1.2, 7)
        bare.viscous = FRICTION * rng.uniform(0.3, 1.0, 7)
        bare.rotor = ROTOR * rng.uniform(0.8, 1.2, 7)
    if scatter:
        own = np.random.default_rng([*stream, LINKS])
        bare.rigid = with_scattered_links(bare.rigid, scatter, own)
    world = copy.deepcopy(bare)
    world.seconds = seconds
    worlds = [copy.deepcopy(world) for _ in causes]
    hidden = []
    for name, single in zip(causes, worlds, strict=True):
        large = rng.random() if size is None else size
        # the same draw, hidden with the others and by itself
        again = copy.deepcopy(rng)
        hidden.append(_hide(world, name, joint, large, rng))
        _hide(single, name, joint, large, again)
    t = np.arange(0, seconds, STEP)
    wanted = {**MOTIONS, **BLIND_MOTIONS}[motion](rng, t)
    q, tau, effect = _simulate(world, bare, t, wanted)
    alone = [effect] if len(causes) == 1 else [_simulate(w, bare, t, wanted)[2] for w in worlds]
    alone = [_visible_size(w, q, x) for w, x in zip(worlds, alone, strict=True)]
    if len(causes) == 1:
        effect = alone[0]
    log = _log(q, tau, t, rng, f"case_{seed}")
    others: list[JointLog] = []
    unhidden: list[JointLog] = []
    other = ""
    if second:
        other = str(rng.choice([m for m in SECOND_MOTIONS if m != motion]))
        later = np.arange(0, second, STEP)
        wanted = MOTIONS[other](rng, later)
        for arm, logs in ((world, others), (bare, unhidden)):
            q, tau, _ = _simulate(arm, bare, later, wanted)
            logs.append(_log(q, tau, later, rng, f"case_{seed}_{other}"))
    payload = None if world.phantom is None else (world.phantom[0], *world.phantom[1].tolist())
    nominal: FrictionParameters | str = "rigid"
    if known:
        levels = {
            "stiction": world.coulomb,
            "coulomb_ratio": 1.0,
            "stribeck_velocity": 0.01,
            "viscous": world.viscous,
            "bristle_stiffness": world.coulomb / PRESLIDING_DISTANCE,
            "rotor_inertia": world.rotor,
        }
        entries = {k: {"value": v, "assumed": True} for k, v in levels.items()}
        nominal = from_table(entries, "known to the robot's makers", 7)
    return HiddenLogs(
        logs=[log],
        robot=load_arm("panda", payload=payload),
        nominal=nominal,
        hidden=tuple(hidden),
        effect=effect,
        alone=np.array(alone).reshape(-1, 7),
        motion=motion,
        seed=seed,
        second=others,
        second_motion=other,
        unhidden=unhidden,
        bare=bare,
    )


def _visible_size(w: World, q: Array, effect: Array) -> Array:
    """Return (7,) size of an effect; a straight line over angle is no effect of a smooth torque.

    Along a motion in which a joint hardly turns every smooth torque is an offset or a spring.
    """
    out = effect.copy()
    torque = w.smooth_torque(q)
    for j in np.flatnonzero(torque.any(axis=0)):
        line = np.polynomial.Polynomial.fit(q[:, j], torque[:, j], 1)
        out[j] = float(np.sqrt(np.mean(np.square(torque[:, j] - line(q[:, j])))))
    return out


def _hide(
    world: World, name: str, joint: int | None, size: float, rng: np.random.Generator
) -> Hidden:
    """Hide one cause in a world; the truth."""
    effect = EFFECTS[name]
    number = joint or int(rng.choice(effect.joints))
    sign = float(rng.choice([-1.0, 1.0]))
    draw = Draw(joint=number - 1, sign=sign, size=size, rng=rng)
    values = effect.hide(world, number - 1, effect.draw(world, draw), rng)
    return Hidden(
        name=cause_of(name),
        joint=0 if effect.arm_wide else number,
        values={k: v if isinstance(v, list) else float(v) for k, v in values.items()},
    )


def _dynamics(m: mujoco.MjModel, d: mujoco.MjData, q: Array, v: Array, mass: Array) -> Array:
    """Write the inertia (7, 7) at angles and speeds (7,) into ``mass``; return the bias torque."""
    d.qpos[:], d.qvel[:] = q, v
    mujoco.mj_fwdPosition(m, d)
    mujoco.mj_fwdVelocity(m, d)
    mujoco.mj_fullM(m, d, mass)
    return np.asarray(d.qfrc_bias)


def _simulate(w: World, bare: World, t: Array, wanted: Array) -> tuple[Array, Array, Array]:
    """Return motor angles and logged torques at the rows, and the size of what is hidden.

    ``w`` is simulated and compared with the same arm ``bare`` of what is hidden; t is (T,) [s] and
    ``wanted`` (T, 7) the angles of the motion [rad].
    """
    true = dataclasses.replace(w, phantom=None)
    model, plain = true.model(), bare.model()
    # the robot's own controller knows that there is no such body
    assumed = dataclasses.replace(bare, phantom=w.phantom).model() if w.phantom else None
    assumed_data = mujoco.MjData(assumed or plain)
    # a controller adds the gravity of the makers' arm
    makers = World(phantom=w.phantom).model()
    makers_data = mujoco.MjData(makers)
    d, plain_data = mujoco.MjData(model), mujoco.MjData(plain)
    # what the gears carry: friction that grows with load feels a payload and a tilt too
    heavy = dataclasses.replace(bare, payload=w.payload, tilt=w.tilt, links=w.links).model()
    heavy_data = mujoco.MjData(heavy)
    outer = np.array([i + (w.soft is not None and i > w.soft[0]) for i in range(7)])
    speed = np.gradient(wanted, STEP, axis=0)
    pull = np.gradient(speed, STEP, axis=0)
    d.qpos[outer] = plain_data.qpos[:] = wanted[0]
    # two laws in one: the true joints, and what the makers know of them
    levels = np.stack([w.coulomb + w.more_coulomb, w.coulomb])
    on, known_level = levels > 0, np.maximum(w.coulomb, 1e-9)
    stiff = np.stack(
        [np.where(on[0], levels[0], 1.0) / w.distance, w.coulomb / PRESLIDING_DISTANCE]
    )
    inertia = np.maximum(np.stack([w.rotor + w.armature, w.rotor]), 0.02)
    damping = 2 * 0.4 * np.sqrt(stiff * inertia)
    stiff[1] = known_level / PRESLIDING_DISTANCE
    z = np.zeros((2, 7))
    q, tau, nominal = (np.empty((len(t), 7)) for _ in range(3))
    missing, still = np.zeros((len(t), 7)), np.zeros(7)
    mass, load = np.empty((7, 7)), np.zeros(7)
    force = np.zeros(model.nv)
    for k in range(len(t)):
        x, v = d.qpos[outer], d.qvel[outer]
        before = v
        bias = _dynamics(plain, plain_data, x, v, mass)
        want = pull[k] + 100 * (speed[k] - v) + 2500 * (wanted[k] - x)
        command = mass @ want + bias + w.coulomb * np.tanh(speed[k] / 0.01)
        # angles at t belong to the speed half a step before: friction is due at t
        v = v + 0.5 * STEP * pull[k]
        friction = w.viscous * v + w.more_viscous * v
        known = w.viscous * v
        if on[0].any():
            level = w.friction_level(v, t[k], load)
            top = np.maximum(level + w.stribeck, 1e-9)
            law = LuGre(
                stiction=np.array([top, known_level]),
                coulomb=np.array([np.maximum(level, 1e-9), known_level]),
                stribeck_velocity=w.stribeck_velocity,
                bristle_stiffness=stiff,
                bristle_damping=damping,
            )
            both = np.where(on, law.torque(z, v), 0.0)
            friction, known = friction + both[0], known + both[1]
            z = np.where(on, law.advance(z, v, STEP), 0.0)
        force[outer] = command - friction - w.torque_over_angle(x)
        d.qfrc_applied[:] = force
        q[k], tau[k] = x + w.zero, command
        mujoco.mj_step(model, d)
        acceleration = (d.qvel[outer] - before) / STEP
        if assumed is not None or w.zero.any():
            bias = _dynamics(assumed or plain, assumed_data, x + w.zero, before, mass)
        nominal[k] = mass @ acceleration + bias + known
        if w.gravity_missing:
            missing[k] = _dynamics(makers, makers_data, x + w.zero, still, mass)
        if w.load.any():
            bias = _dynamics(heavy, heavy_data, x, plain_data.qvel, mass)
            load = mass @ pull[k] + bias - w.rotor * pull[k]
    # what the controller asked for, as the log shows it
    tau = tau - w.gravity_missing * missing
    logged, nominal = w.read_out(t, tau), bare.read_out(t, nominal)
    width = 50
    window = np.ones(width) / width
    off = np.stack([np.convolve(x, window, "valid") for x in (logged - nominal).T])
    effect = np.sqrt(np.mean(off[:, 500:-100] ** 2, axis=1))
    return q[::STEPS_PER_ROW], logged[::STEPS_PER_ROW], effect


def _log(q: Array, tau: Array, t: Array, rng: np.random.Generator, name: str) -> JointLog:
    """Write down angles and torques as a robot does."""
    rows = t[::STEPS_PER_ROW]
    stamps = rows + np.clip(rng.normal(0, 0.02, len(rows)), -0.2, 0.2) * STEP * STEPS_PER_ROW
    angle = np.round((q + rng.normal(0, 3e-6, q.shape)) / 5e-6) * 5e-6
    torque = np.round((tau + TAU_NOISE * rng.normal(size=q.shape)) / 0.01) * 0.01
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.npz"
        np.savez(path, t=stamps, q=angle, tau=torque)
        return read_logs([path], 7, limits=load_arm("panda").limits)[0]
