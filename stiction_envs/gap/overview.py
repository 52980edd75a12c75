"""Page to read before a diagnosis: facts about a joint log, and the causes that it can show.

    print(overview(log, arm))

Rate and cutoff, the torques' units and signs, where gravity points, which joints rest or move
together; and for each cause how much of its prior is left along this motion, if the arm has its
usual friction and small errors. No cause is looked for.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stiction_envs.gap.causes import TOLERANCES, registered
from stiction_envs.gap.causes.base import THE_ARM
from stiction_envs.gap.judge.problem import ARM
from stiction_envs.gap.predictors.judged import plain_friction
from stiction_envs.gap.predictors.torque import TorquePredictor
from stiction_envs.gap.signals.dataset import Data, assemble
from stiction_envs.gap.signals.loads import Loads, loads
from stiction_envs.gap.signals.prepare import Signals, prepare
from stiction_envs.gap.signals.spectra import effective_rate
from stiction_envs.gap.signals.torque_lag import correct_torques, lag_of
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.measured.motion_thresholds import TRAVEL_SPAN
from stiction_envs.reporting.markdown import aligned
from stiction_envs.reporting.markdown import joints as joint_list
from stiction_envs.robots import Arm

FACTOR_OFF = 0.15
"""Part by which torques differ from what an arm with usual errors needs, at most [-]; assumed."""
MOST_SAMPLES = 1500
"""Samples that are used [-]; assumed, to answer within a second."""
TOGETHER = 0.98
"""Least correlation of the speeds of joints that move together [-]; assumed."""


@dataclass(frozen=True, kw_only=True)
class Overview:
    """Facts about one log; lists have a number for each joint."""

    file: str
    rows: int
    seconds: float
    rate_hz: float
    effective_rate_hz: float
    """Rate of new values, lower where there are gaps."""
    cutoff: str
    """Bandwidth of the filter, and the reason for it."""
    span_rad: list[float]
    needed_nm: list[float]
    """Torque that gravity and inertia need, root mean square."""
    logged_nm: list[float]
    """Logged torque, the same."""
    factor: list[float]
    """Logged over needed torque, with friction, offset and rotor free."""
    factor_ci95: list[list[float]]
    about: list[str]
    """Remark on each joint: rests, opposite sign, not measured, moves with others; or nothing."""
    gravity: list[float]
    """Direction of gravity in the world."""
    lag_s: float
    """Time by which the torques come later than the angles."""
    findings: list[tuple[str, str]]
    """Defects, ``corrected``, ``warning`` or ``remark`` before each."""
    left: dict[str, list[float]]
    """Posterior over prior standard deviation of each cause on each joint, or on the arm [-]."""

    def __str__(self) -> str:
        down = " ".join(f"{x:.2g}" for x in np.round(self.gravity, 2) + 0.0)
        late = f"{1e3 * self.lag_s:.0f} ms late" if self.lag_s else "in step with the angles"
        rows = []
        for k, (low, high) in enumerate(self.factor_ci95):
            factor, wide = self.factor[k], (high - low) / 2
            shown = wide < max(0.5, abs(factor) / 2)
            torques = f"{self.needed_nm[k]:.3g} N·m", f"{self.logged_nm[k]:.3g} N·m"
            number = f"{factor:.3f} ± {wide:.3f}" if shown else "not shown"
            rows.append([f"{k + 1}", f"{self.span_rad[k]:.3g} rad", *torques, number])
        table = aligned(["joint", "turns by", "needs", "logged", "factor"], rows).splitlines()
        lines = [
            f"{self.file}: {self.rows} rows, {self.seconds:.1f} s, {self.rate_hz:.4g} rows/s"
            f" (new values: {self.effective_rate_hz:.4g}/s)",
            self.cutoff,
            f"gravity along {down}; torques {late}",
            "",
            *(f"{x}  {about}".rstrip() for x, about in zip(table, ["", *self.about], strict=True)),
            "",
            "part of the prior that is left, by joint (up to 0.5: the log shows it)",
        ]
        for name, parts in self.left.items():
            lines.append(f"{name:<30}" + "".join(f"{x:>7.2f}" for x in parts))
        return "\n".join(lines)


def overview(log: JointLog, arm: Arm, *, torque: str = "motor") -> Overview:
    """Return the overview of a log; ``torque`` is the side of the gear of its torques.

    Raises:
        StictionError: a log that is too short for a filter.
    """
    first = prepare([log])
    found = loads(first, 0, arm)
    (read,), signals = correct_torques(
        [log], arm, lambda some: first if some[0] is log else prepare(some)
    )
    findings = [("corrected", c.text) for c in read.corrections[len(log.corrections) :]]
    findings += [("warning", x) for x in (*read.warnings[len(log.warnings) :], *signals.findings)]
    findings += [("remark", x) for x in _unlike(found) if not signals.findings]
    ends = np.stack([found.factor - found.width, found.factor + found.width], axis=1)
    return Overview(
        file=Path(log.source).name,
        rows=len(log.t),
        seconds=float(log.t[-1] - log.t[0]),
        rate_hz=1 / log.step,
        effective_rate_hz=effective_rate([log]),
        cutoff=signals.notes[0],
        span_rad=np.ptp(log.q, axis=0).tolist(),
        needed_nm=found.needed.tolist(),
        logged_nm=found.logged.tolist(),
        factor=found.factor.tolist(),
        factor_ci95=ends.tolist(),
        about=_about(log, signals, found),
        gravity=found.gravity.tolist(),
        lag_s=sum(lag_of([read]) or (0.0,)),
        findings=findings,
        left=_left(assemble(arm, _thinned(signals), torque=torque)),
    )


def _about(log: JointLog, signals: Signals, found: Loads) -> list[str]:
    """Return remarks on each joint."""
    speed = signals.dq
    moves = np.ptp(log.q, axis=0) > TRAVEL_SPAN
    # a joint at rest has no correlation but that of the ramp
    alike = np.abs(np.atleast_2d(np.corrcoef(speed.T + 1e-12 * np.arange(len(speed))))) > TOGETHER
    out = []
    for j in range(log.n):
        others = [k + 1 for k in range(log.n) if k != j and alike[j, k] and moves[j] and moves[k]]
        remarks = {
            "rests": not moves[j],
            "torque not measured": not (found.measured[j] or found.held[j]),
            "opposite sign": found.sign[j] < 0,
            f"moves with {joint_list(others)}": bool(others),
        }
        out.append(", ".join(text for text, is_so in remarks.items() if is_so))
    return out


def _unlike(found: Loads) -> list[str]:
    """Return a remark on joints whose torques are not what the model needs."""
    off = (np.abs(found.factor - 1) > FACTOR_OFF + found.width) & (found.sign >= 0)
    off &= found.measured
    if not off.any():
        return []
    low, high = (f"{f(found.factor[off]):.3g}" for f in (np.min, np.max))
    times = low if low == high else f"{low} to {high}"
    return [
        f"{joint_list((np.flatnonzero(off) + 1).tolist())}: the torques are {times} times what the "
        "model needs beside friction: a body or a link that it has wrong, or a gain?"
    ]


def _thinned(signals: Signals) -> Signals:
    """Return fewer samples of the same signals, `MOST_SAMPLES` or so."""
    step = max(1, len(signals.t) // MOST_SAMPLES)
    if not np.isfinite(signals.dt):
        return signals
    kept = np.concatenate([np.arange(x.start, x.stop, step) for x in signals.runs])
    names = ("t", "q", "dq", "ddq", "tau", "log", "segment", "static", "path_rows")
    rows = {name: getattr(signals, name)[kept] for name in names}
    return replace(signals, **rows, dt=signals.dt * step, every=signals.every * step)


def _left(data: Data) -> dict[str, list[float]]:
    """Return posterior over prior of each linear cause beside usual friction and small errors."""
    at_rest = not np.isfinite(data.dt)
    causes = [c for c in registered() if c.is_linear and (c.shown_at_rest or not at_rest)]
    predictor = TorquePredictor(data, [TOLERANCES, *causes])
    problem, usual = predictor.problem, plain_friction(predictor)
    first = {t[:2]: t for t in reversed(predictor.candidates)}
    out = dict[str, list[float]]()
    for cause in causes:
        for joint in cause.joints(data):
            if joint == ARM and cause.acts_on != THE_ARM:
                continue
            left, term = 1.0, first.get((cause.name, joint))
            if term is not None:
                others = [t for t in usual if t[:2] != term[:2]]
                number = len(problem.numbers[term])
                variance = problem.covariance(problem.model([*others, term]))[-number, -number]
                left = min(1.0, float(np.sqrt(variance) / problem.sd(term)[0]))
            out.setdefault(cause.name, []).append(left)
    return out
