"""Forward validation: the logs' torques drive the nominal and the extended model in stock MuJoCo.

Short windows start from the measured state, so that errors have no time to grow. There are two
simulations:

* replay: the measured torques alone; the result is the arm's distance from the log;
* tracking: a servo keeps the arm on the measured motion; the result is the torque that it adds.

Coefficients come from the blocks that are not simulated. A window in which one model becomes
unstable does not count. With too few windows the result is a reason.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch
from scipy.interpolate import CubicSpline

from stiction_envs.arrays import Array, Index, rms
from stiction_envs.errors import StictionError
from stiction_envs.gap.diagnosis import Diagnosis, model_of
from stiction_envs.gap.extended_model import TIMESTEP, extend
from stiction_envs.gap.predictors.torque import FOLDS
from stiction_envs.gap.signals.bristle import bristles
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.plant.any_model import steer
from stiction_envs.reporting.markdown import percent, short, table_text
from stiction_envs.robots.stated import BRISTLE_STIFFNESS, COULOMB

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
TIMES = np.arange(1, round(SECONDS / TIMESTEP) + 1) * TIMESTEP
"""Times of the simulation in a window [s]."""
FASTEST = 200.0
"""Speed above which the simulation counts as unstable [rad/s]; assumed: forty times what arms do. A
wrist without its friction reaches 50 in 0.2 s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ForwardValidation:
    """Nominal against extended model, on windows of blocks that were not fitted."""

    windows: int
    replay: dict[str, Array]
    """(n,) distance from the measured angles under the measured torques alone [rad], of the
    ``nominal`` and the ``extended`` model."""
    tracking: dict[str, Array]
    """(n,) torque that the tracking servo adds [N·m], likewise."""
    unstable: str = ""
    """In how many more windows which model is unstable."""

    def to_json(self) -> dict[str, object]:
        """Return ``forward`` of ``diagnosis.json``."""
        out = {"windows": self.windows, "replay_rad": self.replay, "tracking_nm": self.tracking}
        return out | ({"unstable": self.unstable} if self.unstable else {})

    @property
    def gains(self) -> tuple[Array, Array]:
        """(n,) how much less the extended model strays, and the servo adds to it [%]."""
        replay, tracking = (
            100 * (1 - x["extended"] / np.maximum(x["nominal"], 1e-12))
            for x in (self.replay, self.tracking)
        )
        return replay, tracking

    def text(self) -> str:
        """Return how both models fare, as Markdown."""
        columns = [*self.replay.values(), *self.tracking.values()]
        rows = [
            [f"joint {j}", *(short(x) for x in values)]
            for j, values in enumerate(zip(*columns, strict=True), start=1)
        ]
        means = [f"**{percent(-x.mean(), 0)}**" for x in self.gains]
        rows.append(["mean", "", means[0], "", means[1]])
        header = ["", "replay, nominal [rad]", "extended", "tracking, nominal [N·m]", "extended"]
        left_out = f" What is unstable does not count: {self.unstable}." if self.unstable else ""
        return (
            f"Both models run in stock MuJoCo on {self.windows} windows of {SECONDS:g} s that were "
            "not fitted, each from the measured state. Replay: how far the arm strays in "
            f"{REPLAY:g} s under the measured torques alone. Tracking: what a servo must add to "
            f"keep it on the measured motion.{left_out}\n\n{table_text(header, rows)}"
        )


