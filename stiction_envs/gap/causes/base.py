"""The interface of a cause: all that the project knows of it, in one class.

A cause is something that simulations leave out or get wrong. Along a motion it adds columns (T, k)
times coefficients (k,) to the residual torque of a joint, measured less nominal; in torque tables
it changes breakaway torques, in servo logs the parameters of a joint. A cause may do one or more of
these. To add one, derive from `Cause`, and call `stiction_envs.gap.causes.register` with an
instance. Nothing else names it:

1. what it is: `name`, `what`, `what_to_record`, `parameters` with units and bounds;
2. its torque: `columns`, their `prior`, and `shapes` where it has nonlinear parameters;
3. its numbers: `values` as in ``diagnosis.json``;
4. its picture: `view`;
5. its model: `contribute` to a `ModelDraft`; by default the model says that MuJoCo lacks it;
6. in torque tables: its effects `in_tables`, `in_words` and `in_friction`, and what would
   `tell_apart` it from others;
7. in servo logs: the parameters of a joint that it changes, and its words, in `servo`;
8. its traits: flags that tell the search how to treat it.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError
from stiction_envs.experiments.poses import Poses
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.servo.servo_parameters import InServo
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.tables.data import Effect, TableData
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
Columns = NDArray[np.floating]
"""Torque per unit of coefficients; in single precision where several causes share an array."""
A_JOINT, ALL_OF_ONE, THE_ARM, EITHER = "a joint", "a joint, on all", "the arm", "a joint or the arm"
"""Whose torque a cause changes: its joint's; all joints', from one; all, by the same coefficients;
its joint's, or all by the same."""
DRY, DAMPING, OFFSET, ROTOR = "dry friction", "damping", "offset", "rotor"
"""Parts that every joint's model has, and to which a cause may add."""
LINK, ALL_LINKS, GRAVITY, ZERO = "link", "all links", "gravity", "zero of a joint"
"""The same of the rigid arm; the small errors of all links are never named."""
FRICTION, PLAIN = (DRY, DAMPING), (DRY, DAMPING, OFFSET, ROTOR)
OF_ARM = (LINK, ALL_LINKS, GRAVITY, ZERO)
AT_ONCE = 12
"""Number of columns that pass the filter at once [-]: more take memory and save little time."""
Shape = tuple[float, ...]
"""Values of a cause's nonlinear parameters; () where it has none."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of a cause, as in ``diagnosis.json``."""

    name: str
    unit: str
    """1 where it has none."""
    low: float = -np.inf
    high: float = np.inf
    size: int = 1
    """Numbers it holds among the coefficients; 0 for nonlinear parameters."""
    neutral: float = 0.0
    """Value at which nothing is wrong."""


@dataclass(frozen=True)
class Prior:
    """The prior of a cause's k coefficients, before any log."""

    size: Array
    """(k,) standard deviations about zero."""
    low: Array | None = None
    """(k,) lowest; None for those of the parameters."""
    high: Array | None = None
    """(k,) highest."""
    odds: float = 0.0
    """Log odds against it, beside those of one among all hypotheses [nats]."""
    everywhere: bool = False
    """Whether it is no surprise anywhere: only `odds` are against it."""
    least: Array | float = 0.0
    """(k,) part of these sizes that remains at least where a tenth of them is tried [-]."""
    usual: float = 0.0
    """Standard deviation of its coefficients in an arm without a fault. It is a small error then,
    until it is named; 0 for none."""


@dataclass(frozen=True)
class View:
    """The picture of a cause in a report: the abscissa; the ordinate is the residual torque."""

    label: str
    """Label of the axis, with the unit."""
    of: Callable[[Data, int, Shape], Columns] | None
    """(T,) variable of a joint (from 0) for nonlinear parameters; None for the torque that the
    cause itself predicts."""
    folded: bool = False
    """Whether torques are counted in the direction of motion."""
    note: str = ""
    """What to look for, a clause."""
    limit: Callable[[Shape], float] | None = None
    """Size of the variable up to which it is drawn; None for all of it."""


OWN_TORQUE = View(
    "torque that the cause predicts [N·m]",
    None,
    note="on the diagonal the cause is right in every pose",
)
"""For causes that no single variable shows."""


def variable(field: str) -> Callable[[Data, int, Shape], Array]:
    """Return the variable of a `View` for a field (T, n) of the data."""
    return lambda data, joint, shape: np.asarray(getattr(data, field)[:, joint])


