"""MuJoCo Warp, the engine of mjlab: on the GPU where there is one, else on Warp's CPU backend."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, ClassVar, Protocol

import mujoco
import numpy as np

from stiction_envs.experiments.engines.base import Array, Drive, Engine, Refused, silent

if TYPE_CHECKING:
    import warp as wp


class Copies(Protocol):
    """An engine's copies: arrays of Warp by the names of `mujoco.MjData`."""

    qfrc_applied: wp.array


class Warp(Engine):
    """MuJoCo Warp as its users run it, all in float32; a step is one captured graph."""

    name: ClassVar = "warp"
    packages: ClassVar = (("mujoco_warp", "mujoco-warp"), ("warp", "warp-lang"))
    keep: ClassVar = 'nothing: `mujoco_warp.put_model(mujoco.MjModel.from_xml_path("scene.xml"))`'

    def simulate(self, drive: Drive) -> Iterator[dict[str, Array]]:
        """See `Engine.simulate`."""
        import mujoco_warp as mjw

        print_less()
        host = silent(copy.copy(drive.bare.model))
        try:
            model = mjw.put_model(host)
        except (NotImplementedError, ValueError) as error:
            raise Refused(error) from None
        state = mjw.put_data(host, mujoco.MjData(host), nworld=len(drive.qpos))
        state.qpos.assign(drive.qpos.astype(np.float32))

        def restore() -> None:
            for name in ("qvel", "act", "qacc_warmstart", "time"):
                getattr(state, name).zero_()
            state.qpos.assign(drive.qpos.astype(np.float32))

        yield from driven(drive, lambda: mjw.step(model, state), restore, state)


def print_less() -> None:
    """Keep Warp's messages on compiling from standard output, where commands write their result."""
    import warp as wp

    wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)


def driven(
    drive: Drive, step: Callable[[], object], restore: Callable[[], None], state: Copies
) -> Iterator[dict[str, Array]]:
    """Yield chunks as `Engine.simulate`.

    ``step`` launches the kernels of one step; ``restore`` puts the copies back to their start;
    ``state`` of the copies has ``qfrc_applied`` and the fields that are recorded.
    """
    import warp as wp

    step()  # which loads its kernels
    with wp.ScopedCapture() as capture:
        step()
    restore()
    for time in drive.chunks():
        applied = drive.torque(time).astype(np.float32)
        out: dict[str, list[Array]] = {name: [] for name in drive.record}
        for k in range(len(time)):
            state.qfrc_applied.assign(np.ascontiguousarray(applied[:, k]))
            wp.capture_launch(capture.graph)
            for name, values in out.items():
                values.append(getattr(state, name).numpy().astype(float))
        yield {"time": time, **{name: np.stack(v, axis=1) for name, v in out.items()}}