def validate_forward(diagnosis: Diagnosis, *, threads: int = 0) -> ForwardValidation | str:
    """Simulate windows of held-out blocks with both models; return why there is no result.

    ``threads`` 0 is all processors.
    """
    base, nominal = diagnosis.base, diagnosis.baseline
    held = np.arange(1, base.block.max() + 1, FOLDS)
    if not np.isfinite(base.dt) or len(held) == 0:
        return "the logs hold no motion"
    windows = _windows(base, held)
    if len(windows) < LEAST_WINDOWS:
        return f"no {LEAST_WINDOWS} windows of {SECONDS:g} s without a gap in the held-out blocks"
    found = model_of(diagnosis, diagnosis.predictor.problem.without(1).fit(diagnosis.terms))
    rolls: dict[str, tuple[Array, Array]] = {}
    try:
        for name, model in (("nominal", nominal), ("extended", found)):
            made = extend(base, model)
            with silent_engine():
                rolls[name] = _simulate(made.xml, base, windows, made.left_out, threads)
    except StictionError as error:
        return str(error)
    stable = {name: np.isfinite(added).all(axis=(1, 2)) for name, (_, added) in rolls.items()}
    unstable = " and ".join(
        f"the {name} model in {np.count_nonzero(~x)} of {len(windows)} windows"
        for name, x in stable.items()
        if not x.all()
    )
    good = np.all([*stable.values()], axis=0)
    if np.count_nonzero(good) < LEAST_WINDOWS:
        return f"the simulation is unstable: {unstable}"
    return ForwardValidation(
        windows=int(np.count_nonzero(good)),
        replay={name: rms(strayed[good], (0, 1)) for name, (strayed, _) in rolls.items()},
        tracking={name: rms(added[good], (0, 1)) for name, (_, added) in rolls.items()},
        unstable=unstable,
    )


def _windows(data: Data, held: Index) -> list[slice]:
    """Return rows of windows within one segment and one held-out block, evenly picked."""
    count = int(np.ceil(SECONDS / data.dt)) + 1
    out = []
    for run in data.recording.runs:
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
        out.append(spline(TIMES, order))
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


def _simulate(
    text: str, data: Data, windows: list[slice], left_out: Array, threads: int
) -> tuple[Array, Array]:
    """Return (W, R, n) how far a model strays [rad] and (W, K, n) what its servo adds [N·m].

    Both of a window are NaN where one is unstable.
    """
    model = mujoco.MjModel.from_xml_string(text)
    names = data.arm.joint_names
    dof = np.array([model.joint(j).dofadr[0] for j in names])
    act = np.array([model.actuator(f"{j}_torque").id for j in names])
    starts = np.array([w.start for w in windows])
    distance = model.actuator_biasprm[act, COULOMB] / model.actuator_dynprm[act, BRISTLE_STIFFNESS]
    dragged = bristles(data.q, data.recording.runs, distance[:, None])[starts, :, 0]
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
    start["act"][:, model.actuator_actadr[act]] = distance * dragged
    control = np.zeros((*torque.shape[:2], model.nu))
    control[:, :, act] = torque
    # no further than it counts: a joint whose friction is missing spins up in half a second
    steps, fast = round(REPLAY / TIMESTEP), FASTEST
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
    strayed = _link(replayed, model, names) - measured[:, :steps]
    bad = ~(np.isfinite(replayed).all(axis=(1, 2)) & np.isfinite(tracked).all(axis=(1, 2)))
    strayed[bad] = added[bad] = np.nan
    return strayed, added[:, round(TRANSIENT / TIMESTEP) :]


def _link(qpos: Array, model: mujoco.MjModel, names: tuple[str, ...]) -> Array:
    """Return (W, K, n) link angles."""
    out = qpos[..., [model.joint(j).qposadr[0] for j in names]]
    known = {model.joint(k).name: model.joint(k).qposadr[0] for k in range(model.njnt)}
    for i, j in enumerate(names):
        if f"{j}_spring" in known:
            out[..., i] += qpos[..., known[f"{j}_spring"]]
    return out


def _mass(model: mujoco.MjModel, q: Array, dof: Index) -> Array:
    """Return the (n, n) mass matrix [kg·m²]."""
    work = mujoco.MjData(model)
    work.qpos[dof] = q
    mujoco.mj_forward(model, work)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, work, full)
    return np.asarray(full[np.ix_(dof, dof)])