class Cause:
    """Something that simulations leave out or get wrong; see the module's text."""

    name: ClassVar[str]
    """In files and reports: small letters, digits and underscores."""
    what: ClassVar[str]
    """What is wrong in the simulation, a clause."""
    what_to_record: ClassVar[str]
    """The motion that shows it and tells it from others, a clause."""
    parameters: ClassVar[tuple[Parameter, ...]]
    view: ClassVar[View] = OWN_TORQUE
    """The abscissa of its picture."""

    # ---- traits ------------------------------------------------------------------------------

    acts_on: ClassVar[str] = A_JOINT
    """Whose torque it changes: `A_JOINT`, `ALL_OF_ONE`, `THE_ARM` or `EITHER`."""
    adds_to: ClassVar[str] = ""
    """What its coefficients add to, if that is part of any model: `DRY`, `DAMPING`, `OFFSET`,
    `ROTOR`, or one of `OF_ARM`, whose torque the gears transmit."""
    is_linear: ClassVar[bool] = True
    """Whether its nonlinear parameters, if any, follow from its coefficients."""
    least: ClassVar[float] = 0.0
    """Size of its first coefficient below which it is none."""
    needs: ClassVar[tuple[str, ...]] = ()
    """Names of causes that a joint's model must have with this one."""
    resembles_delay: ClassVar[bool] = False
    """Whether a large delay that is not known yet may look like it."""
    filtered: ClassVar[bool] = True
    """Whether its columns are of signals that passed the filter; else they pass it afterwards."""
    shown_at_rest: ClassVar[bool] = False
    """Whether poses at rest can show it; all others need motion."""
    tell_apart: ClassVar[Mapping[str, str]] = {}
    """Further breakaway torques that distinguish it from another cause, by that one's name."""
    words: ClassVar[str] = ""
    """What is wrong with torque tables, a noun with its value; parameters are in braces."""
    not_in_friction: ClassVar[str] = "no parameter of friction holds it"
    """Why a model of the arm does not hold what tables show of it, a clause, likewise."""
    servo: ClassVar[InServo] = InServo()
    """What it changes in a joint under a position servo; without it servo logs do not show it."""

    # ---- torque ------------------------------------------------------------------------------

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return the prior of the cause's coefficients on a joint (from 0; -1 for the arm).

        By default that of one torque: a twentieth of what the joint can bear [N·m]; assumed.
        """
        return Prior(np.array([0.05 * data.strength[joint]]))

    def joints(self, data: Data) -> list[int]:
        """Return the joints (from 0) on which it is a hypothesis; -1 is the whole arm."""
        if not np.isfinite(data.dt) and not self.shown_at_rest:
            return []
        whole = [-1] if self.acts_on in (THE_ARM, EITHER) else []
        return whole if self.acts_on == THE_ARM else [*range(data.n), *whole]

    def columns(self, data: Data, joint: int, shape: Shape) -> Columns:
        """Return the torque per unit of each coefficient of a cause on a joint (from 0).

        (T, k) on this joint alone; (T, n, k) on all joints if they show it, and for the whole arm,
        where ``joint`` is -1; with F rows along the reversal path where they are not `filtered`.
        Motions do not show a cause that lacks this method.
        """
        raise NotImplementedError

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return the nonlinear parameters to try; by default those of `grid`, if any.

        Args:
            data: the logs.
            joint: from 0.
            residual: (T,) without plain friction, offsets and rotors [N·m].
        """
        return [(float(x),) for x in self.grid(data, joint)] or [()]

    def grid(self, data: Data, joint: int) -> Array:
        """Return rising values of the first nonlinear parameter, if more lie between them.

        The search refines it there, and it must not end on the first or last of them.
        """
        return np.empty(0)

    def resized(self, shape: Shape, coefficients: Array, level: float) -> Shape:
        """Return the nonlinear parameters of a cause of this size on that dry friction [N·m]."""
        return shape

    # ---- torque tables -----------------------------------------------------------------------

    def in_tables(self, data: TableData) -> Iterable[Effect]:
        """Return its possible effects on breakaway torques.

        Tables do not show a cause that lacks this method.
        """
        raise NotImplementedError

    def in_words(self, values: Mapping[str, float]) -> str:
        """Return `words` with the values of parameters."""
        return self.words.format(**values)

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> Mapping[str, Array | float] | str:
        """Return a joint's friction parameters that are other with it, or `not_in_friction`.

        Args:
            friction: friction without it.
            poses: poses of the experiment.
            j: joint, from 0.
            values: its parameters by name.
        """
        return self.not_in_friction.format(**values)

    # ---- what was found ----------------------------------------------------------------------

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return the parameters of coefficients (k,) and nonlinear parameters, by name.

        By default a parameter of `size` 1 is its neutral value plus the next coefficient, and one
        of `size` 0 is the next nonlinear parameter.
        """
        linear, nonlinear = iter(coefficients), iter(shape)
        return {
            p.name: p.neutral + float(next(linear)) if p.size else next(nonlinear)
            for p in self.parameters
        }

    def describe(self, data: Data, coefficients: Array, shape: Shape) -> str:
        """Return `what` of these coefficients, and what is assumed where data do not show it."""
        return self.what

    def possible(
        self, data: Data, joint: int, coefficients: Array, shape: Shape, level: float
    ) -> bool:
        """Return whether these coefficients are its own: no bound, and not too small to matter.

        ``level`` is the joint's dry friction [N·m].
        """
        low, high = limits(self, self.prior(data, joint, shape), data)
        k = len(coefficients)
        inside = np.all((coefficients > low[:k]) & (coefficients < high[:k]))
        return bool(inside and abs(coefficients[0]) >= self.least)

    def part_of(self, coefficients: Array, shape: Shape) -> tuple[Array, Shape]:
        """Return coefficients and nonlinear parameters as a model file holds them."""
        return coefficients, shape

    # ---- the model with it -------------------------------------------------------------------

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Put a part into the model; note what MuJoCo or the friction tables cannot hold.

        Args:
            draft: draft of the model, changed in place.
            part: part of this cause.
        """
        if self.adds_to in OF_ARM:
            link = f" of link {part.joint}" if part.joint else ""
            draft.not_in_tables.append(f"{self.name}{link}: in [[cause]] and model.xml")
        else:
            draft.leave_out(part, "MuJoCo's joints have no such thing")

    def changed(self, arm: Arm, part: Part) -> Arm:
        """Return the arm with a part that adds to one of `OF_ARM`.

        Raises:
            StictionError: a part that is not as `part_of` makes it, or a body that cannot exist.
        """
        return arm

    def on_links(self, data: Data, joint: int, shape: Shape, size: int) -> Array:
        """Return (10 n, k) change of the links' parameters per unit of ``size`` coefficients."""
        return np.zeros((10 * data.n, size))


