"""Feedforward of the reference's motion.

    τ = g · tanh(q̇_d/v),   q̇_d = J^# ẋ_d,   J^# = Jᵀ (J Jᵀ + λ²)⁻¹

with g the breakaway torque, ẋ_d the twist of the reference and λ the damping of the controller's
own pseudoinverse. It is zero wherever the reference rests, so an error left at a goal stays.
The law is that of i2rt-robotics/i2rt#37, which takes the measured speed; with the desired one
(robotology/gazebo-yarp-plugins#471) it also acts before the joint moves, and cannot chatter.
On the Panda's paths q̇_d has the sign of the joints' speed in 90 to 99 % of all samples in which
they move, except for joint 4 of the triangle; M⁻¹ Jᵀ Λ ẋ_d instead of J^# ẋ_d gives the same.
"""

from typing import ClassVar

import numpy as np

from stiction_envs.control.laws.base import WANTED_SPEED, Array, Law, smoothing_speed

_SPEED = 0.025  # [rad/s], almond-bot/axol#310: friction_k_max 400, 66 % at 0.02 rad/s


class Feedforward(Law):
    """Friction in the sense of the reference's speed."""

    name: ClassVar = "feedforward"
    words: ClassVar = "feedforward of friction"
    what: ClassVar = "friction in the sense of the reference's motion"
    knows: ClassVar = "the friction and the reference's speed; no measurement"
    fields: ClassVar = (smoothing_speed(_SPEED),)
    feeds: ClassVar = True

    @staticmethod
    def torque(numbers: Array, seen: Array, state: Array, period: float) -> float:
        """Return g tanh(q̇_d/v) [N·m]."""
        return numbers[0] * np.tanh(seen[WANTED_SPEED] * numbers[1])


LAW = Feedforward()
