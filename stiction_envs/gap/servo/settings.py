"""Constants of going from servo logs to causes; values are in the room's ``settings.toml``."""

from __future__ import annotations

from dataclasses import dataclass

from stiction_envs.method_settings import Count, Positive, Share


@dataclass(frozen=True, kw_only=True)
class ServoQuestionSettings:
    """What is asked about a joint."""

    most_seconds: Positive
    """Time of the logs on which causes are chosen [s]; segments beyond it only refine."""
    gravity_seen: Positive
    """Least sag of a joint by gravity over the angle's resolution that scales its servo's stiffness
    [-]."""
    least_gravity: Positive
    """Largest gravity of a joint that counts as one without [N·m], as of `friction.model`."""
    calm_rows: Count
    """Rows for which a command rests where the angle's noise is taken."""
    least_calm: Count
    """Least rows that show it."""
    moves: Positive
    """Least range of a joint's command over the resolution for it to be diagnosed [-]."""
    unknown_stiffness: Positive
    """Stiffness of a servo of which nothing is known [N·m/rad]; the notes say so."""


@dataclass(frozen=True, kw_only=True)
class ServoLimitSettings:
    """What may be a limit: none that is reached most of the time, and none that was passed."""

    passed_seconds: Positive
    """Time over which a speed counts as passed [s]."""
    passed_percent: Positive
    """Percentile of such speeds that counts as the largest [%]."""
    passed: Share
    """Least speed limit over the largest speed that was passed [-]."""
    often_percent: Positive
    """Percentile of the distance from the command that no torque limit lies below [%]."""
    reached_percent: Positive
    """Percentile of torque and speed that counts as reached [%]; starts lie around it."""


@dataclass(frozen=True, kw_only=True)
class ServoSelectionSettings:
    """Which causes a joint needs."""

    block_seconds: Positive
    """Length of a block of time [s]; longer than the memory of a servo's error."""
    least_blocks: Count
    """Blocks with fewer than this show nothing."""
    least_t: Positive
    """Least mean over standard error of what a cause takes off the blocks' squares [-]."""
    one_way: Positive
    """Least sum of what blocks lose over what others gain without a cause [-]: a limit acts in few
    blocks, which differ too much for a mean, but all in one direction."""
    one_way_blocks: Count
    """Blocks that must lose then."""
    least_gain: Share
    """Least share of the joint's root mean square that a cause must take off [-]."""
    least_noise: Positive
    """Least root mean square that a cause takes off, over the noise floor [-]."""
    links_leave: Positive
    """Largest error over the noise floor that links a little off leave, and that needs no cause
    [-]; simulated arms of 5 % scatter leave up to 7 (`hidden.servo_logs`)."""
    links_off: Share
    """Share by which a joint's gravity may be off without a cause: every link is a little off
    [-]."""
    softer: Positive
    """Logarithm of the ratio of stiffnesses that links of 5 % scatter may look like [-]."""
    shifted: Positive
    """Offset of an angle that such links may look like [rad]: 5 mm of a centre 40 mm away."""
    perfect: Positive
    """Stiffness of a servo that counts as perfect over that of the joint's own [-]."""
    alike: Share
    """Least correlation of two parameters that this log hardly tells apart [-]."""
    minor: Share
    """Share of a joint's nominal error below which what a cause takes off is minor [-]."""


@dataclass(frozen=True, kw_only=True)
class ServoContactSettings:
    """When a joint touches something: it stands far from its command and stalls."""

    far_off: Positive
    """Least error of the fitted model in contact, over its usual size [-]."""
    stretched: Positive
    """Least distance from the command in contact, over the largest elsewhere [-]."""
    elsewhere_percent: Positive
    """Percentile that counts as the largest [%]."""
    suspect: Positive
    """Distance from the command over the usual one that is suspected [-]."""
    usual_percent: Positive
    """Percentile that counts as usual [%]."""
    stalled: Positive
    """Largest speed in contact, over the mean of the fastest [-]."""
    moving_percent: Positive
    """Percentile above which speeds are the fastest [%]."""
    around_seconds: Positive
    """Left out before and after a contact [s]."""
    most: Share
    """Largest share of the rows: more is no contact but another cause [-]."""


@dataclass(frozen=True, kw_only=True)
class ServoValidationSettings:
    """How a model is held out and checked."""

    fold_seconds: Positive
    """Length of the blocks of time that are held out in turn [s]."""
    worse: Positive
    """Least error of the extended model over the nominal one on other logs that is worse [-]."""


@dataclass(frozen=True, kw_only=True)
class ServoPayloadSettings:
    """When a body at the flange is proposed and accepted."""

    row_seconds: Positive
    """Time between the rows of the regression [s]."""
    block_seconds: Positive
    """Blocks of time whose scatter gives the interval [s]."""
    slow: Positive
    """Speed at which dry friction is nearly its level [rad/s]."""
    links_off: Positive
    """Usual error of a joint's gravity because links are a little off [-]."""
    zero_off: Positive
    """Usual error of a joint's zero [rad]."""
    usual_mass: Positive
    """Usual mass that is not in the model [kg]."""
    reach: Positive
    """Usual distance of its centre from the flange [m]."""
    rounds: Count
    """Rounds of weighing the joints by their error."""
    least_t: Positive
    """Least mass over its standard error to be tried [-]."""
    acts: Share
    """Least gravity of the body on a joint that it is named on, over its largest [-]."""
    loaded: Share
    """Least gravity of a loaded joint over that of the most loaded one [-]."""
    least_share: Share
    """Gravity of the body over a loaded joint's own [-] below which it must spare causes."""
    parameters: Count
    """Parameters of a body, each as dear as a cause [-]."""


@dataclass(frozen=True, kw_only=True)
class ServoSettings:
    """All constants of servo logs."""

    questions: ServoQuestionSettings
    """What is asked."""
    limits: ServoLimitSettings
    """What may be a limit."""
    selection: ServoSelectionSettings
    """Which causes are needed."""
    contact: ServoContactSettings
    """Stretches that are left out."""
    payload: ServoPayloadSettings
    """A body at the flange."""
    validation: ServoValidationSettings
    """Held-out errors."""