def limits(cause: Cause, prior: Prior, data: Data) -> tuple[Array, Array]:
    """Return lowest and highest coefficients, (k,) each, by the prior or the parameters.

    A nominal model with friction may also have too much of it: less is added then.
    """
    if prior.low is not None and prior.high is not None:
        return prior.low, prior.high
    low = [p.low - p.neutral for p in cause.parameters for _ in range(p.size)]
    high = [p.high - p.neutral for p in cause.parameters for _ in range(p.size)]
    if cause.adds_to in FRICTION and data.has_friction:
        low = [-np.inf] * len(low)
    return np.array(low), np.array(high)


def filtered_columns(
    cause: Cause, data: Data, joint: int, shapes: Sequence[Shape]
) -> Iterator[Columns]:
    """Yield the columns of a cause with each of several nonlinear parameters, filtered.

    Several pass the filter at once, since that takes hardly longer than one.
    """
    for first in range(0, len(shapes), AT_ONCE):
        each = [cause.columns(data, joint, x) for x in shapes[first : first + AT_ONCE]]
        yield from each if cause.filtered else np.moveaxis(data.smooth(np.stack(each, -1)), -1, 0)


def torque_of(cause: Cause, data: Data, part: Part) -> Array:
    """Return (T, n) what a part of a cause adds to the torque of a nominal model [N·m].

    Raises:
        StictionError: a part with other than as many coefficients as there are columns.
    """
    c, out = np.array(part.coefficients), np.zeros_like(data.q)
    if not np.isfinite(data.dt) and not cause.shown_at_rest:
        return out  # poses at rest do not show what friction holds
    (x,) = filtered_columns(cause, data, part.joint - 1, [part.shape])
    if x.shape[-1] != len(c):
        raise StictionError(f"cause {cause.name}: {len(c)} coefficients: expected {x.shape[-1]}")
    if x.ndim == 3:
        return np.asarray(x @ c)
    out[:, part.joint - 1] = x @ c
    return out
