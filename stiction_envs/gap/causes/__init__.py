"""The causes, one module each; one line here registers a cause of the package.

Other packages add one by `register` (see :mod:`stiction_envs.gap.causes.base`).
"""

from stiction_envs.gap.causes.base import Cause, Parameter, Prior, Shape, View
from stiction_envs.gap.causes.body.base_tilt import BaseTilt
from stiction_envs.gap.causes.body.link_inertia import LinkInertia
from stiction_envs.gap.causes.body.link_parameters import LinkParameters
from stiction_envs.gap.causes.body.link_tolerances import LinkTolerances
from stiction_envs.gap.causes.body.payload import Payload
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.causes.friction.coulomb_friction import CoulombFriction
from stiction_envs.gap.causes.friction.direction_asymmetry import DirectionAsymmetry
from stiction_envs.gap.causes.friction.load_dependent_friction import LoadDependentFriction
from stiction_envs.gap.causes.friction.position_dependent_friction import PositionDependentFriction
from stiction_envs.gap.causes.friction.presliding_hysteresis import PreslidingHysteresis
from stiction_envs.gap.causes.friction.stribeck_friction import StribeckFriction
from stiction_envs.gap.causes.friction.viscous_friction import ViscousFriction
from stiction_envs.gap.causes.friction.warm_up_drift import WarmUpDrift
from stiction_envs.gap.causes.gear.joint_elasticity import JointElasticity
from stiction_envs.gap.causes.log.actuator_delay import ActuatorDelay
from stiction_envs.gap.causes.log.encoder_offset import EncoderOffset
from stiction_envs.gap.causes.log.falling_torque import FallingTorque
from stiction_envs.gap.causes.log.gravity_compensation_missing import GravityCompensationMissing
from stiction_envs.gap.causes.log.torque_offset import TorqueOffset
from stiction_envs.gap.causes.log.torque_scale import TorqueScale
from stiction_envs.gap.causes.outside.external_spring import ExternalSpring
from stiction_envs.gap.causes.outside.position_dependent_torque import PositionDependentTorque
from stiction_envs.gap.causes.registry import (
    cause_named,
    parameter_units,
    register,
    registered,
    unregister,
)

CAUSES: tuple[Cause, ...] = tuple(
    register(cause())
    for cause in (
        CoulombFriction,
        ViscousFriction,
        StribeckFriction,
        DirectionAsymmetry,
        LoadDependentFriction,
        PreslidingHysteresis,
        PositionDependentFriction,
        FallingTorque,
        WarmUpDrift,
        TorqueOffset,
        TorqueScale,
        Payload,
        LinkParameters,
        PositionDependentTorque,
        BaseTilt,
        LinkInertia,
        JointElasticity,
        ActuatorDelay,
        EncoderOffset,
        GravityCompensationMissing,
        ExternalSpring,
    )
)
"""The causes of the package, in a fixed order; `registered` returns all causes."""
TOLERANCES = register(LinkTolerances())
"""Small errors of all links, in every model."""

__all__ = [
    "CAUSES",
    "TOLERANCES",
    "Cause",
    "ModelDraft",
    "Parameter",
    "Part",
    "Prior",
    "Shape",
    "View",
    "cause_named",
    "parameter_units",
    "register",
    "registered",
    "unregister",
]
