"""MuJoCo Warp, the engine of mjlab: on the GPU where there is one, else on Warp's CPU backend."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

import mujoco
import numpy as np

from stiction_envs.experiments.engines.base import (
    Array,
    Bare,
    Engine,
    Refused,
    Torque,
    chunks,
    silent,
)


class Warp(Engine):
    """MuJoCo Warp, float32; a step is one captured graph."""

    name: ClassVar = "warp"
    packages: ClassVar = (("mujoco_warp", "mujoco-warp"), ("warp", "warp-lang"))
    keep: ClassVar = 'nothing: `mujoco_warp.put_model(mujoco.MjModel.from_xml_path("scene.xml"))`'

    def simulate(
        self,
        bare: Bare,
        qpos: Array,
        torque: Torque,
        steps: int,
        *,
        record: Sequence[str] = ("qpos",),
        threads: int = 0,
    ) -> Iterator[dict[str, Array]]:
        """See `Engine.simulate`."""
        import mujoco_warp as mjw
        import warp

        warp.config.quiet = True
        host = silent(copy.copy(bare.model))
        data = mujoco.MjData(host)
        try:
            model = mjw.put_model(host)
        except (NotImplementedError, ValueError) as error:
            raise Refused(error) from None
        state = mjw.put_data(host, data, nworld=len(qpos))
        state.qpos.assign(qpos.astype(np.float32))
        step = captured(lambda: mjw.step(model, state), lambda: restore(state, qpos))
        yield from driven(step, state, torque, float(host.opt.timestep), steps, record)


def restore(state: Any, qpos: Array) -> None:
    """Put copies back to their start, at rest, bristles relaxed."""
    for name in ("qvel", "act", "qacc_warmstart", "time"):
        getattr(state, name).zero_()
    state.qpos.assign(qpos.astype(np.float32))


def captured(step: Any, back: Any) -> Any:
    """Return a function that repeats ``step``'s kernels, which cost little that way.

    Args:
        step: is called twice; kernels are compiled in the first call.
        back: undoes what the calls changed.
    """
    import warp

    step()
    with warp.ScopedCapture() as capture:
        step()
    back()
    return lambda: warp.capture_launch(capture.graph)


def driven(
    step: Any, state: Any, torque: Torque, timestep: float, steps: int, record: Sequence[str]
) -> Iterator[dict[str, Array]]:
    """Yield what `Engine.simulate` does of a state with ``qfrc_applied`` and the fields."""
    for time in chunks(timestep, steps):
        applied = torque(time).astype(np.float32)
        out: dict[str, list[Array]] = {name: [] for name in record}
        for k in range(len(time)):
            state.qfrc_applied.assign(np.ascontiguousarray(applied[:, k]))
            step()
            for name, values in out.items():
                values.append(getattr(state, name).numpy().astype(float))
        yield {"time": time, **{name: np.stack(v, axis=1) for name, v in out.items()}}
