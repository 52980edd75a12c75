"""Joint logs in which causes are hidden: their torque along the motion, sizes, and a diagnosis.

The motion is that of the log's own diagnosis, and the motors follow it with every hidden cause, as
under a stiff position controller. So `joint_elasticity` shows the gear's effect on the torque, but
not the response of a controller: the motor moves as logged, the link does not. The torque is that
of the nominal model and of what is hidden, behind the filter of the diagnosis. The noise is what
that diagnosis leaves (`surrogate`): it has the spectrum of each joint and the correlations between
joints.
"""

import copy
from dataclasses import fields, replace

import numpy as np
from scipy.signal import lsim

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError
from stiction_envs.gap.causes import TOLERANCES, Cause, cause_named, registered
from stiction_envs.gap.causes.base import ALL_OF_ONE, DRY, THE_ARM, filtered_columns
from stiction_envs.gap.diagnosis import Diagnosis, diagnose_signals
from stiction_envs.gap.judge.problem import ARM
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.prepare import Signals
from stiction_envs.hidden.friction_law import LuGre
from stiction_envs.hidden.rehearsal.jobs import (
    LEAST_FRICTION,
    NOTHING,
    CauseJob,
    Hideable,
    RehearsalRun,
    surrogate,
)
from stiction_envs.hidden.torque_effects import EFFECTS
from stiction_envs.hidden.worlds import World, inverse_torque
from stiction_envs.measured.motion_thresholds import REVERSAL_SPEED

DAMPING = 0.1  # damping ratio of a soft gear [-]; assumed
START = 0.01  # a small size, from which others are found; assumed
CLOSE = 0.03  # relative error of a size [-]; assumed
STEPS = 8  # most steps in which a size is found; assumed: the torque is nearly proportional to it
NO_TORQUE = 1e-6  # torque over the noise that is none [-]; assumed
PROMISED = 10.0
"""Nats from which on a joint's cause is promised; assumed: evidence of x nats scatters by about
√(2 x) from log to log, so that with 10 nats 3 are left in nearly all logs."""


def hideable(cause: Cause) -> Hideable:
    """Return how the rows of a cause of joint logs call it."""
    effect, first = EFFECTS.get(cause.name), cause.parameters[0]
    return Hideable(
        name=cause.name,
        parameter=(effect.parameter if effect else "") or first.name,
        unit=first.unit,
        what_to_record=cause.what_to_record,
        expected=effect.expected if effect else (),
        arm_wide=(cause.acts_on == THE_ARM),
        coupled=(cause.acts_on == ALL_OF_ONE),
    )


