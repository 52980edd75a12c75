"""The engines by name, a line each; what is optional is loaded when it is used."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import TYPE_CHECKING, NamedTuple

import mujoco
from mujoco.batch import Batch

from stiction_envs.errors import missing_extra, unknown

if TYPE_CHECKING:
    from stiction_envs.engines.warp_batch import WarpBatch

DEFAULT_ENGINE = "mujoco"


def _mujoco(model: mujoco.MjModel, nsim: int, threads: int, closed_loop: bool) -> Batch:
    return Batch(model, nsim, threads, persistent=closed_loop)


def _warp(model: mujoco.MjModel, nsim: int, threads: int, closed_loop: bool) -> WarpBatch:
    from stiction_envs.engines.warp_batch import WarpBatch

    return WarpBatch(model, nsim)


class Engine(NamedTuple):
    """What steps simulations."""

    make: Callable[[mujoco.MjModel, int, int, bool], Batch | WarpBatch]
    """Returns a batch for the arguments of `make_batch`."""
    module: str
    """What it imports."""
    package: str
    """What has to be installed for that, by the extra of the engine's name."""


ENGINES = {
    DEFAULT_ENGINE: Engine(_mujoco, "mujoco", "mujoco"),
    "warp": Engine(_warp, "mujoco_warp", "mujoco-warp"),
}
"""By name."""


def check_engine(name: str) -> str:
    """Return the name of an engine that is installed.

    Raises:
        StictionError: no such engine, or its package is missing.
    """
    if name not in ENGINES:
        raise unknown("engine", name, ENGINES)
    if find_spec(ENGINES[name].module) is None:
        raise missing_extra(f"engine {name}", ENGINES[name].package, name)
    return name


def make_batch(
    engine: str, model: mujoco.MjModel, nsim: int, *, threads: int, closed_loop: bool
) -> Batch | WarpBatch:
    """Return N simulations of a model: a `mujoco.batch.Batch`, or as much of it as the plant uses.

    Args:
        engine: one of `ENGINES`.
        model: of all simulations.
        nsim: number of simulations.
        threads: threads of MuJoCo, 0 for all processors.
        closed_loop: whether every step is followed by the next one's kinematics.

    Raises:
        StictionError: no such engine, or its package is missing.
    """
    return ENGINES[check_engine(engine)].make(model, nsim, threads, closed_loop)
