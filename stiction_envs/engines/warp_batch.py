"""N simulations on MuJoCo Warp, with the part of `mujoco.batch.Batch` that the plant uses.

    plant writes float64 arrays -> device, as float32 -> K captured steps -> float64 arrays again

The plant's arrays are the state: every call sends them to the device, steps there, and fetches
those of the simulations that it was asked for. So a result depends neither on the other simulations
nor on calls for them.

All is float32 but two sums, which are float64 on the device, too. What a slowly creeping joint adds
to its angle in a step is less than half of a float32's last digit, and would be lost. A bristle
that bends as slowly would not bend: 1 − exp(−x) is 0 in float32 for x below 3e-8.

On a graphics card a step is one CUDA graph, and so is all of `follow`: a control interval with its
controller. On a processor Warp replays the same graph, on one thread. Warp's default device is
used. Several batches may be used by as many threads: `DEVICE` lets one of them at the device.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from threading import RLock

import mujoco
import mujoco_warp
import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from stiction_envs.engines.graphs import captured
from stiction_envs.engines.warp_friction import VECTOR, DeviceFriction
from stiction_envs.errors import StictionError
from stiction_envs.friction.model import (
    BRISTLE_STIFFNESS,
    COULOMB,
    STICTION,
    STRIBECK,
    StickingModel,
)

Array = NDArray[np.float64]
Index = NDArray[np.int64]
STEPS = 64
"""Most steps whose commands and angles are on the device at a time; changes no result."""
LARGEST = 1e10
"""Angles [rad] and speeds [rad/s] from which MuJoCo calls a simulation unstable (mjMAXVAL)."""
_SUMMED = ("qpos", "act")
"""What is summed in float64."""
_STATE = ("qvel", "qacc_warmstart")
"""What steps change besides."""
_INPUTS = ("ctrl", "qfrc_applied")
"""What only the plant writes."""
DEVICE = RLock()
"""Held by whoever uses Warp's device: what it captures must be the work of one thread."""


@wp.kernel(enable_backward=False)
def _command(
    step: wp.array[wp.int32], commands: wp.array3d[wp.float32], ctrl: wp.array2d[wp.float32]
) -> None:
    """Write the controls of this step."""
    world, actuator = wp.tid()
    ctrl[world, actuator] = commands[step[0], world, actuator]


@wp.kernel(enable_backward=False)
def sum_angles(
    step: wp.array[wp.int32],
    timestep: wp.float64,
    qvel: wp.array2d[wp.float32],
    angle: wp.array2d[wp.float64],
    qpos: wp.array2d[wp.float32],
    record: wp.array3d[wp.float64],
) -> None:
    """Sum the angles in float64, from the speeds that the engine has just added to its own."""
    world, joint = wp.tid()
    summed = angle[world, joint] + timestep * wp.float64(qvel[world, joint])
    angle[world, joint] = summed
    qpos[world, joint] = wp.float32(summed)
    record[step[0] % record.shape[0], world, joint] = summed


@wp.kernel(enable_backward=False)
def bend_bristles(
    timestep: wp.float64,
    actuators: wp.array[wp.int32],
    addresses: wp.array[wp.int32],
    dynprm: wp.array2d[VECTOR],
    biasprm: wp.array2d[VECTOR],
    velocity: wp.array2d[wp.float32],
    bristle: wp.array2d[wp.float64],
    act: wp.array2d[wp.float32],
) -> None:
    """Integrate LuGre's bristles over a step as MuJoCo does, in float64."""
    world, k = wp.tid()
    actuator, address = actuators[k], addresses[k]
    law = biasprm[world % biasprm.shape[0], actuator]
    stiffness = wp.float64(dynprm[world % dynprm.shape[0], actuator][BRISTLE_STIFFNESS])
    coulomb, stiction = wp.float64(law[COULOMB]), wp.float64(law[STICTION])
    speed = wp.float64(velocity[world, actuator])
    ratio = speed / wp.float64(law[STRIBECK])
    level = coulomb + (stiction - coulomb) * wp.exp(-ratio * ratio)
    x = timestep * stiffness * wp.abs(speed) / level
    share = wp.float64(1.0) - wp.float64(0.5) * x
    if x > wp.float64(1e-6):
        share = (wp.float64(1.0) - wp.exp(-x)) / x
    bent = wp.exp(-x) * bristle[world, address] + timestep * share * speed
    bristle[world, address] = bent
    act[world, address] = wp.float32(bent)


