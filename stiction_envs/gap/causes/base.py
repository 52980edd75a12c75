"""The interface of a cause: all that the project knows of it, in one class.

A cause is something that simulations leave out or get wrong. It adds columns (T, k) times
coefficients (k,) to the residual torque of a joint, measured less nominal. To add one, derive from
`Cause`, and call `stiction_envs.gap.causes.register` with an instance. Nothing else names it:

1. what it is: `name`, `what`, `what_to_record`, `parameters` with units and bounds;
2. its torque: `columns`, and `shapes` where it has nonlinear parameters;
3. its numbers: `values` as in ``diagnosis.json``;
4. its picture: `view`;
5. its model: `contribute` to a `ModelDraft`; by default the model says that MuJoCo lacks it;
6. its traits: flags that tell the search how to treat it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.reporting.json_text import JsonRecord
from stiction_envs.robots import Arm

Array = NDArray[np.float64]
Columns = NDArray[np.floating]
"""Torque per unit of coefficients; in single precision where several causes share an array."""
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
class View:
    """What a cause is drawn against in a report; the ordinate is the residual torque."""

    label: str
    """Of the axis, with its unit."""
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
    """Return what `View` takes for a field (T, n) of the data."""
    return lambda data, joint, shape: np.asarray(getattr(data, field)[:, joint])


class Cause(ABC):
    """Something that simulations leave out or get wrong; see the module's text."""

    name: ClassVar[str]
    """In files and reports: small letters, digits and underscores."""
    what: ClassVar[str]
    """What is wrong in the simulation, a clause."""
    what_to_record: ClassVar[str]
    """The motion that shows it and tells it from others, a clause."""
    parameters: ClassVar[tuple[Parameter, ...]]
    view: ClassVar[View] = OWN_TORQUE
    """What it is drawn against."""

    # ---- traits ------------------------------------------------------------------------------

    arm_wide: ClassVar[bool] = False
    """One hypothesis with the same coefficients in all joints."""
    arm_too: ClassVar[bool] = False
    """Whether it is one hypothesis of the whole arm too, beside one on each joint."""
    coupled: ClassVar[bool] = False
    """A cause of one joint that all joints' torques show: `spread` in place of `columns`."""
    is_linear: ClassVar[bool] = True
    """Whether it has no nonlinear parameter."""
    refinable: ClassVar[bool] = True
    """Whether its nonlinear parameter is a number that can be refined between those tried, and that
    must not end on the first or last of them."""
    needs: ClassVar[tuple[str, ...]] = ()
    """Names of causes that a joint's model must have with this one."""
    base_friction: ClassVar[bool] = False
    """Whether it is the joint's plain friction, and not a refinement of it. A nominal model with
    friction may also have too much of it: the coefficients may then be negative."""
    resembles_delay: ClassVar[bool] = False
    """Whether a large delay that is not known yet may look like it."""
    shown_at_rest: ClassVar[bool] = False
    """Whether poses at rest can show it; all others need motion."""
    changes_arm: ClassVar[bool] = False
    """Whether it changes the rigid arm, its bodies or gravity: `changed`. The gears transmit its
    torque, and the load that friction depends on changes with it."""
    random: ClassVar[bool] = False
    """Whether its coefficients are small random effects: in every model, and never named."""
    body: ClassVar[bool] = False
    """Whether it is a body, whose torque small errors of all links can imitate."""
    removed_first: ClassVar[bool] = False
    """Whether its torque, linear and common, is taken out of the residual before nonlinear causes
    look for their parameters."""

    # ---- torque ------------------------------------------------------------------------------

    @abstractmethod
    def size(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return (k,) prior standard deviations of the coefficients about zero.

        ``joint`` counts from 0 and is -1 for causes of the whole arm; ``shape`` is one of
        `shapes`.
        """

    def odds(self, data: Data, hypotheses: int) -> float:
        """Return log prior odds against it on a joint, or on the arm, among so many [nats]."""
        return float(np.log(hypotheses))

    def joints(self, data: Data) -> list[int]:
        """Return the joints (from 0) on which it is a hypothesis; -1 is the whole arm."""
        if not np.isfinite(data.dt) and not self.shown_at_rest:
            return []
        whole = [-1] if self.arm_wide or self.arm_too else []
        return whole if self.arm_wide else [*range(data.n), *whole]

    def drives(self, coefficients: Array, level: float) -> bool:
        """Return whether it is friction that drives, beside a joint's dry friction ``level``."""
        return False

    @abstractmethod
    def columns(self, data: Data, joint: int, shape: Shape) -> Columns:
        """Return (T, k) torque per unit of each coefficient on a joint (from 0)."""

    def spread(self, data: Data, joint: int, shape: Shape) -> Columns:
        """Return (T, n, k) torque on all joints of a `coupled` cause on one joint."""
        raise NotImplementedError

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return the nonlinear parameters to try.

        Args:
            data: the logs.
            joint: from 0.
            residual: (T,) without the causes that are `removed_first` [N·m].
        """
        return [()]

    def between(self, shape: Shape, shapes: list[Shape]) -> tuple[float, float]:
        """Return the neighbours of a nonlinear parameter, between which it is refined."""
        tried = sorted(s[0] for s in shapes)
        at = tried.index(shape[0])
        return tried[max(at - 1, 0)], tried[min(at + 1, len(tried) - 1)]

    def resized(self, shape: Shape, coefficients: Array, level: float) -> Shape:
        """Return the nonlinear parameters of a cause of this size on that dry friction [N·m]."""
        return shape

    def bounds(self, data: Data, joint: int) -> tuple[Array, Array]:
        """Return lowest and highest coefficients, (k,) each; by default the parameters'.

        ``joint`` counts from 0 and is -1 for causes of the whole arm. With fewer columns than
        bounds, the first bounds count.
        """
        low = [p.low - p.neutral for p in self.parameters for _ in range(p.size)]
        high = [p.high - p.neutral for p in self.parameters for _ in range(p.size)]
        if self.base_friction and data.has_friction:
            low = [-np.inf] * len(low)
        return np.array(low), np.array(high)

    def tolerance(self, data: Data, joint: int) -> float:
        """Return the standard deviation of its coefficients in an arm without a fault.

        It is a random effect then, beside small errors of all links, until it is named; 0 for none.
        ``joint`` counts from 0 and is -1 for causes of the whole arm.
        """
        return 0.0

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

    def describe(self, coefficients: Array) -> str:
        """Return `what`, for these coefficients."""
        return self.what

    def assumption(self, data: Data, shape: Shape) -> str:
        """Return what it assumes because these data do not show it, a clause; or nothing."""
        return ""

    def dry_friction(self, coefficients: Array) -> float:
        """Return what it adds to a joint's level of dry friction in motion [N·m]."""
        return 0.0

    def rotor_inertia(self, coefficients: Array) -> float:
        """Return what it adds to a joint's rotor [kg·m²]."""
        return 0.0

    def negligible(self, coefficients: Array, shape: Shape) -> bool:
        """Whether it is too small to matter."""
        return False

    def on_bound(self, coefficients: Array, data: Data, joint: int) -> bool:
        """Whether its main coefficient is on a bound: then it is something else, or nothing."""
        low, high = self.bounds(data, joint)
        return bool(np.any((coefficients <= low) | (coefficients >= high)))

    def at_edge(self, shape: Shape, shapes: list[Shape], edge: float) -> bool:
        """Whether a nonlinear parameter is at the end of what was tried, or within this factor."""
        if not self.refinable or len(shapes) < 2 or not shape:
            return False
        tried = sorted({s[0] for s in shapes})
        if tried[0] <= 0:
            return shape[0] in (tried[0], tried[-1])
        # refined ones come close to the end without reaching it
        return not tried[0] * edge < shape[0] < tried[-1] / edge

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
        if self.changes_arm:
            link = f" of link {part.joint}" if part.joint else ""
            draft.not_in_tables.append(f"{self.name}{link}: in [[cause]] and model.xml")
        else:
            draft.leave_out(part, "MuJoCo's joints have no such thing")

    def changed(self, arm: Arm, part: Part) -> Arm:
        """Return the arm with a part that `changes_arm`.

        Raises:
            StictionError: a part that is not as `part_of` makes it, or a body that cannot exist.
        """
        return arm

    def on_links(self, data: Data, joint: int, shape: Shape, size: int) -> Array:
        """Return (10 n, k) change of the links' parameters per unit of ``size`` coefficients."""
        return np.zeros((10 * data.n, size))

    def lean(self, coefficients: Array) -> Array:
        """Return (2,) share of gravity that it adds along x and y [-]."""
        return np.zeros(2)

    def contribution_order(self, part: Part) -> tuple[int, float]:
        """Return a sort key among the parts of a model: lower ones contribute first."""
        return 0, 0.0

    def held(self, draft: ModelDraft, part: Part, data: Data) -> Array | None:
        """Return (T,) what MJCF holds of a part that was left out, on its joint [N·m]; or None.

        Args:
            draft: draft of the model, with all causes in it.
            part: part of this cause.
            data: the logs.
        """
        return None

    def parameters_of(self, part: Part) -> JsonRecord:
        """Return the parameters of a part as in ``diagnosis.json``."""
        return self.values(np.array(part.coefficients), part.shape)

    def torque(self, data: Data, part: Part) -> Array:
        """Return (T, n) what a part adds to the torque of a nominal model [N·m].

        Raises:
            StictionError: a part with other than as many coefficients as there are columns.
        """
        c, out = np.array(part.coefficients), np.zeros_like(data.q)
        if not np.isfinite(data.dt) and not self.shown_at_rest:
            return out  # poses at rest do not show what friction holds
        if self.coupled:
            spread = self.spread(data, part.joint - 1, part.shape)
            columns = {j: spread[:, j] for j in range(data.n)}
        else:
            joints = range(data.n) if part.joint == 0 else [part.joint - 1]
            columns = {j: self.columns(data, j, part.shape) for j in joints}
        for j, x in columns.items():
            if x.shape[1] != len(c):
                raise StictionError(
                    f"cause {self.name}: {len(c)} coefficients: expected {x.shape[1]}"
                )
            out[:, j] = x @ c
        return out
