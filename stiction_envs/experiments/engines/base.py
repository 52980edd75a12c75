"""A physics engine as the conformance test uses it: N copies under applied torques, their angles.

Another engine than MuJoCo is one file and one line in this package's ``__init__.py``.
"""

import abc
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import ClassVar

import mujoco
import numpy as np

from stiction_envs.arrays import Array, Index
from stiction_envs.errors import StictionError, missing_extra, one_line
from stiction_envs.friction.export import MotorInput
from stiction_envs.plant.any_model import rollout

Torque = Callable[[Array], Array]
"""Takes the (K,) times of a chunk's steps [s]; returns the chunk's (N, K, nv) torque [N·m]."""
CHUNK = 500  # Steps between two calls of the torque


class Refused(StictionError):
    """The engine does not take the model; the message is a line of the engine."""

    def __init__(self, error: object) -> None:
        super().__init__(one_line(error))


@dataclass(frozen=True, kw_only=True)
class Bare:
    """A model in which nothing but friction and elastic joints acts."""

    model: mujoco.MjModel  # As MuJoCo compiles it, without gravity, contacts, limits, controllers
    mjcf: str | Path | None
    """Text or file from which it was compiled, for engines with a reader of their own; nothing is
    taken out of it. None for a model without MJCF."""
    released: Index  # Hinges whose spring was taken out of `model`


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A simulation for an engine: N copies, from rest, under applied joint torques."""

    bare: Bare  # The model; controls stay zero
    qpos: Array  # (N, nq) start positions [rad]
    torque: Torque  # Asked once per chunk, so it may depend on the chunks before
    steps: int  # Number of physics steps
    record: Sequence[str] = ("qpos",)  # Names of `mujoco.MjData` fields
    threads: int = 0  # Threads, 0 for all processors; an engine may not heed it

    @property
    def timestep(self) -> float:
        """Physics step [s]."""
        return float(self.bare.model.opt.timestep)

    def chunks(self) -> Iterator[Array]:
        """Yield the times of each chunk's steps [s]."""
        for start in range(0, self.steps, CHUNK):
            end = min(start + CHUNK, self.steps)
            yield np.arange(start, end, dtype=np.float64) * self.timestep


class Engine(abc.ABC):
    """A physics engine."""

    name: ClassVar[str]  # On the command line; also of the extra that installs its packages
    packages: ClassVar[tuple[tuple[str, str], ...]]
    """Module and distribution of each package that it needs; the first has its version."""
    single: ClassVar[bool] = True  # Whether it computes in float32
    motor: ClassVar[MotorInput | None] = "ff"  # Its input of the ``dcmotor``; None: no LuGre
    keep: ClassVar[str]  # What a user writes to keep the friction of an export, and why

    def check(self) -> None:
        """Raise a `StictionError` that names the extra if a package is missing."""
        for module, package in self.packages:
            if find_spec(module) is None:
                raise missing_extra(f"engine {self.name}", package, self.name)

    def versions(self) -> dict[str, str]:
        """Return the version of each package."""
        return {package: metadata.version(package) for _, package in self.packages}

    @abc.abstractmethod
    def simulate(self, drive: Drive) -> Iterator[dict[str, Array]]:
        """Yield per chunk ``time`` (K,) at the start of each step [s], and what ``drive`` records,
        (N, K, …), after it. Raise `Refused` where the engine does not take the model, and an
        ExperimentError for a simulation that it stopped.
        """


class MuJoCo(Engine):
    """MuJoCo in C, float64."""

    name: ClassVar = "mujoco"
    packages: ClassVar = (("mujoco", "mujoco"),)
    single: ClassVar = False
    keep: ClassVar = 'nothing: `mujoco.MjModel.from_xml_path("scene.xml")`'

    def simulate(self, drive: Drive) -> Iterator[dict[str, Array]]:
        """See `Engine.simulate`."""
        what = drive.bare.model, drive.qpos, drive.torque, drive.chunks()
        return rollout(*what, record=drive.record, threads=drive.threads)


def silent(model: mujoco.MjModel) -> mujoco.MjModel:
    """Zero gain and bias of actuators in groups that are off; return the same model."""
    off = (model.opt.disableactuator >> np.maximum(model.actuator_group, 0)) & 1 == 1
    model.actuator_gainprm[off] = 0.0
    model.actuator_biasprm[off] = 0.0
    return model
