"""Series over time of a diagnosis: measurement, both models, and each cause.

They are written as ``series.csv``, and for Rerun with contact, evidence and the arm in 3-D.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.errors import StictionError, missing_extra
from stiction_envs.gap.diagnosis import Diagnosis
from stiction_envs.gap.servo.diagnosis import ServoDiagnosis
from stiction_envs.measured.logs.robot_log import RobotLog
from stiction_envs.reporting.output_folder import check_file
from stiction_envs.robots import Arm

ROWS = 20_000
"""Most rows of a file [-]; assumed: about 10 MB of an arm of seven joints."""
PAUSE = 1.0
"""Time between logs whose clocks do not say when one followed the other [s]; assumed."""
TIMELINE = "time"
WIDTH = 0.02
"""Radius of the line that an arm is drawn as, over its length [-]; assumed."""
Colour = tuple[int, int, int]
"""Red, green, blue [0 to 255]."""
COLOURS: dict[str, Colour] = {
    "commanded": (110, 110, 110),
    "measured": (160, 160, 160),
    "nominal": (224, 108, 24),
    "simulated": (70, 140, 220),
    "contact": (224, 108, 24),
}
"""Colours of the report's pictures, lighter, since Rerun's viewer is dark; causes have Rerun's."""
Rerun = Any
"""Objects of Rerun: their types are there with the extra only."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """T rows of n joints; angles in rad, torques in N·m."""

    arm: Arm
    quantity: str
    """Quantity that was compared: ``torque`` or ``angle``."""
    time: Array
    """(T,) rising [s]."""
    measured: Array
    """(T, n)."""
    nominal: Array
    """(T, n) of the simulation that was judged."""
    simulated: Array
    """(T, n) of the extended model."""
    q: Array
    """(T, n) measured angles [rad]."""
    dq: Array | None
    """(T, n) measured speeds [rad/s], where they are known."""
    q_cmd: Array | None = None
    """(T, n) commanded angles [rad] of servo logs."""
    causes: dict[str, Array]
    """(T, n) torque that each cause adds [N·m]; none of servo logs."""
    at_rest: bool = False
    """Whether the rows are poses without time."""
    contact: Bools | None = None
    """(T,) whether the arm touches something, of servo logs."""

    @property
    def unit(self) -> str:
        """Unit of the quantity that was compared."""
        return "N·m" if self.quantity == "torque" else "rad"

    def csv(self) -> str:
        """Return ``series.csv``: time, and a column for each signal of each joint."""
        x = "tau" if self.quantity == "torque" else "q"
        signals = {"q": self.q, "dq": self.dq, "q_cmd": self.q_cmd, x: self.measured}
        signals |= {f"{x}_nominal": self.nominal, f"{x}_simulated": self.simulated, **self.causes}
        columns = {"t": self.time[:, None]} | {k: v for k, v in signals.items() if v is not None}
        names = [f"{k}{j}" for k in columns if k != "t" for j in range(1, self.arm.n + 1)]
        if self.contact is not None:
            columns["contact"] = self.contact[:, None].astype(np.float64)
            names.append("contact")
        out = io.StringIO()
        rows = np.concatenate([*columns.values()], axis=1)
        np.savetxt(out, rows, "%.9g", ",", header=",".join(["t", *names]), comments="")
        return out.getvalue()


def log_series(d: Diagnosis) -> Series:
    """Return the series of joint logs: filtered torques, all models along the measured motion."""
    data = d.data
    extended = data.nominal + np.stack([d.torque(j) for j in range(data.n)], axis=1)
    time = common_time(data.t, data.recording.log, d.logs)
    at = np.arange(len(time))[:: _step(len(time))]
    return Series(
        arm=data.arm,
        quantity="torque",
        time=time[at],
        measured=data.tau[at],
        nominal=data.nominal[at],
        simulated=extended[at],
        q=data.q[at],
        dq=data.dq[at],
        at_rest=not np.isfinite(data.dt),
        causes={c.name: d.cause_torque(c.name)[at] for c in d.causes},
    )


def servo_series(d: ServoDiagnosis, arm: Arm) -> Series:
    """Return the series of servo logs: angles at the rows of the logs that were simulated."""
    log = np.repeat(np.arange(len(d.logs)), [len(x.t) for x in d.logs])
    t = np.concatenate([x.t for x in d.logs])
    time = common_time(t, log, d.logs)
    nominal, simulated = np.concatenate(d.nominal_angles), np.concatenate(d.angles)
    q, q_cmd = (np.concatenate([getattr(x, k) for x in d.logs]) for k in ("q", "q_cmd"))
    speeds = [x.dq for x in d.logs if x.dq is not None]
    contact = np.zeros(len(t), dtype=bool)
    for k, stretches in enumerate(d.touching):
        for begin, end in stretches:
            contact |= (log == k) & (t >= begin) & (t <= end)
    known = np.flatnonzero(np.isfinite(simulated).all(axis=1) & np.isfinite(nominal).all(axis=1))
    at = known[:: _step(len(known))]
    return Series(
        arm=arm,
        quantity="angle",
        time=time[at],
        measured=q[at],
        nominal=nominal[at],
        simulated=simulated[at],
        q=q[at],
        dq=np.concatenate(speeds)[at] if len(speeds) == len(d.logs) else None,
        q_cmd=q_cmd[at],
        causes={},
        contact=contact[at],
    )


def common_time(t: Array, log: Index, logs: Sequence[RobotLog]) -> Array:
    """Return (T,) time of all rows on the clock of the first log [s].

    A log that does not follow the one before it on that clock begins `PAUSE` after it. ``t`` (T,)
    is the time of each row on the clock of its log [s], ``log`` (T,) the number of its log, rising.
    """
    dates = [x.date for x in logs]
    known = [x for x in dates if x is not None]
    zero = known[0] if len(known) == len(logs) else 0.0
    out, end = t.copy(), -np.inf
    for k in np.unique(log):
        rows = log == k
        if zero:
            out[rows] += known[k] - zero
        if out[rows][0] <= end:
            out[rows] += end + PAUSE - out[rows][0]
        end = out[rows][-1]
    return out


def _step(count: int) -> int:
    """Return the step between the rows that are kept, of so many."""
    return max(1, -(-count // ROWS))


def check_rrd(path: Path, *, force: bool = False, made: Path | None = None) -> None:
    """Raise if a recording cannot be written; the folder ``made`` will be there.

    Raises:
        StictionError: Rerun's SDK is not installed, or the name or place is wrong.
    """
    try:
        import rerun  # noqa: F401
    except ImportError:
        raise missing_extra("writing for Rerun", "rerun-sdk", "rerun") from None
    check_file(path, ".rrd", force=force)
    if not path.parent.is_dir() and (made is None or path.parent.resolve() != made.resolve()):
        raise StictionError(f"output {path}: {path.parent}: expected an existing folder")


def rrd_bytes(s: Series, words: str) -> bytes:
    """Return the file, with ``words`` in Markdown; starts no viewer and opens no connection."""
    import rerun as rr

    recording = rr.RecordingStream(f"stiction_envs {s.arm.name}", send_properties=False)
    kept = recording.memory_recording()
    for group, drawn in _lines(s).items():
        for j in range(s.arm.n):
            alone = {name: values[:, j] for name, values in drawn.items()}
            _send_lines(recording, f"{group}/joint_{j + 1}", s.time, alone)
    if s.contact is not None:
        _send_lines(recording, "contact", s.time, {"contact": s.contact.astype(float)})
    text = f"# {s.arm.name}\n\n{words}"
    if s.quantity == "torque":
        text += "\n\nTorques are simulated along the measured motion: one arm is drawn."
    recording.log("diagnosis", rr.TextDocument(text, media_type="text/markdown"), static=True)
    _send_arm(recording, "measured", s, s.q)
    if s.quantity == "angle":
        _send_arm(recording, "simulated", s, s.simulated)
    recording.send_blueprint(_blueprint(s))
    recording.flush()
    return bytes(kept.drain_as_bytes())


def _lines(s: Series) -> dict[str, dict[str, Array]]:
    """Return (T, n) values of each line by name, by group."""
    commanded = {} if s.q_cmd is None else {"commanded": s.q_cmd}
    models = {"nominal": s.nominal, "simulated": s.simulated}
    left = {name: s.measured - x for name, x in models.items()}
    out = {s.quantity: {**commanded, "measured": s.measured, **models}, "residual": left}
    return out | ({"cause": s.causes} if s.causes else {})


def _send_lines(recording: Rerun, path: str, time: Array, drawn: dict[str, Array]) -> None:
    """Send (T,) values of lines that are drawn together, and how."""
    import rerun as rr

    colours = [COLOURS[name] for name in drawn if name in COLOURS] or None
    recording.log(path, rr.SeriesLines(colors=colours, names=list(drawn)), static=True)
    values = rr.Scalars.columns(scalars=np.stack([*drawn.values()], axis=1))
    recording.send_columns(path, [rr.TimeColumn(TIMELINE, duration=time)], values)


def _blueprint(s: Series) -> Rerun:
    """Return the layout of the viewer: arm and words beside a tab for each joint."""
    import rerun.blueprint as rrb

    def joint(j: int) -> Rerun:
        of = f"joint_{j + 1}"
        groups = [(s.quantity, f"{s.quantity} [{s.unit}]"), ("residual", f"residual [{s.unit}]")]
        if s.causes:
            groups.append(("cause", "torque of each cause [N·m]"))
        views = [rrb.TimeSeriesView(origin=f"{g}/{of}", name=title) for g, title in groups]
        if s.contact is not None and s.contact.any():
            views.append(rrb.TimeSeriesView(origin="contact", name="touches something"))
        return rrb.Vertical(*views, name=f"joint {j + 1}")

    left = rrb.Vertical(
        rrb.Spatial3DView(origin="arm", name="arm"),
        rrb.TextDocumentView(origin="diagnosis", name="diagnosis"),
    )
    joints = rrb.Tabs(*(joint(j) for j in range(s.arm.n)))
    return rrb.Blueprint(rrb.Horizontal(left, joints), auto_views=False)


def _send_arm(recording: Rerun, name: str, s: Series, q: Array) -> None:
    """Send the arm at angles (T, n) [rad] as a line from base to flange."""
    import rerun as rr

    line = skeleton(s.arm, q)
    reach = np.linalg.norm(np.diff(line[0], axis=0), axis=1).sum()
    look = rr.LineStrips3D.from_fields(radii=[WIDTH * reach], colors=[COLOURS[name]])
    recording.log(f"arm/{name}", look, static=True)
    clock = rr.TimeColumn(TIMELINE, duration=s.time)
    strips = rr.LineStrips3D.columns(strips=list(line))
    recording.send_columns(f"arm/{name}", [clock], strips)


def skeleton(arm: Arm, q: Array) -> Array:
    """Return (T, n + 2, 3) places of the base, the joints and the flange at (T, n) angles [m]."""
    model = arm.model()
    data = mujoco.MjData(model)
    flange = model.site(arm.end_effector).id
    out = np.empty((len(q), arm.n + 2, 3))
    for k, angles in enumerate(q):
        data.qpos[:] = angles
        mujoco.mj_kinematics(model, data)
        out[k, 0] = data.xpos[model.body_parentid[model.jnt_bodyid[0]]]
        out[k, 1:-1], out[k, -1] = data.xanchor, data.site_xpos[flange]
    return out
