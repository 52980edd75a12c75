"""What a hidden cause does to the torques along a motion that is given: for a rehearsal.

One entry per cause, by the name of the diagnosis. Each law is the physics of the cause and not the
columns by which the diagnosis looks for it: friction is the reference law along the motion, bodies
and gravity are those of a changed arm, a delay shifts the torque, and a link behind a soft or loose
gear is integrated and then moves with all its inertia. What has no other law is as it is defined
(offset, gain, viscous friction, rotor, spring).

The motion is given, so the motors follow it whatever is hidden, as under a stiff position
controller. So `backlash` and `joint_elasticity` show what the gear does to the torque, but not how
a controller would answer: the motor moves as logged, the link does not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from typing import TypedDict, Unpack

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from stiction_envs.compiled import compiled
from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.signals.rigid_body import gravity_torque, inverse_dynamics, mass_matrices
from stiction_envs.hidden.friction_law import LuGre
from stiction_envs.hidden.hidden_effects import HALF_HEIGHT
from stiction_envs.hidden.rehearsal.replay import Replay
from stiction_envs.robots.tables import payload_radius

Array = NDArray[np.float64]
Law = Callable[[Replay, Array], Array]
"""Torque (T, n) [N·m] of a cause whose sizes on the joints are (n,); one of the whole arm has the
same size on all."""
COM = np.array([0.02, 0.01, 0.05])
"""Centre of mass of a hidden payload from the flange [m]; assumed."""
STRIBECK_VELOCITY = 0.05
"""Of hidden Stribeck friction [rad/s]; assumed."""
PERIODS = 24.0
"""Of hidden ripple [1/rev]; assumed."""
HUMP = np.radians(60.0) / HALF_HEIGHT
"""Standard deviation of a hidden torque over the angle, 60° across at half its height [rad];
assumed."""
FLANK, FLANK_DAMPING = 8000.0, 0.2
"""Stiffness [N·m/rad] and damping ratio [-] of a loose gear's flanks; assumed."""
SPRING_DAMPING = 0.1
"""Damping ratio of a soft gear [-]; assumed."""
TURN = 0.1
"""Largest angle by which a link behind a gear swings in a step [rad]; assumed: the error of its
frequency is below 0.1 %."""


@dataclass(frozen=True)
class ReplayedEffect:
    """How a cause is hidden along a given motion."""

    torque: Law
    _: KW_ONLY
    parameter: str = ""
    """What its size is, where that is not the cause's first parameter."""
    start: float = 0.01
    """A small size, from which the first one is found."""
    largest: float = np.inf
    """Largest size that is tried: more is obvious; assumed."""
    on_friction: bool = False
    """Whether it changes a dry friction that must be there, and may be named too."""
    comes_with: str = ""
    """Name of a cause that its law holds too."""
    shown: Callable[[Replay, Array], Array] = lambda replay, size: size
    """The parameter (n,) of sizes (n,); the torque must grow with the size."""

    @property
    def expected(self) -> tuple[str, ...]:
        """Causes that are named rightly beside it."""
        friction = ("coulomb_friction",) if self.on_friction else ()
        return (*friction, *((self.comes_with,) if self.comes_with else ()))


def effect_of(name: str) -> ReplayedEffect:
    """Return how to hide a cause; a linear one of another package by its own first column."""
    if name in REPLAYED:
        return REPLAYED[name]
    cause = cause_named(name)

    def torque(replay: Replay, size: Array) -> Array:
        columns = [cause.columns(replay.data, j, ())[:, 0] for j in range(replay.data.n)]
        return size * np.stack(columns, axis=1)

    return ReplayedEffect(torque)


# ---- friction ------------------------------------------------------------------------------------


