"""Newton, the engine of Isaac Lab, with its own reader of MJCF and MuJoCo's solver."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import TYPE_CHECKING, ClassVar

import mujoco
import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.experiments.engines.base import Array, Bare, Drive, Engine, Refused
from stiction_envs.experiments.engines.warp import driven, print_less

if TYPE_CHECKING:
    import warp as wp
    from newton import Control
    from newton.solvers import SolverMuJoCo


class Newton(Engine):
    """Newton's `SolverMuJoCo`, float32. Its reader takes a ``dcmotor`` whose input is voltage."""

    name: ClassVar = "newton"
    packages: ClassVar = (
        ("newton", "newton"),
        ("mujoco_warp", "mujoco-warp"),
        ("warp", "warp-lang"),
    )
    motor: ClassVar = "voltage"
    keep: ClassVar = (
        "export with `--engine newton`; torques go to `control.mujoco.ctrl`, and the step is "
        "`solver.step(…, dt=0.001)`"
    )

    def simulate(self, drive: Drive) -> Iterator[dict[str, Array]]:
        """See `Engine.simulate`."""
        import newton

        print_less()
        bare = drive.bare
        if bare.mjcf is None:
            raise StictionError("engine newton reads MJCF: expected a robot's name, a path or text")
        try:
            arm = newton.ModelBuilder()
            arm.add_mjcf(str(bare.mjcf))
            scene = newton.ModelBuilder()
            scene.replicate(arm, len(drive.qpos))
            model = scene.finalize()
            with warnings.catch_warnings():
                # newton 1.8 asks for MuJoCo 3.17; it runs with 4.0
                warnings.simplefilter("ignore")
                solver = newton.solvers.SolverMuJoCo(model, disable_contacts=True)
        except (NotImplementedError, ValueError, KeyError) as error:
            raise Refused(error) from None
        if (solver.mj_model.nq, solver.mj_model.nv) != (bare.model.nq, bare.model.nv):
            raise Refused(f"reads {solver.mj_model.nv} degrees of freedom, MuJoCo {bare.model.nv}")
        model.set_gravity((0.0, 0.0, 0.0))
        _only_friction(solver, bare)
        state, control = model.state(), model.control()
        copies = _Copies(solver, control, (len(drive.qpos), bare.model.nv))

        def step() -> None:
            solver.step(state, state, control, None, drive.timestep)

        def restore() -> None:
            solver.mjw_data.act.zero_()
            solver.mjw_data.qacc_warmstart.zero_()
            state.joint_q.assign(drive.qpos.astype(np.float32).ravel())
            state.joint_qd.zero_()

        restore()
        yield from driven(drive, step, restore, copies)


def _only_friction(solver: SolverMuJoCo, bare: Bare) -> None:
    """Take limits, springs of tested hinges and actuators but ``dcmotor`` out of the solver."""
    model, host = solver.mjw_model, solver.mj_model
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    stiffness = model.jnt_stiffness.numpy()
    stiffness[:, bare.released] = 0.0
    model.jnt_stiffness.assign(stiffness)
    other = host.actuator_gaintype != mujoco.mjtGain.mjGAIN_DCMOTOR
    for name in ("actuator_gainprm", "actuator_biasprm"):
        values = getattr(model, name).numpy()
        values[:, other] = 0.0
        getattr(model, name).assign(values)


class _Copies:
    """Newton's state and control under the names that `driven` knows."""

    def __init__(self, solver: SolverMuJoCo, control: Control, shape: tuple[int, int]) -> None:
        self._solver = solver
        self.qfrc_applied = control.joint_f.reshape(shape)

    def __getattr__(self, name: str) -> wp.array:
        return getattr(self._solver.mjw_data, name)