class TorqueLogs:
    """Joint logs in which causes can be hidden."""

    def __init__(self, own: Diagnosis) -> None:
        """Take motion and noise from the diagnosis of the logs; poses without time are refused."""
        for log in own.logs:
            if log.static:
                raise StictionError(f"{log.source}: poses at rest: expected joint logs to rehearse")
        self.arm, self.baseline = own.base.arm, replace(own.baseline, torque_unit=None)
        self.data = own.baseline.extend(own.base)
        self.candidates = {(t.cause, t.joint) for t in own.predictor.candidates}
        self.not_shown = {(x.name, j - 1) for x in own.not_shown for j in x.joints or (0,)}
        self.left = own.data.residual - own.torque
        self.noise = np.maximum(np.sqrt(np.mean(np.square(self.left), axis=0)), self.data.noise)
        self.whole = np.sqrt(np.mean(np.square(self.data.nominal), axis=0))
        known, found = _dry_friction(own)
        friction = known + found
        self.friction = np.where(friction > 0, friction, LEAST_FRICTION * self.noise)
        self.unknown_friction = self.friction - known
        self.bare = World(
            rigid=self.data.arm,
            seconds=max(float(self.data.recording.since_session.max()), 1e-9),
            middle=np.median(self.data.q, axis=0),
            coulomb=self.friction,
            distance=np.array(self.data.friction.presliding_distance),
        )
        self.dry = self.dry_friction(self.bare)

    def why_not(self, what: Hideable, j: int) -> str:
        """Return why a cause cannot show on a joint (from 0), or nothing."""
        cause, joint = cause_named(what.name), -1 if what.arm_wide else j
        if (what.name, joint) not in self.candidates:
            return "it changes no torque" + f" of joint {j + 1}" * (joint >= 0)
        if (what.name, joint) in self.not_shown:
            return "its interval is as wide as before"
        if what.name not in EFFECTS and (not cause.is_linear or what.coupled):
            return "no law is known by which to hide it"
        return ""

    def dry_friction(self, world: World) -> Array:
        """Return (T, n) torque of the reference law along the motion, filtered [N·m].

        A joint that moves at the start of a segment has slid for long, and the bristles of one that
        rests are relaxed.
        """
        data, recording = self.data, self.data.recording
        v = np.zeros_like(recording.reversal_path)
        for run in recording.path_runs:
            v[run][:-1] = np.diff(recording.reversal_path[run], axis=0) / recording.path_dt
        since, load = map(recording.along_path, (recording.since_session[:, None], data.rigid))
        level = world.friction_level(v, since, load)
        law = LuGre(
            stiction=np.maximum(level + world.stribeck, 1e-9),
            coulomb=np.maximum(level, 1e-9),
            stribeck_velocity=world.stribeck_velocity,
            bristle_stiffness=(world.coulomb + world.more_coulomb) / world.distance,
            bristle_damping=0.0,
        )
        # the exact solution over a row is a + b z
        a = law.advance(0.0, v, recording.path_dt)
        b = law.advance(1.0, v, recording.path_dt) - a
        sliding = np.abs(v) > REVERSAL_SPEED
        z = np.where(sliding, np.sign(v) * law.level(v) / np.asarray(law.bristle_stiffness), 0.0)
        for run in recording.path_runs:
            for k in range(run.start, run.stop - 1):
                z[k + 1] = a[k] + b[k] * z[k]
        return recording.smooth(law.torque(z, 0.0))

    def torque_of(self, world: World) -> Array:
        """Return (T, n) what a world adds to the torques of the nominal model [N·m]."""
        data, recording = self.data, self.data.recording
        more = self.dry_friction(world) - self.dry + world.more_viscous * data.dq
        more = more + recording.smooth(world.torque_over_angle(recording.along_path(data.q)))
        more = more + self._moved(world) - world.gravity_missing * recording.gravity
        out = recording.along_path(data.nominal + more)
        t = recording.path_dt * np.arange(len(out), dtype=np.float64)
        for run in recording.path_runs:
            out[run] = world.read_out(t[run], out[run])
        return np.asarray(out[recording.path_rows] - data.nominal)

    def _moved(self, world: World) -> Array | float:
        """Return (T, n) what other links, or links elsewhere, add to the torques [N·m]."""
        data = self.data
        q, dq, ddq = data.q - world.zero, np.array(data.dq), np.array(data.ddq)
        other = world.rigid is not self.bare.rigid or world.payload or world.tilt[0]
        if not (other or world.soft or world.zero.any() or world.armature.any()):
            return 0.0
        if world.soft is not None:
            joint, stiffness = world.soft
            x, v = link_behind_gear(data, joint, stiffness)
            q[:, joint] += x
            dq[:, joint] += v
            ddq[:, joint] += data.rate(v)
        return inverse_torque(replace(world, soft=None).model(), q, dq, ddq) - data.recording.rigid

    def hidden(self, job: CauseJob, size: Array) -> tuple[Array, dict[str, float]]:
        """Return (T, n) torque of a cause of sizes (n,) [N·m], and the parameter of each row."""
        name = job.what.name
        if name not in EFFECTS:  # linear: by its own columns
            cause, data = cause_named(name), self.data
            columns = [next(filtered_columns(cause, data, j, [()]))[:, 0] for j in range(data.n)]
            shown = {str(j + 1): float(size[j]) for j in np.flatnonzero(size)}
            return size * np.stack(columns, axis=1), shown
        effect, same = EFFECTS[name], self.bare.rigid
        parameters: dict[str, float] = {}
        world = copy.deepcopy(self.bare, {id(same): same})
        for j in [0] if job.what.arm_wide else np.flatnonzero(size):
            value = effect.value(world, int(j), float(size[j]))
            truth = effect.hide(world, int(j), value, None)
            first = np.ravel(next(iter(truth.values()), value))[0]
            parameters[str(0 if job.what.arm_wide else j + 1)] = float(first)
        return self.torque_of(world), parameters

    def size(self, job: CauseJob, target: Array) -> Array:
        """Return sizes (n,) with torques of a root mean square (n,) [N·m]; 0 where there is none.

        For a cause that all joints show, one joint reaches its target, the others stay below it.
        Sizes end at the largest.
        """
        largest = EFFECTS[job.what.name].largest if job.what.name in EFFECTS else np.inf
        size = np.zeros(self.data.n)
        size[list(job.joints)] = min(START, largest)
        for _ in range(STEPS):
            torque = self.hidden(job, size)[0]
            ratio = np.sqrt(np.mean(np.square(torque), axis=0)) / target
            if job.what.coupled or job.what.arm_wide:
                ratio = np.full_like(ratio, ratio.max())
            size = np.where(ratio > NO_TORQUE, size, 0.0)
            before = size
            size = np.minimum(size / np.maximum(ratio, NO_TORQUE), largest)
            if np.allclose(size, before, rtol=CLOSE):
                break
        return size

    def run(self, job: CauseJob, size: Array, rng: np.random.Generator) -> RehearsalRun:
        """Hide a cause of sizes (n,), diagnose the log, and return what is named."""
        tau, sizes = np.array(self.data.nominal), dict[str, float]()
        if job.what.name != NOTHING:
            hidden, sizes = self.hidden(job, size)
            tau += hidden
            if job.what.expected:  # it refines dry friction
                tau += self.unknown_friction * self.dry / self.friction
        recording = self.data.recording
        for run in recording.runs:
            tau[run] += surrogate(self.left[run], rng)
        signals = {x.name: getattr(recording, x.name) for x in fields(Signals)} | {"tau": tau}
        clean = replace(Signals(**signals), torque_unit=np.ones(1), set_up=False, zero_off=None)
        causes = (TOLERANCES, *registered())
        side = recording.torque
        said = diagnose_signals((), clean, self.arm, self.baseline, side, causes, seed=0)
        doubtful = _doubtful(said, job.what.name)
        named = [
            [c.name, joints, list(c.confused_with)]
            for c in said.causes
            if (joints := [j for j in c.joints if (c.name, j) not in doubtful])
        ]
        return {"sizes": sizes, "named": named, "minor": [c.name for c in said.minor]}


