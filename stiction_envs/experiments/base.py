"""Parts of every experiment, in the order in which they follow each other.

    protocol (TOML) -> Experiment -> Rig (N arms on one plant) -> measurements -> rows, report
                                  -> Episodes (actions, observation, reward) -> Env, VectorEnv

An experiment is one folder: its `Experiment`, its `Rig` and its `Episodes`, and one line of
`envs.registration`, by which its environments are found.
"""

from __future__ import annotations

import copy
import dataclasses
from dataclasses import dataclass
from typing import Self

from stiction_envs.control.sensing import Sensing, SensingLike, load_sensing
from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.errors import unknown
from stiction_envs.friction.model import StickingModel


@dataclass(frozen=True, init=False, repr=False)
class Experiment:
    """One arm, its friction, its torque interface and a protocol: all that defines a result."""

    sticking: StickingModel
    interface: TorqueInterface
    sensing: Sensing
    """Senses of the controller."""
    scatter: bool
    seed: int
    threads: int

    def __init__(
        self,
        sticking: StickingModel,
        *,
        interface: TorqueInterface | None = None,
        sensing: SensingLike = "ideal",
        scatter: bool = False,
        seed: int = 0,
        threads: int = 0,
    ) -> None:
        """Set the experiment up.

        Args:
            sticking: the model.
            interface: what the robot does to commanded torques; None for the robot's own.
            sensing: what its controller sees; see `load_sensing`.
            scatter: whether iterations differ by pose, friction and dither.
            seed: of that scatter.
            threads: threads, 0 for all processors.

        Raises:
            StictionError: senses that are not known, or not of this arm.
        """
        if interface is None:
            interface = TorqueInterface.of(sticking.arm)
        self._set(sticking=sticking, interface=interface)
        self._set(sensing=load_sensing(sticking.arm, sensing))
        self._set(scatter=scatter, seed=seed, threads=threads)

    def _set(self, **fields: object) -> None:
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    def replace(self, **changes: object) -> Self:
        """Return a copy with some fields changed; the other fields stay as they are."""
        names = [f.name for f in dataclasses.fields(self)]
        for name in changes:
            if name not in names:
                raise TypeError(f"{type(self).__name__} has no field {name!r}")
        out = copy.copy(self)
        out._set(**changes)
        return out

    @property
    def sensing_record(self) -> dict[str, object]:
        """Entry of a provenance for the senses."""
        return {"sensing": dataclasses.asdict(self.sensing)}

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.sticking.arm.name}, seed {self.seed}>"

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.sticking.n


def joint_number(joint: int, n: int) -> int:
    """Return the number (from 0) of a joint of 1..n.

    Raises:
        StictionError: a joint the arm lacks.
    """
    if not 1 <= joint <= n:
        raise unknown("joint", joint, range(1, n + 1))
    return joint - 1
