"""Constants of going from logs to causes; values are in ``settings.toml``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import get_type_hints

from stiction_envs.gap.servo.settings import ServoSettings
from stiction_envs.gap.tables.settings import TableSettings
from stiction_envs.measured.settings import MeasuredSettings, MotionThresholds, measured_settings
from stiction_envs.method_settings import Count, NotNegative, Positive, Share, load_settings

PATH = Path(__file__).with_name("settings.toml")


@dataclass(frozen=True, kw_only=True)
class RecordingSettings:
    """How the logs' time is cut into held-out blocks."""

    blocks: Count
    """Blocks of time, over all logs, that are held out in turn: enough to see their spread."""


@dataclass(frozen=True, kw_only=True)
class NoiseSettings:
    """The noise floor of the residual."""

    least_noise: Positive
    """Least noise that is assumed [N·m], so that perfect data do not divide by zero."""
    seen: Positive
    """Least change of a torque, over the noise floor, for it to be visible [-]."""
    clear: Positive
    """The same for a torque that scales or shifts what a cause adds [-]."""


@dataclass(frozen=True, kw_only=True)
class CandidateSettings:
    """How rows of the logs are weighted."""

    huber: Positive
    """Residuals beyond this many robust standard deviations have less weight [-]."""
    uncertain: Share
    """Weight of rows in which a joint rests away from its steady level of friction [-]. The logs
    hardly show how far it sprang back, so its torque is known only to about 0.2 of its friction,
    five times the noise of a good log."""
    given: NotNegative
    """Assumed relative error of the nominal model's friction, where it is given [-]."""
    diagnosed: NotNegative
    """The same where an earlier diagnosis identified the friction [-]."""
    edge: Positive
    """A nonlinear parameter within this factor of the last value tried is at the end [-]."""
    prior_rows: Positive
    """Weight of a prior as a number of independent observations at the noise floor [-]; models
    leave more than the noise."""


@dataclass(frozen=True, kw_only=True)
class SelectionSettings:
    """When a cause is significant, and how to choose between two significant ones."""

    chance: Share
    """Chance that noise leads to any cause at all, shared by all hypotheses tried [-]."""
    clear: Share
    """Part of a joint's held-out squared error that noise never explains [-]: it has thousands of
    rows. A cause that explains more needs no correction for the number of hypotheses tried."""
    least_torque: Positive
    """Least root mean square torque of a cause over the noise floor of some joint [-]."""
    refinement: Positive
    """Least part of the torque of a joint's approximate causes that a refinement must have [-]; no
    better law of friction is known. Base friction is not a refinement."""
    as_good: Share
    """A cause is as good as another if it explains all but this part of the other's gain [-]."""
    as_good_errors: Positive
    """The same in standard errors, unless the part is more than five times as large [-]."""
    pair_error: Positive
    """Held-out error of a joint over its noise above which pairs of causes are tried [-]."""
    shortlist: Count
    """Causes per joint whose held-out error is computed in each round."""


@dataclass(frozen=True, kw_only=True)
class AngleRangeSettings:
    """When a torque over the angle predicts angles that were left out."""

    ranges: Count
    """Ranges of a joint's angle that are left out in turn; the joint travels as far in each."""
    chance: Share
    """Chance that noise passes this test, given that it passed the blocks of time [-]."""


@dataclass(frozen=True, kw_only=True)
class EstimateSettings:
    """Parameters of the causes, and their intervals."""

    resamples: Count
    """Resamples of the blocks."""
    interval: Positive
    """Half width of an interval in standard deviations of the resamples [-]: Student's t of 11
    degrees of freedom."""
    model_error: NotNegative
    """Relative error that any model has at best, as a part of a value [-]."""
    hardly_own: Positive
    """Part of a cause's own gain that it may lose to another that explains the same [-]."""


@dataclass(frozen=True, kw_only=True)
class VerdictSettings:
    """When nothing is left to explain."""

    close: Positive
    """Held-out error over the noise floor below which nothing is left [-]."""
    small: Positive
    """The same over a joint's whole torque, root mean square [-]."""
    minor: Positive
    """Part of the nominal residual, mean over joints, below which a cause is minor [-]."""
    minor_error: Positive
    """A minor cause's removal also increases no joint's held-out error by more than this [-]."""


@dataclass(frozen=True, kw_only=True)
class GapSettings:
    """All settings of this package, and of the logs it reads."""

    measured: MeasuredSettings
    """When a joint moves."""
    recording: RecordingSettings
    """Held-out blocks of time."""
    noise: NoiseSettings
    """The noise floor."""
    candidates: CandidateSettings
    """Weights of rows."""
    selection: SelectionSettings
    """The significance of causes."""
    angle_ranges: AngleRangeSettings
    """Torques over the angle."""
    estimates: EstimateSettings
    """The causes' parameters."""
    verdict: VerdictSettings
    """When nothing is left to explain."""
    tables: TableSettings
    """Torque tables."""
    servo: ServoSettings
    """Servo logs."""

    @property
    def motion(self) -> MotionThresholds:
        """When a joint moves, as in `measured`."""
        return self.measured.motion


@cache
def gap_settings() -> GapSettings:
    """Return the defaults."""
    kinds = get_type_hints(GapSettings)
    own = {x: load_settings(kinds[x], PATH, x) for x in kinds if x != "measured"}
    return GapSettings(measured=measured_settings(), **own)
