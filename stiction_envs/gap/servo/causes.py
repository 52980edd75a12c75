"""The causes that servo logs alone show, a class each; one line here registers a cause.

Those that joint logs show too are in `gap.causes`. Other packages add a cause by `register`: its
field `servo` says which parameters of a joint it changes.
"""

from stiction_envs.gap.causes import Cause, Parameter, cause_named, register
from stiction_envs.gap.causes.registry import IN_SERVO, registered
from stiction_envs.gap.servo.servo_parameters import INDEX, InServo

LAG = ("damping", "armature", "delay")
"""Causes, each with a parameter of its name, whose sum, the lag, a log shows better than each."""
SHARES = (0.12, 0.2, 0.3, 0.45, 0.65, 0.9)
"""Limits from which fits start, over what is reached [-]; assumed."""
FREQUENCIES = "commands of several frequencies, up to where the joint hardly follows"


def causes_of_joints() -> dict[str, InServo]:
    """Return the causes that the evidence of one joint may show, in the order of parameters."""
    some = {c.name: c.servo for c in registered(IN_SERVO) if c.servo.sizes}
    return dict(sorted(some.items(), key=lambda x: INDEX[next(iter(x[1].sizes))]))


def servo_cause(name: str) -> Cause:
    """Return a cause that servo logs show."""
    return cause_named(name, IN_SERVO)


class ServoStiffness(Cause):
    """The servo is softer or stiffer."""

    name = "servo_stiffness"
    parameters = (Parameter("stiffness_nm_per_rad", "N·m/rad"),)
    servo = InServo(
        sizes={"stiffness": 0.7},
        starts=lambda x: [{"stiffness": 0.6 * x["stiffness"]}, {"stiffness": 1.7 * x["stiffness"]}],
        stage=0,
        of_gravity=True,
        evidence="the arm sags under gravity by its torque over {value:.3g} N·m/rad",
        alike=("payload", "encoder_offset", "link_parameters"),
        tells_apart="its stiffness, from the data sheet, as --servo-stiffness",
    )


class Damping(Cause):
    """The servo brakes more or less."""

    name = "damping"
    parameters = (Parameter("damping_nms", "N·m·s/rad"),)
    servo = InServo(
        sizes={"damping": 0.1},
        starts=lambda x: [
            {"damping": x["damping"] + 0.03 * x["stiffness"]},
            {"damping": 0.5 * x["damping"]},
        ],
        stage=0,
        of_every_joint=True,
        evidence="the angle follows the command late, the more the faster it moves",
        tells_apart=FREQUENCIES,
    )


class Armature(Cause):
    """The rotor has inertia."""

    name = "armature"
    parameters = (Parameter("armature_kgm2", "kg·m²"),)
    servo = InServo(
        sizes={"armature": 0.003},
        starts=lambda x: [
            {"armature": x["armature"] + more * x["stiffness"]} for more in (0.0005, 0.003)
        ],
        stage=0,
        of_every_joint=True,
        evidence="the angle overshoots or lags where the command accelerates",
        tells_apart=FREQUENCIES,
    )


class Delay(Cause):
    """The command acts later; below 0 earlier."""

    name = "delay"
    parameters = (Parameter("delay_s", "s"),)
    servo = InServo(
        sizes={"delay": 0.03},
        starts=lambda x: [{"delay": 0.02}],
        stage=0,
        of_every_joint=True,
        evidence="the angle repeats the command later by a constant time",
        below_zero="the angle comes before its command moves it: its stamps are late, or the "
        "controller adds kd · dq_cmd, so that the joint follows q_cmd + kd / kp · dq_cmd",
        tells_apart=FREQUENCIES,
    )


class ServoLag(Cause):
    """Damping, armature and delay together, where the log does not show which of them it is."""

    name = "servo_lag"
    parameters = (Parameter("lag_s", "s"),)
    servo = InServo(
        reported={"lag_s": (("delay", "damping", "stiffness"), lambda t, d, k: t + d / k)},
        evidence="the angle follows the command late, by delay and damping over stiffness together",
    )


class TorqueLimit(Cause):
    """The servo saturates."""

    name = "torque_limit"
    parameters = (Parameter("limit_nm", "N·m"),)
    servo = InServo(
        sizes={"torque_limit": 0.7},
        starts=lambda x: [{"torque_limit": share * x["torque"]} for share in SHARES],
        evidence="the joint falls behind large commands at a constant torque",
        tells_apart="the same fast motion with and without a known mass",
    )


class SpeedLimit(Cause):
    """The servo is slow."""

    name = "speed_limit"
    parameters = (Parameter("limit_rad_s", "rad/s"),)
    servo = InServo(
        sizes={"speed_limit": 0.7},
        starts=lambda x: [{"speed_limit": share * x["speed"]} for share in SHARES],
        evidence="the joint falls behind fast commands at a constant speed",
        alike=("torque_limit",),
    )


class DeadZone(Cause):
    """The servo is idle near its goal."""

    name = "dead_zone"
    parameters = (Parameter("width_rad", "rad"),)
    servo = InServo(
        sizes={"dead_zone": 0.015},
        starts=lambda x: [{"dead_zone": 0.003}, {"dead_zone": 0.015}],
        reported={"width_rad": (("dead_zone",), lambda half: 2.0 * half)},
        stage=4,
        evidence="the joint rests anywhere near its command",
        alike=("coulomb_friction",),
    )


class ExternalContact(Cause):
    """Something is touched; no fit shows it, but where the joint stands."""

    name = "external_contact"
    servo = InServo(
        evidence="the joint stalls far from its command in some stretches only",
        alike=("torque_limit",),
        tells_apart="the same motion with nothing within reach",
    )


for _cause in (
    *(ServoStiffness, Damping, Armature, Delay, ServoLag),
    *(TorqueLimit, SpeedLimit, DeadZone, ExternalContact),
):
    register(_cause())
