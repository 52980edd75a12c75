"""Series over time of a diagnosis, `series.csv`: measurement, both models, and each cause."""

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.gap.diagnosis import Diagnosis
from stiction_envs.gap.servo.servo_diagnosis import ServoDiagnosis
from stiction_envs.measured.logs.robot_log import RobotLog

ROWS = 20_000
"""Most rows of a file [-]; assumed: about 10 MB of an arm of seven joints."""
PAUSE = 1.0
"""Time between logs whose clocks do not say when one followed the other [s]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """T rows of n joints; angles in rad, torques in N·m."""

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

    def csv(self) -> str:
        """Return ``series.csv``: time, and a column for each signal of each joint."""
        x = "tau" if self.quantity == "torque" else "q"
        signals = {"q": self.q, "dq": self.dq, "q_cmd": self.q_cmd, x: self.measured}
        signals |= {f"{x}_nominal": self.nominal, f"{x}_simulated": self.simulated, **self.causes}
        columns = {"t": self.time[:, None]} | {k: v for k, v in signals.items() if v is not None}
        names = [f"{k}{j}" for k in columns if k != "t" for j in range(1, self.q.shape[1] + 1)]
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
    time = common_time(data.recording.t, data.recording.log, d.logs)
    at = np.arange(len(time))[:: _step(len(time))]
    return Series(
        quantity="torque",
        time=time[at],
        measured=data.tau[at],
        nominal=data.nominal[at],
        simulated=(data.nominal + d.torque)[at],
        q=data.q[at],
        dq=data.dq[at],
        at_rest=not np.isfinite(data.dt),
        causes={c.name: d.cause_torque(c.name)[at] for c in d.causes},
    )


def servo_series(d: ServoDiagnosis) -> Series:
    """Return the series of servo logs: angles at the rows of the logs that were simulated."""
    log = np.repeat(np.arange(len(d.logs)), [len(x.t) for x in d.logs])
    t = np.concatenate([x.t for x in d.logs])
    time = common_time(t, log, d.logs)
    nominal, simulated = np.concatenate(d.nominal_angles), np.concatenate(d.angles)
    q, q_cmd = (np.concatenate([getattr(x, k) for x in d.logs]) for k in ("q", "q_cmd"))
    speeds = [x.dq for x in d.logs if x.dq is not None]
    known = np.flatnonzero(np.isfinite(simulated).all(axis=1) & np.isfinite(nominal).all(axis=1))
    at = known[:: _step(len(known))]
    return Series(
        quantity="angle",
        time=time[at],
        measured=q[at],
        nominal=nominal[at],
        simulated=simulated[at],
        q=q[at],
        dq=np.concatenate(speeds)[at] if len(speeds) == len(d.logs) else None,
        q_cmd=q_cmd[at],
        causes={},
        contact=np.concatenate(d.touched)[at],
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
