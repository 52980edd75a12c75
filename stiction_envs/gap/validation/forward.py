"""Forward validation: the logs' torques drive the nominal and the extended model in stock MuJoCo.

Short windows start from the measured state, so that errors have no time to grow. There are two
simulations:

* replay: the measured torques alone; the result is the arm's distance from the log;
* tracking: a servo keeps the arm on the measured motion; the result is the torque that it adds.

Coefficients come from the blocks that are not simulated. Where the simulation of one model becomes
unstable, the window ends for both models before that. A window of which too little is left does
not count. With too few windows the result is a reason.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from stiction_envs.errors import StictionError
from stiction_envs.friction.model import BRISTLE_DAMPING, BRISTLE_STIFFNESS, COULOMB
from stiction_envs.gap.diagnosis import Diagnosis, model_of
from stiction_envs.gap.extended_mjcf import TIMESTEP
from stiction_envs.gap.extended_model import extend
from stiction_envs.gap.predictors.torque import FOLDS
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.plant.any_model import steer

Array = NDArray[np.float64]
SECONDS = 0.5
"""Length of a window [s]; assumed."""
REPLAY = 0.2
"""Start of a window in which the replay counts [s]; assumed: its errors grow with the square of
time."""
MOST_WINDOWS = 64
"""Windows that are simulated, evenly picked [-]; assumed."""
LEAST_WINDOWS = 2
"""Windows without which there is no result [-]; assumed."""
BANDWIDTH = 40.0
"""Bandwidth of the tracking servo [rad/s]; assumed: faster than the motion of logs, slower than
its noise."""
TRANSIENT = 0.15
"""Start of a window that does not count for tracking [s]; assumed: the servo's transient."""
FASTEST = 200.0
"""Speed above which the simulation counts as unstable [rad/s]; assumed: forty times what arms do. A
wrist without its friction reaches 50 in 0.2 s."""
MARGIN = 0.02
"""Time that is cut off before a simulation is unstable [s]; assumed: the error grows for some steps
before."""
SHORTEST = 0.5
"""Part of what counts of a window that must be left of one that ends early [-]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One model in all windows."""

    angle: Array
    """(W, R, n) simulated angles under the measured torques alone [rad], NaN behind the end of a
    window that was shortened."""
    position_rms: Array
    """(n,) from the measured angles [rad]."""
    torque_rms: Array
    """(n,) of what the tracking servo adds [N·m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ForwardValidation:
    """Nominal against extended, on windows of blocks that were not fitted."""

    time: Array
    """(K,) since the start of a window [s]."""
    measured: Array
    """(W, K, n) [rad]."""
    nominal: Run
    extended: Run
    start: Array
    """(W,) start of each window on its log's clock [s]."""
    shortened: int = 0
    """Windows that end early, where the simulation of a model is unstable."""
    left_out: int = 0
    """Windows of which too little was left."""
    unstable: str = ""
    """Which model is unstable there, and by what measure."""

    def to_json(self) -> dict[str, object]:
        """Return ``forward`` of ``diagnosis.json``."""
        both = {"nominal": self.nominal, "extended": self.extended}
        out: dict[str, object] = {
            "windows": len(self.start),
            "replay_rad": {k: x.position_rms for k, x in both.items()},
            "tracking_nm": {k: x.torque_rms for k, x in both.items()},
        }
        return out | ({"unstable": self.unstable} if self.unstable else {})

    @property
    def position_gain(self) -> Array:
        """(n,) how much less the extended model strays [%]."""
        return _gain(self.nominal.position_rms, self.extended.position_rms)

    @property
    def torque_gain(self) -> Array:
        """(n,) how much less the servo adds [%]."""
        return _gain(self.nominal.torque_rms, self.extended.torque_rms)


def _gain(before: Array, after: Array) -> Array:
    return np.asarray(100 * (1 - after / np.maximum(before, 1e-12)))