def along(replay: Replay, law: LuGre) -> Array:
    """Return (T, n) torque of a reference law along the motion [N·m].

    A joint that moves at the start of a segment has slid for long, and the bristles of one that
    rests are relaxed. ``law`` has fields (n,) or (T, n), and no bristle damping.
    """
    v, dt = replay.velocity, replay.data.dt
    # the exact solution over a row is a + b z
    a = law.advance(0.0, v, dt)
    b = law.advance(1.0, v, dt) - a
    sliding = np.abs(v) > replay.data.settings.motion.reversal_speed
    z = np.where(sliding, np.sign(v) * law.level(v) / np.asarray(law.bristle_stiffness), 0.0)
    for run in replay.data.runs():
        for k in range(run.start, run.stop - 1):
            z[k + 1] = a[k] + b[k] * z[k]
    return law.torque(z, 0.0)


def plain_law(replay: Replay, level: Array, distance: Array | None = None, **more: Array) -> LuGre:
    """Return dry friction of a level (n,) or (T, n) [N·m] without a Stribeck effect.

    ``distance`` is its presliding distance (n,) on the arm's own friction [rad]; by default that
    of the log's own diagnosis.
    """
    if distance is None:
        distance = replay.data.friction.presliding_distance
    fields = {"stiction": level, "coulomb": level, **more}
    return LuGre(
        **fields,
        stribeck_velocity=STRIBECK_VELOCITY,
        bristle_stiffness=np.maximum(replay.friction, 1e-9) / distance,
        bristle_damping=0.0,
    )


def dry_friction(replay: Replay, level: Array) -> Array:
    """Return (T, n) torque of plain dry friction of a level (n,) [N·m]."""
    return level * along(replay, plain_law(replay, replay.friction)) / replay.friction


class Traits(TypedDict, total=False):
    """Fields of `ReplayedEffect`."""

    start: float
    largest: float
    shown: Callable[[Replay, Array], Array]


def refined(law: Callable[[Replay, Array], LuGre], **traits: Unpack[Traits]) -> ReplayedEffect:
    """Return an effect that refines dry friction: hidden is what its law adds to the arm's own."""

    def more(replay: Replay, size: Array) -> Array:
        own = plain_law(replay, replay.friction)
        return along(replay, law(replay, size)) - along(replay, own)

    return ReplayedEffect(more, on_friction=True, **traits)


def _share(replay: Replay, size: Array) -> Array:
    """Return a size that is a part of the dry friction."""
    return size * replay.friction


def _stribeck(replay: Replay, size: Array) -> LuGre:
    return plain_law(replay, replay.friction, stiction=replay.friction * (1 + size))


def _asymmetry(replay: Replay, size: Array) -> LuGre:
    level = replay.friction * (1 + size)
    return plain_law(replay, level, asymmetry=(1 - size) / (1 + size))


def _load(replay: Replay, size: Array) -> LuGre:
    load = np.abs(replay.data.rigid)
    return plain_law(replay, replay.friction, load_coefficient=size, load=load)


def _longer(replay: Replay, size: Array) -> Array:
    """Return presliding distances that are longer by a size [rad]."""
    return replay.data.friction.presliding_distance + size


def _over_the_log(replay: Replay, size: Array) -> Array:
    """Return the rate of a drift that changes dry friction by a part of it over the log."""
    return size * replay.friction / max(float(replay.data.recording.since_session.max()), 1e-9)


def _drift(replay: Replay, size: Array) -> LuGre:
    since = replay.data.recording.since_session[:, None]
    return plain_law(replay, replay.friction + _over_the_log(replay, size) * since)


# ---- bodies --------------------------------------------------------------------------------------


def _with_model(replay: Replay, model: pin.Model) -> Array:
    """Return what another rigid arm adds to the torque."""
    data = replay.data
    return inverse_dynamics(model, data.q, data.dq, data.ddq) - data.recording.rigid


