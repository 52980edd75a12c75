"""Causes hidden in joint logs: their torque along a motion, their sizes, and a diagnosis of them.

The motion is fixed: the motors follow it with every hidden cause, as under a stiff position
controller. So `joint_elasticity` shows the gear's effect on the torque, but not the response of a
controller: the motor moves as logged, the link does not.
"""

from __future__ import annotations

import copy
import dataclasses
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.compiled import compiled
from stiction_envs.gap.causes import Cause, cause_named
from stiction_envs.gap.causes.base import ALL_OF_ONE, THE_ARM, filtered_columns
from stiction_envs.gap.diagnosis import Diagnosis
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.rigid_body import inverse_dynamics, mass_matrices
from stiction_envs.hidden.friction_law import LuGre
from stiction_envs.hidden.rehearsal.jobs import (
    LARGE_NOISE,
    LARGE_SHARE,
    NO_JOB,
    NOTHING,
    CauseJob,
    Hideable,
    RehearsalRun,
)
from stiction_envs.hidden.rehearsal.replay import Replay
from stiction_envs.hidden.torque_effects import EFFECTS
from stiction_envs.hidden.worlds import World, inverse_torque
from stiction_envs.measured.motion_thresholds import REVERSAL_SPEED

DAMPING = 0.1  # damping ratio of a soft gear [-]; assumed
TURN = 0.1
"""Largest angle by which a link behind a gear swings in a step [rad]; assumed: the error of its
frequency is below 0.1 %."""
CLOSE = 0.03  # relative error of a size [-]; assumed
STEPS = 8  # most steps in which a size is found; assumed: the torque is nearly proportional to it
NO_TORQUE = 1e-6  # torque over the noise that is none [-]; assumed


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


def jobs_of(own: Diagnosis, causes: Sequence[Cause]) -> list[CauseJob]:
    """Return the jobs."""
    jobs = [NO_JOB]
    candidates = {(t.cause, t.joint) for t in own.predictor.candidates}
    hidden = {(x.name, j - 1) for x in own.not_shown for j in x.joints or (0,)}
    for cause in causes:
        what = hideable(cause)
        joints, left = tuple(range(own.data.n)), []
        for j in (-1,) if what.arm_wide else joints:
            why = ""
            if (cause.name, j) not in candidates:
                why = "it changes no torque" + f" of joint {j + 1}" * (j >= 0)
            elif (cause.name, j) in hidden:
                why = "its interval is as wide as before"
            elif cause.name not in EFFECTS and (not cause.is_linear or what.coupled):
                why = "no law is known by which to hide it"
            if why or what.coupled:
                jobs.append(CauseJob(what=what, joints=(max(j, 0),), why_not=why))
            else:
                left.append(j)
        if left:
            jobs.append(CauseJob(what=what, joints=joints if what.arm_wide else tuple(left)))
    return jobs