def validate_forward(diagnosis: Diagnosis, *, threads: int = 0) -> ForwardValidation | str:
    """Simulate windows of held-out blocks with both models; return why there is no result.

    ``threads`` 0 is all processors.
    """
    base, nominal = diagnosis.base, diagnosis.baseline
    held = np.arange(1, base.blocks, FOLDS)
    if not np.isfinite(base.dt) or len(held) == 0:
        return "the logs hold no motion"
    windows = _windows(base, held)
    if len(windows) < LEAST_WINDOWS:
        return f"no {LEAST_WINDOWS} windows of {SECONDS:g} s without a gap in the held-out blocks"
    found = model_of(diagnosis, diagnosis.predictor.problem.without(1).fit(diagnosis.terms))
    rolls = []
    try:
        for model in (nominal, found):
            made = extend(base, model)
            with silent_engine():
                rolls.append(_simulate(made.xml, base, windows, made.left_out, threads))
    except StictionError as error:
        return str(error)
    ends = np.minimum(*(roll.ends for roll in rolls))
    full = np.array([_steps(REPLAY), _steps(SECONDS)])
    skipped = np.array([0, _steps(TRANSIENT)])
    kept = (ends - skipped >= SHORTEST * (full - skipped)).all(axis=1)
    unstable = _unstable(rolls, ends < full)
    if np.count_nonzero(kept) < LEAST_WINDOWS:
        many = f"{np.count_nonzero(~kept)} of {len(windows)} windows"
        return f"the simulation is unstable in {many}: {unstable}"
    measured = _resampled(base, windows, base.q)[kept]
    runs = [_run(roll, measured, ends, kept) for roll in rolls]
    return ForwardValidation(
        time=_times(),
        measured=measured,
        nominal=runs[0],
        extended=runs[1],
        start=np.array([base.t[w.start] for w in windows])[kept],
        shortened=int(np.count_nonzero((ends < full).any(axis=1) & kept)),
        left_out=int(np.count_nonzero(~kept)),
        unstable=unstable,
    )


def _steps(seconds: float) -> int:
    """Return the number of steps of the simulation."""
    return round(seconds / TIMESTEP)


def _times() -> Array:
    return np.asarray(np.arange(1, _steps(SECONDS) + 1) * TIMESTEP, dtype=np.float64)


def _windows(data: Data, held: NDArray[np.int64]) -> list[slice]:
    """Return rows of windows within one segment and one held-out block, evenly picked."""
    count = int(np.ceil(SECONDS / data.dt)) + 1
    out = []
    for run in data.runs():
        block = data.block[run]
        edges = np.flatnonzero(np.diff(block)) + 1
        for a, b in zip([0, *edges], [*edges, len(block)], strict=True):
            if block[a] in held:
                first = run.start + a
                out += [slice(k, k + count) for k in range(first, run.start + b - count, count)]
    if len(out) > MOST_WINDOWS:
        out = [out[int(k)] for k in np.linspace(0, len(out) - 1, MOST_WINDOWS)]
    return out


def _resampled(data: Data, windows: list[slice], signal: Array, order: int = 0) -> Array:
    """Return (W, K, ...) of a signal, or of its derivative, at the simulation's times."""
    out = []
    for w in windows:
        spline = CubicSpline(np.arange(w.stop - w.start) * data.dt, signal[w])
        out.append(spline(_times(), order))
    return np.array(out)


@contextmanager
def silent_engine() -> Iterator[None]:
    """Keep MuJoCo from writing warnings to the console and to MUJOCO_LOG.TXT, in all threads."""
    before, silent = mujoco.MjLogConfig.get(), mujoco.MjLogConfig.get()
    silent.logto_console = silent.logto_file = False
    silent.set()
    try:
        yield
    finally:
        before.set()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Roll:
    """One model in all windows, as far as the engine went."""

    angle: Array
    """(W, R, n) under the measured torques alone [rad]."""
    added: Array
    """(W, K, n) torque of the servo [N·m]."""
    ends: NDArray[np.int64]
    """(W, 2) steps of replay and of tracking before the simulation is unstable."""
    decay: float
    """Largest h λ(M⁻¹C) of the bristles' damping C at the windows' starts; Euler holds below 2."""


