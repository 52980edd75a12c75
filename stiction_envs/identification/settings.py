"""Constants of exciting motions; values are in ``settings.toml``."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated

import msgspec

from stiction_envs.method_settings import Count, NotNegative, Positive, Share, load_settings


@dataclass(frozen=True, kw_only=True)
class ExcitationSettings:
    """An exciting motion."""

    base_frequency: Positive
    """Base frequency of the Fourier series [Hz]."""
    harmonics: Annotated[int, msgspec.Meta(ge=2)]
    """Number of harmonics of the base frequency."""
    periods: Count
    """Number of periods of the series."""
    position_margin: NotNegative
    """Distance kept from each end of a joint's range [rad]."""
    velocity_part: Share
    """Part of the speed limit that is used [-]."""
    acceleration_part: Share
    """Part of the acceleration limit that is used [-]."""
    acceleration_free: NotNegative
    """Acceleration limit of joints that have none [rad/s²]."""
    torque_part: Share
    """Part of the torque limit that the arm may need, without friction [-]."""
    clearance: NotNegative
    """Least distance to the floor and between links [m]."""
    starts: Count
    """Number of searches from different random motions."""
    iterations: Count
    """Generations of each search."""
    randoms: Count
    """Number of random motions for comparison."""

    @property
    def period(self) -> float:
        """Period of the series [s]."""
        return 1.0 / self.base_frequency


@cache
def excitation_settings() -> ExcitationSettings:
    """Return the defaults."""
    return load_settings(ExcitationSettings, Path(__file__).with_name("settings.toml"))