@wp.kernel(enable_backward=False)
def _count(step: wp.array[wp.int32]) -> None:
    step[0] = step[0] + 1
    step[1] = step[1] + 1


def _weightless(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return the model without gravity if every body's is compensated.

    The motion is the same. But on a card threads would sum the compensation of all bodies in any
    order: a run would not be the same bits twice.
    """
    if not (model.body_gravcomp[1:] == 1.0).all():  # the first body is the world
        return model
    out = copy(model)
    out.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_GRAVITY
    return out


class WarpBatch:
    """N simulations of a model whose joints are all hinges or slides."""

    def __init__(self, model: mujoco.MjModel, nsim: int) -> None:
        """Make the simulations; all start at the model's reference angles.

        Raises:
            StictionError: a model with other joints, or one that MuJoCo Warp cannot take.
        """
        simple = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
        if not np.isin(model.jnt_type, simple).all():
            raise StictionError("engine warp: expected a model with hinges and slides only")
        self.model, self.nsim = model, nsim
        try:
            self._model = mujoco_warp.put_model(_weightless(model))
        except NotImplementedError as error:
            raise StictionError(f"engine warp does not take this model: {error}") from None
        self._data = mujoco_warp.make_data(model, nworld=nsim, nconmax=0)
        self._template = mujoco.MjData(model)
        self._bound: dict[str, Array] = {}
        self._expanded: dict[str, Array] = {}
        self._graphs: dict[str, Callable[[], None]] = {}
        self._angle = wp.zeros((nsim, model.nq), dtype=wp.float64)
        self._bristle = wp.zeros((nsim, model.na), dtype=wp.float64)
        motors = model.actuator_dyntype == mujoco.mjtDyn.mjDYN_DCMOTOR
        bristles = motors & (model.actuator_dynprm[:, BRISTLE_STIFFNESS] > 0)
        lugre = np.flatnonzero(bristles & (model.actuator_actnum == 1))
        self._lugre = [wp.array(x, dtype=wp.int32) for x in (lugre, model.actuator_actadr[lugre])]
        self._commands = wp.zeros((STEPS, nsim, model.nu), dtype=wp.float32)
        self._record = wp.zeros((STEPS, nsim, model.nq), dtype=wp.float64)
        # steps since commands were sent, and since the call
        self._step = wp.zeros(2, dtype=wp.int32)
        self._friction: DeviceFriction | None = None
        self.warning = np.zeros((nsim, int(mujoco.mjtWarning.mjNWARNING), 2), dtype=np.int32)
        """(N, warnings, 2) as `Batch.warning`: of bad speeds and angles, the number of calls."""
        for name in (*_SUMMED, *_STATE, *_INPUTS):
            self.bind(name)
        self.reset()

    # ---- arrays ------------------------------------------------------------------------------

    def bind(self, name: str) -> Array:
        """Return a live (N, …) array of a field of `MjData`.

        State and inputs may be written; all else is as of the last call for a simulation.
        """
        if name not in self._bound:
            self._bound[name] = np.zeros((self.nsim, *getattr(self._template, name).shape))
        return self._bound[name]

    def expand(self, name: str) -> Array:
        """Give a model field per-simulation values; return them, (N, …)."""
        if name not in self._expanded:
            shared = getattr(self._model, name)
            values = np.repeat(shared.numpy(), self.nsim, axis=0)
            setattr(self._model, name, wp.array(values, dtype=shared.dtype))
            self._graphs.clear()  # they know the array that was there
            own = np.asarray(getattr(self.model, name), dtype=float)
            self._expanded[name] = np.repeat(own[None], self.nsim, axis=0)
        return self._expanded[name]

    def expanded(self, name: str) -> Array | None:
        """Return the per-simulation values of a model field, None where all share the model's."""
        return self._expanded.get(name)

    def carry(self, sticking: StickingModel, up: NDArray[np.bool_], every: int) -> DeviceFriction:
        """Let the device choose each joint's friction by its direction, every so many steps.

        Args:
            sticking: what the model is of.
            up: (N, n) whether a joint moves up, or did when it last moved; read and written.
            every: steps from one choice to the next.
        """
        for name in ("actuator_biasprm", "dof_damping"):
            self.expand(name)
        self._friction = DeviceFriction(sticking, up, every)
        self._graphs.clear()
        return self._friction

    # ---- calls -------------------------------------------------------------------------------

    def reset(self, ids: ArrayLike | None = None, stage: int = 0) -> None:
        """Put simulations into the model's reference state; derived fields follow with a call."""
        rows = self._rows(ids)
        for name in ("act", *_STATE, *_INPUTS):
            self._bound[name][rows] = 0.0
        self._bound["qpos"][rows] = self.model.qpos0
        self.warning[rows] = 0

    def forward(self, ids: ArrayLike | None = None, stage: int = 0) -> None:
        """Compute the kinematics of the present state."""
        with DEVICE:
            self._send()
            self._launch("kinematics", self._kinematics)
            self._fetch_derived(self._rows(ids))

    def step(self, ids: ArrayLike | None = None, nstep: int = 1, stage: int = 0) -> None:
        """Advance under the present controls, then compute the kinematics if a ``stage`` asks."""
        rows = self._rows(ids)
        control = np.repeat(self._bound["ctrl"][rows, None], nstep, axis=1)
        self._advance(rows, control, kinematics=stage > 0)

    def rollout(
        self,
        nstep: int,
        *,
        control: Array,
        record: tuple[str, ...] = ("qpos",),
        ids: ArrayLike | None = None,
    ) -> dict[str, Array]:
        """Advance simulations by ``nstep`` steps under controls (M, nstep, nu).

        Returns:
            The positions (M, nstep, nq) after each step, by the name ``qpos``.
        """
        return {"qpos": self._advance(self._rows(ids), control)}

    def follow(self, name: str, control: Callable[[int], None], steps: int, substeps: int) -> None:
        """Advance all simulations by control steps, all of it on the device, as one graph.

        Args:
            name: of the graph: the same launches have the same name.
            control: launches what writes `ctrl` in a control step, from 0.
            steps: control steps.
            substeps: of the physics in each.
        """

        def work() -> None:
            for k in range(steps):
                self._kinematics()
                if self._friction is not None:
                    self._friction.launch_slow(k, self.device)
                control(k)
                for _ in range(substeps):
                    self._one_step()
            self._kinematics()

        self._send()
        self._step.zero_()
        self._launch(f"follow {name}", work)
        rows = self._rows(None)
        self._bound["qfrc_applied"][:] = self._data.qfrc_applied.numpy()
        self._fetch(rows)

    # ---- on the device -----------------------------------------------------------------------

    def _rows(self, ids: ArrayLike | None) -> Index:
        return np.arange(self.nsim) if ids is None else np.asarray(ids)

    def _send(self) -> None:
        """Send the plant's arrays."""
        self._angle.assign(self._bound["qpos"])
        self._bristle.assign(self._bound["act"])
        for name in (*_SUMMED, *_STATE, *_INPUTS):
            getattr(self._data, name).assign(self._bound[name])
        for name, values in self._expanded.items():
            getattr(self._model, name).assign(values)
        if self._friction is not None:
            self._friction.send()

    def _advance(self, rows: Index, control: Array, kinematics: bool = False) -> Array:
        """Step under controls (M, K, nu); return the positions (M, K, nq) after each step."""
        nstep = control.shape[1]
        sent = np.zeros((nstep, self.nsim, self.model.nu), dtype=np.float32)
        sent[:, rows] = control.swapaxes(0, 1)
        out = np.empty((len(rows), nstep, self.model.nq))
        with DEVICE:
            self._send()
            for start in range(0, nstep, STEPS):
                part = slice(start, min(start + STEPS, nstep))
                count = part.stop - start
                self._commands[:count].assign(sent[part])
                self._step.assign(np.array([0, start], dtype=np.int32))
                for _ in range(count):
                    self._launch("step", self._commanded_step)
                out[:, part] = self._record[:count].numpy()[:, rows].swapaxes(0, 1)
            if kinematics:
                self._launch("kinematics", self._kinematics)
            self._fetch(rows)
        return out

    def _fetch(self, rows: Index) -> None:
        """Fetch what steps have changed."""
        if self._friction is not None:
            self._friction.fetch(rows)
        self._bound["qpos"][rows] = self._angle.numpy()[rows]
        self._bound["act"][rows] = self._bristle.numpy()[rows]
        for name in _STATE:
            self._bound[name][rows] = getattr(self._data, name).numpy()[rows]
        self._fetch_derived(rows)
        self._warn(rows)

    def _fetch_derived(self, rows: Index) -> None:
        for name, mirror in self._bound.items():
            if name not in (*_SUMMED, *_STATE, *_INPUTS):
                mirror[rows] = getattr(self._data, name).numpy()[rows]

    def _warn(self, rows: Index) -> None:
        for name, kind in (
            ("qpos", mujoco.mjtWarning.mjWARN_BADQPOS),
            ("qvel", mujoco.mjtWarning.mjWARN_BADQVEL),
        ):
            good = (np.abs(self._bound[name][rows]) < LARGEST).all(axis=1)  # false for NaN too
            self.warning[rows[~good], int(kind), 1] += 1

    def _launch(self, name: str, work: Callable[[], None]) -> None:
        """Run work on the device as a graph, captured the first time."""
        if name in self._graphs:
            self._graphs[name]()
        else:
            self._graphs[name] = captured(work)

    def _kinematics(self) -> None:
        mujoco_warp.kinematics(self._model, self._data)
        mujoco_warp.com_pos(self._model, self._data)

    @property
    def device(self) -> mujoco_warp.Data:
        """MuJoCo Warp's data; its arrays stay the same objects."""
        return self._data

    @property
    def angle(self) -> wp.array:
        """(N, nq) angles on the device, in float64 [rad]."""
        return self._angle

    def _commanded_step(self) -> None:
        wp.launch(
            _command,
            dim=(self.nsim, self.model.nu),
            inputs=[self._step, self._commands],
            outputs=[self._data.ctrl],
        )
        self._one_step()

    def _one_step(self) -> None:
        m, d = self.model, self._data
        if self._friction is not None:
            self._friction.launch(self._step, self._model, d)
        mujoco_warp.step(self._model, d)
        wp.launch(
            sum_angles,
            dim=(self.nsim, m.nq),
            inputs=[self._step, m.opt.timestep, d.qvel],
            outputs=[self._angle, d.qpos, self._record],
        )
        wp.launch(
            bend_bristles,
            dim=(self.nsim, len(self._lugre[0])),
            inputs=[
                *(m.opt.timestep, *self._lugre, self._model.actuator_dynprm),
                *(self._model.actuator_biasprm, d.actuator_velocity),
            ],
            outputs=[self._bristle, d.act],
        )
        wp.launch(_count, dim=1, outputs=[self._step])