def _doubtful(said: Diagnosis, name: str) -> set[tuple[str, int]]:
    """Return a hidden cause and the joints (from 1) on which another log might not show it."""
    problem, named = said.predictor.problem, [t for t in said.terms if not t.small]
    now = problem.score(named)
    mine = [t for t in named if t.cause == name and t.joint != ARM]
    nats = {t: now - problem.score([x for x in named if x != t]) for t in mine}
    return {(name, t.joint + 1) for t, x in nats.items() if x < PROMISED}


def link_behind_gear(data: Data, joint: int, stiffness: float) -> tuple[Array, Array]:
    """Return (T,) the link's angle less the motor's, δ [rad], and its speed [rad/s].

    M δ̈ + D δ̇ + K δ = −L: L is the load of the rigid joint (from 0), M its mean inertia, K the
    ``stiffness`` of the gear [N·m/rad].
    """
    load, mass = data.recording.rigid[:, joint], float(data.own_inertia[joint])
    damping = 2 * DAMPING * np.sqrt(stiffness * mass)
    system = ([[0, 1], [-stiffness / mass, -damping / mass]], [[0], [-1 / mass]])
    out = np.zeros((len(load), 2))
    for run in data.recording.runs:
        push = load[run]
        t = data.dt * np.arange(len(push))
        start = [-push[0] / stiffness, 0.0]
        out[run] = lsim((*system, np.eye(2), np.zeros((2, 1))), push, t, start)[1]
    return out[:, 0], out[:, 1]


def _dry_friction(own: Diagnosis) -> tuple[Array, Array]:
    """Return (n,) dry friction of the nominal model, and of what was found besides [N·m]."""
    known, found = np.array(own.base.friction.level), np.zeros(own.data.n)
    for part in own.baseline.parts:
        if part.joint and cause_named(part.cause).adds_to == DRY:
            known[part.joint - 1] += part.coefficients[0]
    split = own.predictor.problem.split(own.terms, own.coefficients)
    for term, c in zip(own.terms, split, strict=True):
        if own.predictor.causes[term.cause].adds_to == DRY:
            found[term.joint] += float(c[0])
    return np.maximum(known, 0.0), np.maximum(found, 0.0)
