"""Constants of going from torque tables to causes; values are in the room's ``settings.toml``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from stiction_envs.method_settings import check_numbers, load_settings


@dataclass(frozen=True, kw_only=True)
class ReadingNoiseSettings:
    """How far readings may be off."""

    freedom: float
    """Degrees of freedom of Student's t for dithered torques [-]."""
    huber: float
    """Where the loss of a base torque turns linear [sd]."""
    level_sd: float
    """How far a calibrated friction level may be off [-]."""
    offset_sd: float
    """How far a calibrated offset may be off, over friction [-]."""
    base_sd: float
    """Least noise of a base torque over friction [-]: a single one has no neighbours to tell its
    noise from."""
    least_sd: float
    """Least noise of a reading over friction [-]: what one ramp per cell without scatter differs
    from the mean over dither phases and poses."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class StatementSettings:
    """Ranges of statements, and values that are tried."""

    low_pass: tuple[float, ...]
    """Lowest and highest cut-off [Hz]."""
    rotor_inertia: tuple[float, ...]
    """Lowest and highest factor [-]."""
    presliding: tuple[float, ...]
    """The same [-]."""
    friction_level: tuple[float, ...]
    """The same [-]."""
    most_added: float
    """Largest added torque and asymmetry over friction [-]."""
    most_gravity_error: float
    """Largest error of the gravity model [-]: beyond it is another arm."""
    knots: int
    """Values at which the lone joint is simulated, where only a simulation can follow."""
    level_knots: int
    """The same of the friction level."""
    coarse: int
    """Values of the unknown that are tried over its range."""
    fine: int
    """The same about the best."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class AnchorSettings:
    """Factors at which joints are simulated that the lone joint does not explain."""

    low_pass: tuple[float, ...]
    """[-]."""
    rotor_inertia: tuple[float, ...]
    """[-]."""
    presliding: tuple[float, ...]
    """[-]."""
    friction_level: tuple[float, ...]
    """[-]."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class TableVerdictSettings:
    """Which statements are taken on, and what is left over."""

    least_gain: float
    """Held-out gain from which a statement is significant [nats]: 4 sd, for some hundred statements
    that are tried."""
    most_causes: int
    """Statements taken on at most."""
    rival: float
    """Share of the best gain from which a rival is simulated with the whole arm too [-]."""
    alike_nats: float
    """Two causes are confused if the gain of one is within this of the other's [nats]: 400 to 1."""
    alike_share: float
    """The same as a share of the gain [-]: how well the lone joint follows the arm."""
    corrupted_sd: float
    """A reading is corrupted if it is this many sd off [-]."""
    corrupted: float
    """And this share of the friction [-]."""
    corrupted_share: float
    """More corrupted readings than this are no bad readings but a bad model [-]."""
    least_blocks: int
    """Blocks of (frequency, scale) from which anything can be told."""
    model_sd: float
    """What a level shift of the lone joint differs from the whole arm's, over friction [-]."""
    unexplained: float
    """Mean square of what is left over noise from which a joint counts as not explained [-]:
    readings are normal, but their noise is only known to a fifth."""
    doubtful: float
    """Share of that from which a joint is simulated more closely."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("rival", "alike_share", "corrupted_share", "doubtful"))


@dataclass(frozen=True, kw_only=True)
class TableSettings:
    """All of torque tables."""

    noise: ReadingNoiseSettings
    """How far readings may be off."""
    statements: StatementSettings
    """What is tried."""
    anchors: AnchorSettings
    """Where the whole arm is simulated too."""
    verdict: TableVerdictSettings
    """What is taken on."""


@cache
def table_settings() -> TableSettings:
    """Return the defaults."""
    return load_settings(TableSettings, Path(__file__).parents[1] / "settings.toml", "tables")
