"""The causes that torque tables alone show, a class each; one line here registers a cause.

`torque_offset` and `direction_asymmetry`, which logs show too, are in `gap.causes`. Other packages
add a cause by `register`; `gap.causes.base.Cause` says how, and `SimulatedCause` does most of it.
"""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import ClassVar

import numpy as np

from stiction_envs.arrays import Array, Index
from stiction_envs.experiments.poses import Poses
from stiction_envs.experiments.sje.calibrate import with_levels
from stiction_envs.experiments.sje.protocol import LOADS
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.causes import Cause, register, registry
from stiction_envs.gap.causes.log.torque_offset import THIRD_POSE
from stiction_envs.gap.tables.data import FRICTION_LEVEL, Effect, SimulatedQuantity, TableData

registered = partial(registry.registered, registry.IN_TABLES)
cause_named = partial(registry.cause_named, method=registry.IN_TABLES)
ANYTHING_ELSE = "dithered torques at other frequencies and amplitudes"

TRIALS = (-1.8, -0.8, -0.3, 0.3, 0.8, 1.8)
"""Logarithms of the factor to try, over its prior size [-]; assumed."""
LOW_PASS = SimulatedQuantity(fields=("lowpass_hz",), of_interface=True, low=8.0, high=1000.0)
"""Cut-off of a low-pass [Hz]; the range is assumed."""
LOW_PASS_SIZE = 0.7
"""Prior size of the logarithm of the cut-off [-]; assumed."""
CUTOFFS = 25
"""Number of cut-offs to try; assumed."""
OTHER_JOINTS = "the same dither on the other joints: a filter acts on all of them"
SAME_DAY = "base and dithered torques measured in turn on one day"
GRAVITY_SHARE = 0.05
"""Prior size of an error of the gravity model, over gravity [-]; assumed: of links."""
MOST_GRAVITY = 0.5
"""Largest error of the gravity model, over gravity [-]; assumed: with more it is another arm."""
BAD_SIZE = 0.5
"""Prior size of a bad reading's error over friction [-]; assumed."""
CALIBRATED, MOST_BAD = 0.1, 0.8
"""Prior size, and largest error of a base torque to which friction was calibrated, over friction
[-]; assumed."""
RARE = 1.0
"""Log odds against bad readings [nats]; assumed."""
BASE_AGAIN = "the base torque measured again"


class SimulatedCause(Cause):
    """A factor on friction parameters of a joint."""

    quantity: ClassVar[SimulatedQuantity]
    absolute: ClassVar[str] = ""
    """Name of the parameter's value in its own unit; empty for none."""
    log_size: ClassVar[float] = 0.5
    """Prior size of the factor's logarithm [-]; assumed."""

    def in_tables(self, data: TableData) -> Iterator[Effect]:
        """Yield the factor on each joint."""
        for j, rows in data.of_joint.items():
            unit = float(np.mean(getattr(data.whole.friction, self.quantity.fields[0])[j - 1]))
            yield Effect(
                self.name,
                (j,),
                rows,
                size=self.log_size,
                trials=TRIALS,
                quantity=self.quantity,
                parameters={"factor": 1.0} | ({self.absolute: unit} if self.absolute else {}),
                log=True,
            )

    def in_words(self, values: Mapping[str, float]) -> str:
        """Return the factor in words."""
        return f"{values['factor']:.2f} times the {self.quantity.fields[0].replace('_', ' ')}"

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> Mapping[str, Array | float]:
        """Return the friction parameters times the factor."""
        return {f: getattr(friction, f)[j] * values["factor"] for f in self.quantity.fields}


