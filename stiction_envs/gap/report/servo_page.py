"""Numbers, tables and pictures of a report of servo logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from stiction_envs.gap.report.figures import AFTER, BEFORE, MEASURED, tidy
from stiction_envs.gap.report.pages import by_joint, section, shown
from stiction_envs.gap.report.result import Picture, where
from stiction_envs.gap.report.score_figures import draw_summary
from stiction_envs.gap.servo.diagnosis import ServoDiagnosis
from stiction_envs.gap.servo.parameters import FAR, INDEX, PARAMETERS
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.reporting.markdown import table_text
from stiction_envs.reporting.png import save_small

SECONDS = 12.0
"""Length of the stretch that is drawn of each joint [s]; assumed."""
UNITS = {p.key: p.unit for p in PARAMETERS.values()} | {
    "stiction_nm": "N·m",
    "lag_s": "s",
    "bristle_stiffness": "N·m/rad",
    "stretches_s": "s",
}
WOULD = {
    "payload": "a log with another, known mass at the tip",
    "link_parameters": "a log with a known mass at the tip",
    "encoder_offset": "poses on both sides of where gravity's torque on the joint is zero",
    "servo_stiffness": "its stiffness, from the data sheet, as --servo-stiffness",
    "torque_offset": "poses on both sides of where gravity's torque on the joint is zero",
    "backlash": "pushing the joint by hand while it is commanded to rest",
    "coulomb_friction": "slow motion through several poses, both ways",
    "damping": "commands of several frequencies, up to where the joint hardly follows",
    "delay": "commands of several frequencies, up to where the joint hardly follows",
    "armature": "commands of several frequencies, up to where the joint hardly follows",
    "torque_limit": "the same fast motion with and without a known mass",
    "external_contact": "the same motion with nothing within reach",
}
"""Measurements that would tell a cause from another."""
OTHERWISE = "a motion in which the two act differently"


def servo_page(d: ServoDiagnosis, plots: Path, *, headline: str) -> dict[str, object]:
    """Draw the pictures of a report of servo logs; return its template's variables."""
    n = len(d.noise)
    mrad = 1e3 * d.nominal_rms, 1e3 * d.extended_rms, 1e3 * d.noise
    caption = "Error of each joint: the simulation that was judged, the extended one, noise floor."
    summary = draw_summary(*mrad, plots / "summary.png", "error of the angle [mrad]", caption)
    check_errors = ""
    if d.check is not None:
        both = 1e3 * d.check.nominal_rms, 1e3 * d.check.extended_rms
        check_errors = by_joint(["nominal", "extended"], *both)
    return {
        "headline": headline,
        "pictures": {
            "summary": shown(summary),
            "joints": [shown(_draw_joint(d, j, plots / f"joint{j + 1}.png")) for j in range(n)],
        },
        "causes": [
            section(
                c,
                {where((j,)): found for j, found in c.parameters.items()}
                if c.name != "external_contact"
                else {},
                UNITS,
                {other: WOULD.get(other, OTHERWISE) for other in c.confused_with},
            )
            for c in d.causes
        ],
        "errors": by_joint(["nominal", "extended", "noise floor"], *mrad),
        "check_errors": check_errors,
        "servos": table_text(
            ["", *(f"joint {j + 1}" for j in range(n))],
            [
                [
                    f"{name.replace('_', ' ')} [{p.unit}]",
                    *(_value(x, p.absent) for x in d.parameters[:, INDEX[name]]),
                ]
                for name, p in PARAMETERS.items()
            ],
        ),
    }


def _value(x: float, none: float) -> str:
    return "–" if x == none or x >= FAR else f"{x:.3g}"


def _draw_joint(d: ServoDiagnosis, j: int, path: Path) -> Picture:
    """Draw measured and simulated angles of a joint where it moves most, and their difference."""
    log, start = _busiest(d, j)
    t, q = log.t, log.q[:, j]
    k = next(i for i, other in enumerate(d.logs) if other is log)
    rows = (t >= start) & (t <= start + SECONDS)
    t = t[rows] - start
    figure = Figure(figsize=(7.2, 4.4))
    figure.subplots_adjust(left=0.11, right=0.98, top=0.9, bottom=0.12, hspace=0.12)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    above.step(t, log.q_cmd[rows, j], where="post", color="0.75", lw=1.0, label="commanded")
    nominal, model = d.nominal_angles[k][rows, j], d.angles[k][rows, j]
    if not np.array_equal(nominal, log.q_cmd[rows, j]):
        above.plot(t, nominal, color=BEFORE, lw=1.0, label="nominal simulation")
    above.plot(t, q[rows], color=MEASURED, lw=1.6, label="measured")
    above.plot(t, model, color=AFTER, lw=1.1, label="extended simulation")
    above.set_ylabel("angle [rad]")
    above.legend(fontsize=8, frameon=False, ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    below.plot(t, 1e3 * (q[rows] - nominal), color=BEFORE, lw=1.0)
    below.plot(t, 1e3 * (q[rows] - model), color=AFTER, lw=1.1)
    below.set_ylabel("measured less\nsimulated [mrad]")
    below.set_xlabel("time [s]")
    tidy(above, zero=False)
    tidy(below)
    save_small(figure, path)
    text = f"Joint {j + 1}, {SECONDS:g} s of its fastest motion."
    return Picture(path.name, text)


def _busiest(d: ServoDiagnosis, j: int) -> tuple[ServoLog, float]:
    """Return the log and the start of the stretch in which a joint's command moves most."""
    best, found = -1.0, (d.logs[0], float(d.logs[0].t[0]))
    for log in d.logs:
        path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(log.q_cmd[:, j])))])
        ends = np.interp(log.t + SECONDS, log.t, path)
        k = int(np.argmax(ends - path))
        if ends[k] - path[k] > best:
            best, found = float(ends[k] - path[k]), (log, float(log.t[k]))
    return found
