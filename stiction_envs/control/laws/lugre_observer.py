"""Friction observer of the LuGre model (Canudas de Wit, Olsson, Åström, Lischinsky 1995).

    dẑ/dt = q̇ − σ0 |q̇|/g(q̇) ẑ + k e_j,   g(q̇) = F_c + (F_s − F_c) e^(−(q̇/v_s)²)
    τ     = σ0 ẑ + σ1 dẑ/dt + σ2 q̇

equations 4 and 5 of the model and section V of the paper (IEEE Trans. Automatic Control 40:3): the
bristle is estimated from the measured speed, and the tracking error, here the e_j of `push`,
corrects it with gain k [1/s] (the paper's −k e, its e being angle less reference). At rest the
correction makes ẑ an integral of the error, so it is bounded: |ẑ| <= F_s/σ0, which no bristle in
sliding exceeds. Over a cycle the speed is taken as constant and ẑ follows exactly, as the plant's
own bristle does (`friction.lone_joint`).
"""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from stiction_envs.control.laws.base import ERROR, SPEED, Array, Field, Law, breakaway, coulomb
from stiction_envs.friction.lone_joint import bristle_after
from stiction_envs.friction.parameters import FrictionParameters

_DAMPING = 0.0  # [N·m·s/rad], assumed: without σ1, which amplifies the noise of the speed
_INJECTION = 0.1
"""k [1/s], assumed: a bristle grows by its presliding distance within a second at a joint error of
ten of them."""
_SLOWEST = 1e-15  # decay of a bristle in a cycle, far below any effect; avoids 0/0 [-]


class LuGreObserver(Law):
    """Friction of an estimated bristle."""

    name: ClassVar = "lugre_observer"
    words: ClassVar = "LuGre friction observer"
    what: ClassVar = "friction of an observed LuGre bristle, corrected by the joint error"
    knows: ClassVar = "all of the friction (LuGre), angles and a speed"
    fields: ClassVar = (
        Field(name="coulomb", column="coulomb_nm", unit="N·m", positive=True,
              scales=True),
        Field(name="speed", column="speed_rad_s", unit="rad/s", positive=True,
              inverse=True),
        Field(name="stiffness", column="stiffness_nm_rad", unit="N·m/rad",
              positive=True, scales=True),
        Field(name="damping", column="damping_nms_rad", unit="N·m·s/rad",
              default=_DAMPING, scales=True),
        Field(name="viscous", column="viscous_nms_rad", unit="N·m·s/rad", default=0.0, scales=True),
        Field(name="injection", column="injection_1_s", unit="1/s", default=_INJECTION),
    )  # fmt: skip
    searched: ClassVar = ("injection",)
    reads_error: ClassVar = True

    def gains(self, friction: FrictionParameters, load: Array) -> Mapping[str, Array]:
        """Return the parameters of the model; σ1, which amplifies noise, stays at its default."""
        return {
            "gain": breakaway(friction, load),
            "coulomb": coulomb(friction, load),
            "speed": friction.stribeck_velocity.mean(axis=-1),
            "stiffness": friction.bristle_stiffness,
            "viscous": friction.viscous.mean(axis=-1),
        }

    @staticmethod
    def torque(numbers: Array, seen: Array, state: Array, period: float) -> float:
        """Return the force of the estimated bristle [N·m]; state is ẑ [rad]."""
        stiction, coulomb_torque, rate, stiffness = numbers[0], numbers[1], numbers[2], numbers[3]
        v, z = seen[SPEED], state[0]
        ratio = v * rate
        level = coulomb_torque + (stiction - coulomb_torque) * np.exp(-ratio * ratio)
        decay = abs(v) * stiffness / level
        correction = numbers[6] * seen[ERROR]
        change = v - decay * z + correction
        most = stiction / stiffness
        after = bristle_after(z, v, max(decay * period, _SLOWEST), period) + correction * period
        state[0] = min(max(after, -most), most)
        return stiffness * z + numbers[4] * change + numbers[5] * v


LAW = LuGreObserver()