def _payload(replay: Replay, size: Array) -> Array:
    model, mass = replay.data.pinocchio.copy(), float(size[0])
    flange = model.frames[model.getFrameId(replay.data.arm.end_effector)]
    small = 0.4 * mass * payload_radius() ** 2 * np.eye(3)
    model.appendBodyToJoint(flange.parentJoint, pin.Inertia(mass, COM, small), flange.placement)
    return _with_model(replay, model)


def _of_link(replay: Replay, size: Array) -> Array:
    """Return masses that are a part of those of the links [kg]."""
    return size * np.array([x.mass for x in list(replay.data.pinocchio.inertias)[1:]])


def _link(replay: Replay, size: Array) -> Array:
    model = replay.data.pinocchio.copy()
    for j, share in enumerate(size):
        body = model.inertias[j + 1]  # of another density
        model.inertias[j + 1] = pin.Inertia(
            body.mass * (1 + share), body.lever, body.inertia * (1 + share)
        )
    return _with_model(replay, model)


def _tilt(replay: Replay, size: Array) -> Array:
    model, lean = replay.data.pinocchio.copy(), float(size[0])
    down = pin.AngleAxis(lean, np.array([1.0, -1.0, 0.0]) / np.sqrt(2)).matrix()
    model.gravity.linear = down @ model.gravity.linear
    return _with_model(replay, model)


# ---- gears ---------------------------------------------------------------------------------------


def link_behind_gear(
    replay: Replay, joint: int, gap: float, stiffness: float, damping: float
) -> tuple[Array, Array]:
    """Return (T,) the link's angle less the motor's, δ [rad], and its speed [rad/s].

    The link moves freely within the gap, and beyond it on a damped spring of the joint:
    M δ̈ = −L − K(δ − clip δ) − D δ̇, where L is the load at the link's angle, to first order in δ.

    Args:
        replay: of the motor's motion.
        joint: from 0.
        gap: of the gear [rad].
        stiffness: K of gear or flanks [N·m/rad].
        damping: ratio D/(2√(K M)) [-].
    """
    data = replay.data
    model, nudge = data.pinocchio, 1e-5
    mass = mass_matrices(model, data.q)[:, joint, joint]
    moved = np.array(data.q)
    moved[:, joint] += nudge
    load = data.recording.rigid[:, joint]
    slope = (inverse_dynamics(model, moved, data.dq, data.ddq)[:, joint] - load) / nudge
    fastest = np.sqrt(stiffness / mass.min())
    steps = int(np.ceil(fastest * data.dt / TURN))
    out = np.zeros((len(mass), 2))
    for run in data.runs():
        swing(load[run], slope[run], mass[run], gap, stiffness, damping, data.dt, steps, out[run])
    return out[:, 0], out[:, 1]


@compiled
def swing(
    load: Array,
    slope: Array,
    mass: Array,
    gap: float,
    stiffness: float,
    ratio: float,
    dt: float,
    steps: int,
    out: Array,
) -> None:
    """Put δ and its speed into ``out`` (K, 2), from rest on the gear; semi-implicit Euler."""
    x = -load[0] / stiffness - np.sign(load[0]) * gap / 2
    v, h = 0.0, dt / steps
    out[0, 0] = x
    for k in range(1, len(load)):
        for s in range(steps):
            part = (s + 1) / steps
            now = load[k - 1] + part * (load[k] - load[k - 1])
            press = x - min(max(x, -gap / 2), gap / 2)
            force = -now - slope[k] * x - stiffness * press
            if press != 0.0:
                force -= 2 * ratio * np.sqrt(stiffness * mass[k]) * v
            v += h * force / mass[k]
            x += h * v
        out[k, 0], out[k, 1] = x, v