@dataclass(frozen=True, kw_only=True, eq=False)
class HiddenTorques:
    """Torques that are hidden along the motion of joint logs."""

    replay: Replay

    @cached_property
    def bare(self) -> World:
        """The arm in which nothing is hidden, with dry friction that causes may refine."""
        data = self.replay.data
        return World(
            rigid=data.arm,
            seconds=max(float(data.recording.since_session.max()), 1e-9),
            middle=np.median(data.q, axis=0),
            coulomb=self.replay.friction,
            distance=np.array(data.friction.presliding_distance),
        )

    @cached_property
    def dry(self) -> Array:
        """(T, n) torque of its dry friction [N·m]."""
        return self.dry_friction(self.bare)

    def dry_friction(self, world: World) -> Array:
        """Return (T, n) torque of the reference law along the motion [N·m].

        A joint that moves at the start of a segment has slid for long, and the bristles of one that
        rests are relaxed.
        """
        data, v = self.replay.data, self.replay.velocity
        level = world.friction_level(v, data.recording.since_session[:, None], data.rigid)
        law = LuGre(
            stiction=np.maximum(level + world.stribeck, 1e-9),
            coulomb=np.maximum(level, 1e-9),
            stribeck_velocity=world.stribeck_velocity,
            bristle_stiffness=(world.coulomb + world.more_coulomb) / world.distance,
            bristle_damping=0.0,
        )
        # the exact solution over a row is a + b z
        a = law.advance(0.0, v, data.dt)
        b = law.advance(1.0, v, data.dt) - a
        sliding = np.abs(v) > REVERSAL_SPEED
        z = np.where(sliding, np.sign(v) * law.level(v) / np.asarray(law.bristle_stiffness), 0.0)
        for run in data.runs():
            for k in range(run.start, run.stop - 1):
                z[k + 1] = a[k] + b[k] * z[k]
        return law.torque(z, 0.0)

    def torque_of(self, world: World) -> Array:
        """Return (T, n) what a world adds to the torques of the nominal model [N·m]."""
        data, bare = self.replay.data, self.bare
        more = world.more_viscous * data.dq + world.torque_over_angle(data.q)
        refined = ("more_coulomb", "stribeck", "asymmetry", "load", "drift", "distance")
        if any((getattr(world, x) != getattr(bare, x)).any() for x in refined):
            more = more + self.dry_friction(world) - self.dry
        more = more + self._moved(world) - world.gravity_missing * data.recording.gravity
        out = data.nominal + more
        for run in data.runs():
            out[run] = world.read_out(data.t[run], out[run])
        return np.asarray(out - data.nominal)

    def _moved(self, world: World) -> Array | float:
        """Return (T, n) what other links, or links elsewhere, add to the torques [N·m]."""
        data = self.replay.data
        q, dq, ddq = data.q - world.zero, np.array(data.dq), np.array(data.ddq)
        other = world.rigid is not self.bare.rigid or world.payload or world.tilt[0]
        if not (other or world.soft or world.zero.any() or world.armature.any()):
            return 0.0
        if world.soft is not None:
            joint, stiffness = world.soft
            x, v = link_behind_gear(data, joint, stiffness)
            q[:, joint] += x
            dq[:, joint] += v
            for run in data.runs():
                ddq[run, joint] += np.gradient(v[run], data.dt)
        model = dataclasses.replace(world, soft=None).model()
        return inverse_torque(model, q, dq, ddq) - data.recording.rigid

    def hidden(self, job: CauseJob, size: Array) -> tuple[Array, dict[str, float]]:
        """Return (T, n) torque of a cause of sizes (n,) [N·m], and the parameter of each row."""
        if job.cause not in EFFECTS:  # of another package: linear, by its own columns
            cause, data = cause_named(job.cause), self.replay.data
            columns = [next(filtered_columns(cause, data, j, [()]))[:, 0] for j in range(data.n)]
            shown = {str(j + 1): float(size[j]) for j in np.flatnonzero(size)}
            return size * np.stack(columns, axis=1), shown
        effect, same = EFFECTS[job.cause], self.bare.rigid
        parameters: dict[str, float] = {}
        world = copy.deepcopy(self.bare, {id(same): same})
        for j in [0] if job.what.arm_wide else np.flatnonzero(size):
            value = effect.value(world, int(j), float(size[j]))
            truth = effect.hide(world, int(j), value, None)
            first = np.ravel(next(iter(truth.values()), value))[0]
            parameters[str(0 if job.what.arm_wide else j + 1)] = float(first)
        return self.torque_of(world), parameters

    def sizes(self, job: CauseJob) -> tuple[Array, Array, Array]:
        replay = self.replay
        whole = np.sqrt(np.mean(np.square(replay.data.nominal), axis=0))
        small = self._size(job, replay.noise)
        large = self._size(job, np.maximum(LARGE_NOISE * replay.noise, LARGE_SHARE * whole))
        return small, np.sqrt(small * large), large

    def _size(self, job: CauseJob, target: Array) -> Array:
        """Return (n,) sizes with torques of a root mean square (n,) [N·m]; 0 where there is none.

        For a cause that all joints show, one joint reaches its target, the others stay below it.
        Sizes end at the largest.
        """
        effect = EFFECTS.get(job.cause)
        start, largest = (effect.start, effect.largest) if effect else (0.01, np.inf)
        size = np.zeros(self.replay.data.n)
        size[list(job.joints)] = start
        for _ in range(STEPS):
            torque = self.replay.in_band(self.hidden(job, size)[0])
            ratio = np.sqrt(np.mean(np.square(torque), axis=0)) / target
            if job.what.coupled or job.what.arm_wide:
                ratio = np.full_like(ratio, ratio.max())
            size = np.where(ratio > NO_TORQUE, size, 0.0)
            before = size
            size = np.minimum(size / np.maximum(ratio, NO_TORQUE), largest)
            if np.allclose(size, before, rtol=CLOSE):
                break
        return size

    def run(self, job: CauseJob, size: Array, seed: int, number: int) -> RehearsalRun:
        replay = self.replay
        sizes: dict[str, float] = {}
        hidden = np.zeros_like(replay.data.q)
        if job.cause != NOTHING:
            hidden, sizes = self.hidden(job, size)
            if job.what.expected:  # it refines dry friction
                hidden = hidden + replay.unknown_friction * self.dry / replay.friction
        logs = replay.logs(hidden, [seed, zlib.crc32(job.key.encode()), number])
        said = replay.diagnose(logs, seed)
        named = [[c.name, list(c.joints), list(c.confused_with)] for c in said.causes]
        return {"sizes": sizes, "named": named, "minor": [c.name for c in said.minor]}


def link_behind_gear(data: Data, joint: int, stiffness: float) -> tuple[Array, Array]:
    """Return (T,) the link's angle less the motor's, δ [rad], and its speed [rad/s].

    M δ̈ = −L − K δ − D δ̇, where L is the load at the link's angle, to first order in δ, and K the
    ``stiffness`` of the gear [N·m/rad]; ``joint`` counts from 0.
    """
    model, nudge = data.pinocchio, 1e-5
    mass = mass_matrices(model, data.q)[:, joint, joint]
    moved = np.array(data.q)
    moved[:, joint] += nudge
    load = data.recording.rigid[:, joint]
    slope = (inverse_dynamics(model, moved, data.dq, data.ddq)[:, joint] - load) / nudge
    steps = int(np.ceil(np.sqrt(stiffness / mass.min()) * data.dt / TURN))
    out = np.zeros((len(mass), 2))
    for run in data.runs():
        swing(load[run], slope[run], mass[run], stiffness, DAMPING, data.dt, steps, out[run])
    return out[:, 0], out[:, 1]


@compiled
def swing(
    load: Array,
    slope: Array,
    mass: Array,
    stiffness: float,
    ratio: float,
    dt: float,
    steps: int,
    out: Array,
) -> None:
    """Put δ and its speed into ``out`` (K, 2), from rest on the gear; semi-implicit Euler."""
    x = -load[0] / stiffness
    v, h = 0.0, dt / steps
    out[0, 0] = x
    for k in range(1, len(load)):
        for s in range(steps):
            part = (s + 1) / steps
            now = load[k - 1] + part * (load[k] - load[k - 1])
            force = -now - slope[k] * x - stiffness * x
            force -= 2 * ratio * np.sqrt(stiffness * mass[k]) * v
            v += h * force / mass[k]
            x += h * v
        out[k, 0], out[k, 1] = x, v
