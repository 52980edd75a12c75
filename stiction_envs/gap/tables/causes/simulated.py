"""Causes that simulations with another value show: of a friction parameter, or of a filter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.experiments.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.causes.base import Cause
from stiction_envs.gap.tables.data import Effect, SimulatedQuantity, TableData

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