class RotorInertia(SimulatedCause):
    """Dithered torques are off, most near resonance."""

    name, absolute = "rotor_inertia", "armature_kgm2"
    quantity = SimulatedQuantity(fields=("rotor_inertia",), low=0.2, high=5.0)
    """The range is assumed."""
    tell_apart: ClassVar[Mapping[str, str]] = {
        "presliding": "dither well below the presliding resonance (half of √(σ0/J)/2π): there "
        "inertia plays no part",
        "base_drift": SAME_DAY,
        "friction_level": "the free joint shaken at 50 to 80 Hz above breakaway: its acceleration "
        "shows the inertia",
    }


class Presliding(SimulatedCause):
    """Dithered torques are off where dither is near √(σ0/J)/2π."""

    name, absolute = "presliding", "bristle_stiffness"
    quantity = SimulatedQuantity(fields=("bristle_stiffness",), low=0.1, high=10.0)
    """The range is assumed."""
    log_size = 0.7
    tell_apart: ClassVar[Mapping[str, str]] = {"base_drift": SAME_DAY, "friction_level": SAME_DAY}


class LowPass(Cause):
    """One cut-off for the dither of all joints."""

    name = "low_pass"
    words = "a cut-off of {cutoff_hz:.3g} Hz"
    not_in_friction = "a low-pass of {cutoff_hz:.4g} Hz on the commanded torque is the interface's"
    tell_apart: ClassVar[Mapping[str, str]] = {
        "rotor_inertia": OTHER_JOINTS,
        "presliding": OTHER_JOINTS,
        "base_drift": SAME_DAY,
    }

    def in_tables(self, data: TableData) -> Iterator[Effect]:
        """Yield one effect on all joints."""
        neutral = data.whole.neutral(LOW_PASS)
        ends = np.log(np.array([LOW_PASS.low, LOW_PASS.high]) / neutral) / LOW_PASS_SIZE
        yield Effect(
            self.name,
            data.joints,
            np.arange(len(data.jobs)),
            size=LOW_PASS_SIZE,
            trials=tuple(x for x in np.linspace(ends[0], ends[1], CUTOFFS).tolist() if x),
            quantity=LOW_PASS,
            parameters={"cutoff_hz": neutral},
            log=True,
        )


class FrictionLevel(Cause):
    """Base and dithered torques are off by one factor, in both poses or in one."""

    name = "friction_level"
    log_size: ClassVar[float] = 0.15
    """Prior size of the factor's logarithm [-]; assumed: change by temperature and wear."""
    tell_apart: ClassVar[Mapping[str, str]] = {"base_drift": BASE_AGAIN}

    def scopes(self, data: TableData, joint: int) -> Iterator[tuple[str, Index]]:
        """Yield the readings of a joint of both poses, and of each by its name."""
        rows = data.of_joint[joint]
        yield "", rows
        yield from ((load, rows[data.pose[rows] == k]) for k, load in enumerate(LOADS))

    def in_tables(self, data: TableData) -> Iterator[Effect]:
        """Yield a factor on friction in each scope."""
        for j in data.joints:
            for scope, rows in self.scopes(data, j):
                yield Effect(
                    self.name,
                    (j,),
                    rows,
                    scope=scope,
                    size=self.log_size,
                    most=float(np.log(FRICTION_LEVEL.high)),
                    level=float,
                    parameters={f"factor {scope}".strip(): 1.0},
                    log=True,
                )

    def in_words(self, values: Mapping[str, float]) -> str:
        """Return the factors in words."""
        return "dry friction times " + ", ".join(
            f"{v:.3g} {k.removeprefix('factor')}".strip() for k, v in values.items()
        )

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> Mapping[str, Array | float] | str:
        """Return friction in both poses with it."""
        scopes = ([f"factor {load}", "factor"] for load in LOADS)
        factors = np.array([np.prod([values[k] for k in x if k in values]) for x in scopes])
        if factors[0] == factors[1]:
            names = ("stiction", "load_coefficient")
            return {k: getattr(friction, k)[j] * factors[0] for k in names}
        both = [friction.stiction_at(poses.load[:, k]).mean(axis=1) for k in range(len(LOADS))]
        level = np.stack(both, axis=1)
        level[j] *= factors
        offset = friction.offset[:, None] + friction.gravity_error[:, None] * poses.signed
        line = with_levels(friction, poses, level, offset)
        names_of_line = ("stiction", "load_coefficient", "load_low", "load_high")
        return {k: getattr(line, k)[j] for k in names_of_line}