def _geared(replay: Replay, size: Array, gap: float, stiffness: float, damping: float) -> Array:
    """Return the torque of the arm whose links move behind one gear, less that of a rigid gear."""
    data, joint = replay.data, int(np.argmax(size))
    q, dq, ddq = (np.array(x) for x in (data.q, data.dq, data.ddq))
    x, v = link_behind_gear(replay, joint, gap, stiffness, damping)
    q[:, joint] += x
    dq[:, joint] += v
    for run in data.runs():
        ddq[run, joint] += np.gradient(v[run], data.dt)
    return inverse_dynamics(data.pinocchio, q, dq, ddq) - data.recording.rigid


# ---- the log, and what is outside ----------------------------------------------------------------


def _delay(replay: Replay, size: Array) -> Array:
    data, out = replay.data, np.zeros_like(replay.data.q)
    for run in data.runs():
        for j in range(data.n):
            x = data.nominal[run, j]
            out[run, j] = np.interp(data.t[run] + float(size[0]), data.t[run], x) - x
    return out


def _hump(replay: Replay, size: Array) -> Array:
    q = replay.data.q
    return size * np.exp(-0.5 * np.square((q - np.median(q, axis=0)) / HUMP))


def _encoder(replay: Replay, size: Array) -> Array:
    data = replay.data
    return inverse_dynamics(data.pinocchio, data.q - size, data.dq, data.ddq) - data.recording.rigid


REPLAYED = {
    "coulomb_friction": ReplayedEffect(dry_friction),
    "viscous_friction": ReplayedEffect(lambda replay, size: size * replay.data.dq),
    "stribeck_friction": refined(_stribeck, largest=3.0, shown=_share),
    "direction_asymmetry": refined(_asymmetry, largest=0.9, shown=_share),
    "load_dependent_friction": refined(_load, largest=1.0),
    "presliding_hysteresis": refined(
        lambda replay, size: plain_law(replay, replay.friction, _longer(replay, size)),
        start=1e-3,
        largest=0.1,
        shown=lambda replay, size: replay.friction / _longer(replay, size),
    ),
    "position_dependent_friction": ReplayedEffect(
        lambda replay, size: size * np.sin(PERIODS * replay.data.q + 0.7)
    ),
    "warm_up_drift": refined(_drift, largest=1.0, shown=_over_the_log),
    "payload": ReplayedEffect(_payload, largest=20.0),
    "link_parameters": ReplayedEffect(_link, largest=0.5, shown=_of_link),
    "base_tilt": ReplayedEffect(_tilt, start=1e-3, largest=0.3),
    "link_inertia": ReplayedEffect(lambda replay, size: size * replay.data.ddq, start=1e-3),
    "backlash": ReplayedEffect(
        lambda replay, size: _geared(replay, size, float(size.max()), FLANK, FLANK_DAMPING),
        start=1e-3,
        largest=0.05,
        comes_with="joint_elasticity",  # its flanks yield
    ),
    "joint_elasticity": ReplayedEffect(
        lambda replay, size: _geared(replay, size, 0.0, 1 / float(size.max()), SPRING_DAMPING),
        start=1e-4,
        largest=1 / 300,
        shown=lambda replay, size: 1 / np.maximum(size, 1e-9),
    ),
    "torque_offset": ReplayedEffect(
        lambda replay, size: np.broadcast_to(size, replay.data.q.shape)
    ),
    "torque_scale": ReplayedEffect(
        lambda replay, size: size * replay.data.nominal,
        largest=0.8,
        shown=lambda replay, size: 1 + size,
    ),
    "actuator_delay": ReplayedEffect(_delay, start=1e-3, largest=0.1),
    "external_spring": ReplayedEffect(
        lambda replay, size: size * (replay.data.q - np.median(replay.data.q, axis=0))
    ),
    "position_dependent_torque": ReplayedEffect(_hump, parameter="height_nm"),
    "encoder_offset": ReplayedEffect(_encoder, start=1e-3, largest=0.2),
    "gravity_compensation_missing": ReplayedEffect(
        lambda replay, size: -size * gravity_torque(replay.data.pinocchio, replay.data.q),
        largest=1.0,
    ),
}
"""By name of the cause."""
