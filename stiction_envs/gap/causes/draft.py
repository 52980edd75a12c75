"""The model to which causes are added: the changes of each cause, and omissions of MuJoCo.

    draft = ModelDraft.of(friction, n, mean_load=..., duration=...)
    cause.contribute(draft, part)      # for every part that was found

Friction quantities are those of `FrictionParameters`, before they are made physical.
"""

from dataclasses import dataclass, field

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.friction.parameters import QUANTITIES, FrictionParameters

STRIBECK = 0.05
"""Stribeck velocity where none was found [rad/s]: without effect; assumed."""
LEAST_FRICTION = 1e-6
"""Dry friction of a joint without any [N·m]: the least that `FrictionParameters` allow."""
LATE = 5.0
"""Time constant of a straight drift in the model, over the length of the logs [-]; assumed."""


@dataclass(frozen=True, kw_only=True)
class Part:
    """One cause on one joint, as it was found; a table ``[[cause]]`` of ``model.toml``."""

    cause: str
    """Name of the cause, ``name`` in the file."""
    joint: int
    """From 1; 0 is the whole arm."""
    shape: tuple[float, ...]
    """Nonlinear parameters."""
    coefficients: tuple[float, ...]
    """Factors of its columns."""
    level: int = 1
    """Number of the diagnosis, from 1; each builds on the earlier ones."""
    carried: bool = False
    """Whether the load of the gears contained what the same diagnosis found; for a delay, whether
    it delays all torques of that diagnosis."""
    doubt: tuple[tuple[float, ...], ...] = ()
    """F of the covariance F Fᵀ of the fitted coefficients, a row for each; the columns are those of
    all parts of a model. () where none is known, or the links' covariance contains it."""

    @property
    def where(self) -> str:
        """``the arm`` or ``joint 3``."""
        return "the arm" if self.joint == 0 else f"joint {self.joint}"


@dataclass(eq=False, kw_only=True)
class ModelDraft:
    """The sum of all causes; (n,) per joint or (n, 2) per joint and direction (+, −)."""

    values: dict[str, Array]
    """Quantities of `FrictionParameters`, by name; bristle stiffness is NaN where none is known."""
    coulomb: Array
    """(n, 2) dry friction in motion [N·m], in place of its ratio to stiction."""
    load: Array
    """(n,) Coulomb friction per N·m of load that was found [-]."""
    pull: Array
    """(n, 2) stiffness [N·m/rad] and rest angle [rad] of a spring to the world."""
    waves: list[tuple[int, float, float, float]] = field(default_factory=list)
    """Joint (from 0), amplitude [N·m], periods per turn and phase [rad] of further cogging."""
    mean_load: Array
    """(n,) mean absolute torque that the gears transmit in the logs [N·m]; causes only read it."""
    duration: float
    """Length of the logs [s]; causes only read it."""
    not_in_tables: list[str] = field(default_factory=list)
    """What the plant's friction tables cannot hold, one clause each."""
    not_in_mjcf: list[str] = field(default_factory=list)
    """What MJCF cannot hold, one clause each."""
    left_out: list[tuple[Part, float]] = field(default_factory=list)
    """Parts whose torque MJCF leaves out, but for some dry friction [N·m]."""

    @classmethod
    def of(
        cls, base: FrictionParameters | None, n: int, *, mean_load: Array, duration: float
    ) -> "ModelDraft":
        """Return the draft of a nominal model without causes.

        Args:
            base: its friction; None for a rigid body without any.
            n: number of joints.
            mean_load: (n,) of the logs [N·m].
            duration: of the logs [s].
        """
        if base is not None:
            values = {k: np.array(getattr(base, k)) for k in QUANTITIES}
        else:
            values = {
                k: np.full((n, 2)[: 1 + q.by_direction], q.default or 0.0)
                for k, q in QUANTITIES.items()
            }
            values["stribeck_velocity"] += STRIBECK
            values["bristle_stiffness"] += np.nan
        return cls(
            values=values,
            coulomb=values["stiction"] * values["coulomb_ratio"],
            load=np.zeros(n),
            pull=np.zeros((n, 2)),
            mean_load=mean_load,
            duration=duration,
        )

    def leave_out(self, part: Part, why: str, *, tables: bool = True, dry: float = 0.0) -> None:
        """Note that MJCF cannot hold a part: in words, and as torque to subtract from the controls.

        Args:
            part: part of the model.
            why: a clause.
            tables: whether the plant's friction tables cannot hold it either.
            dry: dry friction that stands in for it [N·m].
        """
        text = f"{part.cause} of {part.where}: {why}"
        self.not_in_mjcf.append(text)
        if tables:
            self.not_in_tables.append(text)
        self.left_out.append((part, dry))