class BaseDrift(FrictionLevel):
    """Dithered torques are off by one factor, and base torques are not: friction moved between."""

    name = "base_drift"
    log_size = 0.1
    in_friction, not_in_friction = Cause.in_friction, "friction of another day"
    tell_apart: ClassVar[Mapping[str, str]] = {"corrupted_cell": BASE_AGAIN}

    def scopes(self, data: TableData, joint: int) -> Iterator[tuple[str, Index]]:
        """Yield both poses, each pose, and each configuration."""
        for scope, rows in super().scopes(data, joint):
            yield scope, rows[~data.base[rows]]
        for where, rows in data.dithered(joint).items():
            yield f"{where.load} {where.direction}", rows


class GravityError(Cause):
    """An offset in proportion to the load of the pose."""

    name = "gravity_error"
    tell_apart: ClassVar[Mapping[str, str]] = {"direction_asymmetry": THIRD_POSE}

    def in_tables(self, data: TableData) -> Iterator[Effect]:
        """Yield a share of each joint's load."""
        load = data.sign * data.whole.poses.signed[data.joint - 1, data.pose]
        for j, rows in data.of_joint.items():
            yield Effect(
                self.name,
                (j,),
                rows,
                size=GRAVITY_SHARE,
                most=MOST_GRAVITY,
                trials=(1.0,),
                torque=load[rows],
                parameters={"share_of_gravity": 1.0},
            )

    def in_words(self, values: Mapping[str, float]) -> str:
        """Return the share in words."""
        return f"{100 * values['share_of_gravity']:+.2g} % of the joint's gravity torque"

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> Mapping[str, Array | float]:
        """Return the error of the gravity model with it."""
        return {"gravity_error": friction.gravity_error[j] + values["share_of_gravity"]}


class CorruptedCell(Cause):
    """A reading far from what the model says, while its neighbours and repeats are not.

    A base torque may be bad although the simulation agrees with it: friction was calibrated to it,
    and then all dithered torques of its configuration are off by one factor.
    """

    name = "corrupted_cell"
    words = "a bad reading, {error_nm:+.3g} N·m off"
    not_in_friction = "a bad reading"

    def in_tables(self, data: TableData) -> Iterator[Effect]:
        """Yield each reading, and each base torque to which friction was calibrated."""
        for i, (joint, unit) in enumerate(zip(data.joint.tolist(), data.unit, strict=True)):
            yield Effect(
                self.name,
                (joint,),
                np.array([i]),
                scope=str(i),
                size=BAD_SIZE * float(unit),
                trials=(1.0,),
                odds=RARE,
                torque=np.ones(1),
                parameters={"error_nm": float(data.sign[i])},
                bad=True,
            )
        for joint in data.joints:
            for where, rows in data.dithered(joint).items():
                yield Effect(
                    self.name,
                    (joint,),
                    rows,
                    scope=f"base of {where}",
                    size=CALIBRATED,
                    odds=RARE,
                    most=MOST_BAD,
                    level=lambda x: -np.log1p(x),
                    parameters={"error_nm": float(data.sign[rows[0]] * data.unit[rows[0]])},
                    bad=True,
                )


def what_tells_apart(one: str, other: str) -> str:
    """Return the measurement that tells two causes apart; either of the two names it."""
    first, second = cause_named(one).tell_apart, cause_named(other).tell_apart
    return first.get(other) or second.get(one) or ANYTHING_ELSE


for _cause in (
    *(LowPass, RotorInertia, Presliding),
    *(GravityError, FrictionLevel, BaseDrift, CorruptedCell),
):
    register(_cause())