def _simulate(text: str, data: Data, windows: list[slice], left_out: Array, threads: int) -> _Roll:
    model = mujoco.MjModel.from_xml_string(text)
    names = data.arm.joint_names
    dof = np.array([model.joint(j).dofadr[0] for j in names])
    act = np.array([model.actuator(f"{j}_torque").id for j in names])
    starts = np.array([w.start for w in windows])
    bristle = _bristle(data, model, act)[starts]
    measured = _resampled(data, windows, data.q)
    speed = _resampled(data, windows, data.q, 1)
    # a torque is held for one step: that of the step's start
    torque = _resampled(data, windows, data.tau - left_out)
    torque = np.concatenate([(data.tau - left_out)[starts][:, None], torque[:, :-1]], axis=1)

    start = {
        "qpos": np.zeros((len(windows), model.nq)),
        "qvel": np.zeros((len(windows), model.nv)),
        "act": np.zeros((len(windows), model.na)),
    }
    start["qpos"][:, dof], start["qvel"][:, dof] = data.q[starts], data.dq[starts]
    start["act"][:, model.actuator_actadr[act]] = bristle
    control = np.zeros((*torque.shape[:2], model.nu))
    control[:, :, act] = torque
    # no further than it counts: a joint whose friction is missing spins up in half a second
    steps, fast = _steps(REPLAY), FASTEST
    replayed = steer(model, start, lambda k, _: control[:, k], steps, fastest=fast, threads=threads)
    added = np.empty_like(torque)
    inertia = np.array([_mass(model, data.q[k], dof) for k in starts])

    def servo(k: int, batch: Batch) -> Array:
        want = measured[:, k - 1] if k else data.q[starts]
        want_speed = speed[:, k - 1] if k else data.dq[starts]
        off = want - batch.bind("qpos")[:, dof]
        off_speed = want_speed - batch.bind("qvel")[:, dof]
        pull = BANDWIDTH**2 * off + 2 * BANDWIDTH * off_speed
        added[:, k] = np.einsum("wij,wj->wi", inertia, pull)
        out = control[:, k].copy()
        out[:, act] += added[:, k]
        return out

    tracked = steer(model, start, servo, control.shape[1], fastest=fast, threads=threads)
    # viscous friction is stepped implicitly, a bristle's damping is not
    decay = np.linalg.eigvals(np.linalg.inv(inertia) * model.actuator_dynprm[act, BRISTLE_DAMPING])
    return _Roll(
        angle=_link(replayed, model, names),
        added=added,
        ends=np.stack([_end(x) for x in (replayed, tracked)], axis=1),
        decay=TIMESTEP * float(np.abs(decay).max()),
    )


def _end(qpos: Array) -> NDArray[np.int64]:
    """Return (W,) steps before positions (W, K, nq) are NaN, less what grows just before it."""
    good = np.all(np.isfinite(qpos), axis=2)
    count = good.sum(axis=1)
    return np.where(np.all(good, axis=1), count, np.maximum(count - _steps(MARGIN), 0))


def _unstable(rolls: list[_Roll], early: NDArray[np.bool_]) -> str:
    """Return which models are unstable and by what measure; "" without one."""
    if not early.any():
        return ""
    full = np.array([rolls[0].angle.shape[1], rolls[0].added.shape[1]])
    of = [
        f"the {name} model in {np.count_nonzero((roll.ends < full).any(axis=1))} windows "
        f"(step times bristle damping over inertia reaches {roll.decay:.2g}; stable is below 2)"
        for name, roll in zip(("nominal", "extended"), rolls, strict=True)
        if (roll.ends < full).any()
    ]
    return " and ".join(of)


def _run(roll: _Roll, measured: Array, ends: NDArray[np.int64], kept: NDArray[np.bool_]) -> Run:
    """Return a model's errors in the windows that are kept, up to the end of both models."""
    angle, added = (
        np.where((np.arange(x.shape[1]) < end[:, None])[..., None], x, np.nan)[kept]
        for x, end in zip((roll.angle, roll.added), ends.T, strict=True)
    )
    return Run(
        angle=angle,
        position_rms=_rms(angle - measured[:, : angle.shape[1]]),
        torque_rms=_rms(added[:, _steps(TRANSIENT) :]),
    )


def _rms(x: Array) -> Array:
    """Return (n,) root mean square of (W, K, n) as far as windows go."""
    return np.asarray(np.sqrt(np.nanmean(np.square(x), axis=(0, 1))))


def _link(qpos: Array, model: mujoco.MjModel, names: tuple[str, ...]) -> Array:
    """Return (W, K, n) link angles."""
    out = qpos[..., [model.joint(j).qposadr[0] for j in names]]
    known = {model.joint(k).name: model.joint(k).qposadr[0] for k in range(model.njnt)}
    for i, j in enumerate(names):
        if f"{j}_spring" in known:
            out[..., i] += qpos[..., known[f"{j}_spring"]]
    return out


def _mass(model: mujoco.MjModel, q: Array, dof: NDArray[np.int64]) -> Array:
    """Return the (n, n) mass matrix [kg·m²]."""
    work = mujoco.MjData(model)
    work.qpos[dof] = q
    mujoco.mj_forward(model, work)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, work, full)
    return np.asarray(full[np.ix_(dof, dof)])


def _bristle(data: Data, model: mujoco.MjModel, act: NDArray[np.int64]) -> Array:
    """Return (T, n) deflection [rad] of bristles dragged along the measured motion."""
    stiffness = model.actuator_dynprm[act, BRISTLE_STIFFNESS]
    most = model.actuator_biasprm[act, COULOMB] / np.maximum(stiffness, 1e-9)
    out = np.zeros_like(data.q)
    for run in data.runs():
        z = np.clip(np.sign(data.dq[run.start]), -1, 1) * most
        out[run.start] = z
        for k in range(run.start + 1, run.stop):
            z = np.clip(z + data.q[k] - data.q[k - 1], -most, most)
            out[k] = z
    return out
