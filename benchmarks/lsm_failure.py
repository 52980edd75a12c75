"""Why the thesis's friction-velocity fit failed (section 4.1), and what the tool says of the same.

    python benchmarks/lsm_failure.py

Simulated Panda logs whose friction is known, with one thing wrong at a time; then the real Panda
from ../shared/measured (left out, and said so, where that is absent). Equation 3.1 and RosDyn's
least squares beside `diagnose`. Writes lsm_failure.md and lsm_failure.png beside this file.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from stiction_envs.gap.diagnosis import Diagnosis, diagnose
from stiction_envs.gap.least_squares import LeastSquares, least_squares, line
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.measured import thesis_table
from stiction_envs.measured.logs.reader import JointLog, read_logs
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.markdown import table
from stiction_envs.robots import Arm, load_arm
from stiction_envs.robots.regressor import torque_regressor
from stiction_envs.thesis.lsm import WRONG, bands_of, friction, raw_friction, simulated_log
from stiction_envs.thesis.rosdyn import Unconstrained, rosdyn
from stiction_envs.thesis.settings import thesis_settings

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from _lsm_picture import draw_panels  # noqa: E402

PANDA = "panda_exciting_trajectory/panda_exciting_trajectory.csv.gz"
MEASURED = HERE.parents[1] / "shared" / "measured" / PANDA
BAND = bands_of("panda")
SETTINGS = thesis_settings().identification
MOVING = 0.01
"""Speed from which on friction does not hang on how a law turns round [rad/s]; assumed."""
EVERY = 15
"""Of so many samples a picture shows one."""


@dataclass(frozen=True)
class Result:
    """What three methods say of one log."""

    log: JointLog
    squares: LeastSquares
    links: Unconstrained
    found: Diagnosis


def judge(log: JointLog, arm: Arm, link_side: bool = False) -> Result:
    found = diagnose([log], arm, link_side=link_side)
    squares = least_squares(found.logs, found.base)
    return Result(log, squares, rosdyn(found.logs, arm), found)


def plain_masses(log: JointLog, arm: Arm) -> np.ndarray:
    """Masses (n,) of the links [kg] by least squares of the smallest norm, on raw signals.

    As RosDyn's, but without a nominal model that fills up what the torques do not show.
    """
    assert log.dq is not None
    step = max(1, len(log.t) // 4000)
    ddq = np.gradient(log.dq, log.t, axis=0)
    q, dq, ddq, tau = (x[::step] for x in (log.q, log.dq, ddq, log.tau))
    links = torque_regressor(arm.pinocchio(), q, dq, ddq).reshape(len(q) * arm.n, -1)
    own = np.zeros((len(q), arm.n, 2, arm.n))
    j = np.arange(arm.n)
    own[:, j, 0, j], own[:, j, 1, j] = np.sign(dq), dq
    x = np.hstack([links, own.reshape(len(links), -1)])
    return np.linalg.lstsq(x, tau.ravel(), rcond=1e-10)[0][: 10 * arm.n : 10]


def known(d: Diagnosis, squares: LeastSquares, least: float = 0.0) -> tuple[float, float]:
    """Root mean square of the lines' and the tool's friction about the true one, over its own.

    Of the samples of a speed above ``least`` [rad/s].
    """
    data = d.data
    true = data.smooth(friction(data.dq, BAND))
    lines = np.zeros_like(true)
    for x in squares.lines:
        rows = (1 if x.direction == "+" else -1) * data.dq[:, x.joint - 1] > 0
        lines[rows, x.joint - 1] = x.slope * data.dq[rows, x.joint - 1] + x.intercept
    rows = np.abs(data.dq) >= least
    size = np.sqrt(np.mean(true[rows] ** 2))
    return tuple(
        float(np.sqrt(np.mean(np.square(x - true)[rows])) / size)
        for x in (data.smooth(lines), named(d))
    )  # type: ignore[return-value]


def dry(d: Diagnosis) -> np.ndarray:
    """Dry friction that the tool names, (n,) [N·m]; NaN where it names none."""
    out = np.full(d.data.n, np.nan)
    for c in d.causes:
        if c.name == "coulomb_friction":
            for j, found in c.parameters.items():
                out[j - 1] = found["coulomb_nm"].value
    return out


def bands(squares: LeastSquares) -> tuple[np.ndarray, np.ndarray]:
    """Half the distance and the middle of the two intercepts, (n,) each [N·m]."""
    plus = np.array([x.intercept for x in squares.lines[::2]])
    minus = np.array([x.intercept for x in squares.lines[1::2]])
    return (plus - minus) / 2, (plus + minus) / 2


def stages(r: Result, arm: Arm) -> list[tuple[str, np.ndarray, np.ndarray, float]]:
    """Mends one after the other: R² and intercepts (2 n,) of the lines, largest torque [N·m]."""
    log, data = r.found.logs[0], r.found.data
    v, tau = raw_friction(log, arm, EVERY)
    smooth = np.stack([np.interp(log.t, data.t, x) for x in data.ddq.T], axis=1)
    at = np.arange(2, len(log.t) - 2, EVERY)
    at = at[(log.t[at] > data.t[0]) & (log.t[at] < data.t[-1])]
    assert log.dq is not None
    rigid = inverse_dynamics(arm.pinocchio(), log.q[at], log.dq[at], smooth[at])
    other = np.stack([r.found.torque(j) for j in range(data.n)], axis=1) - named(r.found)
    out = []
    for name, speed, torque in (
        ("as in the thesis: everything raw", v, tau),
        ("accelerations from the zero-phase filter", log.dq[at], log.tau[at] - rigid),
        ("torques and speeds too", data.dq, data.residual),
        ("less the other causes that the tool names", data.dq, data.residual - other),
    ):
        fits = [
            line(speed[s * speed[:, j] > 0, j], torque[s * speed[:, j] > 0, j])
            for j in range(data.n)
            for s in (1, -1)
        ]
        r2, b = np.array([x[2] for x in fits]), np.array([x[1] for x in fits])
        out.append((name, r2, b, float(np.abs(torque).max())))
    return out


def named(d: Diagnosis) -> np.ndarray:
    """Torque (T, n) of Coulomb, viscous and Stribeck friction that the tool names [N·m]."""
    out = np.zeros_like(d.data.q)
    kept = ("coulomb_friction", "viscous_friction", "stribeck_friction")
    for term, mine in zip(d.terms, d.library.split(d.terms, d.coefficients), strict=True):
        if term.cause in kept:
            out[:, term.joint] += d.library.columns(term, term.joint) @ mine
    return out


# ---- page ------------------------------------------------------------------------------------


def simulated_rows(results: dict[str, Result]) -> list[list[str]]:
    """One row for each simulated log."""
    out = []
    for name, r in results.items():
        half, middle = bands(r.squares)
        r2 = np.array([x.r2 for x in r.squares.lines])
        off = np.abs(half / BAND - 1)
        by_lines, by_tool = known(r.found, r.squares)
        moving = known(r.found, r.squares, MOVING)
        causes = [f"{c.name} ({', '.join(map(str, c.joints))})" for c in r.found.causes]
        masses = plain_masses(r.log, load_arm("panda"))
        out.append(
            [
                name,
                f"{100 * np.median(off):.0f} % (worst {100 * off.max():.0f} %)",
                f"{np.abs(middle).max():.2f}",
                f"{np.median(r2):.3f} ({r2.min():.1g})",
                f"{100 * by_lines:.0f} %",
                f"{100 * by_tool:.0f} %",
                f"{100 * moving[0]:.0f} %, {100 * moving[1]:.0f} %",
                f"{np.sum(masses < 0)}, {len(r.links.negative_masses)}",
                str(len(r.links.impossible)),
                ", ".join(causes),
            ]
        )
    return out


def page(results: dict[str, Result], real: Result | None, arm: Arm) -> str:
    s = SETTINGS
    lines = [
        "# Why the friction-velocity fit of the thesis failed",
        "",
        "Made by `python benchmarks/lsm_failure.py`. The thesis (section 4.1) takes friction "
        "torque as measured torque less the model's, all raw, and lays a straight line over speed "
        "per joint and direction (equation 3.1); the intercept was to be the stiction band. Its "
        "Table A.1 has R² of 1e-6 to 0.04 and intercepts of −4.2 to +3.5 N·m; its Table 4.1 "
        "(RosDyn) has negative masses.",
        "",
        "![lsm](lsm_failure.png)",
        "",
        "## Simulated: one thing wrong at a time",
        "",
        f"Panda, {s.seconds:g} s at {s.rate:g} Hz, Fourier trajectories, torque noise "
        f"{s.torque_noise:g} N·m. True bands {BAND.min():g} to {BAND.max():g} N·m, Coulomb "
        f"friction {s.coulomb_ratio:g} of them, Stribeck velocity {s.stribeck_velocity:g} rad/s, "
        f"viscous friction in proportion. What is wrong: noise of {1e3 * s.speed_noise:g} mrad/s "
        "on the logged speed, of which accelerations are differences; an unknown hand of "
        f"{s.hand[0]:g} kg; "
        "motion eight times as fast, so that few "
        f"samples are slow; speeds behind a low-pass of {1e3 * s.speed_lag:g} ms.",
        "",
        *table(
            [
                "wrong",
                "band off by, median",
                "bands' middle, worst [N·m]",
                "R², median (least)",
                "friction off: lines",
                "tool",
                "in motion: lines, tool",
                "masses < 0: plain, RosDyn",
                "RosDyn's links that cannot be",
                "tool names (joints)",
            ],
            simulated_rows(results),
        ),
        "Friction off: root mean square of the friction torque about the true one, over the true "
        "one's, along the filtered motion; in motion: of samples faster than "
        f"{1e3 * MOVING:g} mrad/s. The law simulated here turns round at once, as lines do; the "
        "tool's friction bites within some hundredths of a milliradian, as joints do. Masses: by "
        "least squares without any nominal model, and by RosDyn's, which fills up from a nominal "
        "model what torques do not show.",
        "",
        *conclusions(results),
    ]
    if real is None:
        lines += ["## Real Panda", "", "Left out: the measured logs are not here.", ""]
        return "\n".join(lines).rstrip("\n") + "\n"
    return "\n".join([*lines, *real_part(real, arm)]).rstrip("\n") + "\n"


def conclusions(results: dict[str, Result]) -> list[str]:
    clean, noisy, heavy = (results[k] for k in ("nothing", "noisy acceleration", "gravity error"))
    fast, lag = results["no slow data"], results["filtered speeds that lag"]

    def r2(r: Result) -> float:
        return float(np.median([x.r2 for x in r.squares.lines]))

    half = {k: bands(r.squares)[0] for k, r in results.items()}
    middle = np.abs(bands(heavy.squares)[1])
    low = half["nothing"] / BAND
    return [
        f"- Even on good signals the intercept is not the band: it is {low.min():.2f} to "
        f"{low.max():.2f} of it. The line knows Coulomb and viscous friction only; the Stribeck "
        "peak stands within some centiradians per second of zero, where few samples are.",
        f"- Noise of the acceleration leaves the intercepts (it is as often up as down) and takes "
        f"R² from {r2(clean):.2f} to {r2(noisy):.3f}. A low R² alone does not say that a band is "
        "wrong: it says that scatter hides the slope.",
        "- A gravity error is what moves intercepts: it looks like friction of one sign in the "
        f"poses in which a joint happens to move that way. Bands lie about up to "
        f"{middle.max():.2f} N·m instead of zero, as in Table A.1 (joint 2: −3.1 and −4.2 N·m; "
        "joint 4: +3.5 and +2.7 N·m).",
        f"- Without slow data the line is right where it has samples (R² {r2(fast):.2f}), and its "
        "intercept is Coulomb friction: nothing of stiction is in it.",
        f"- Speeds that lag turn at the wrong time and give accelerations that are late: R² "
        f"{r2(lag):.2f}, and torques of inertia count as friction.",
        "- Least squares on links has no bound that keeps masses positive or inertias possible: "
        "torques show sums of parameters only, and what they do not show is filled up by "
        "whatever stands beside it. `stiction_envs.identification.identify` keeps links possible. "
        "Hundreds of kilograms, as in Table 4.1, come out of none of these logs.",
        f"- With nothing wrong at all R² is {r2(clean):.2f}: along a friction curve that is nearly "
        "flat there is no slope to explain. R² near zero, on which the thesis gave the method up, "
        "does not say that an intercept is wrong, and joint 7's band of Table 4.2 was right.",
        "",
    ]


def real_part(real: Result, arm: Arm) -> list[str]:
    thesis = {(r["joint"], r["direction"]): r for r in thesis_table("A.1")}
    rows = []
    found = dry(real.found)
    for x in real.squares.lines:
        mine = thesis[x.joint, x.direction]
        rows.append(
            [
                f"joint {x.joint} ({x.direction.replace('-', '−')})",
                f"{mine['intercept_Nm']:.3g}",
                f"{mine['slope_Nms_per_rad']:.3g}",
                f"{mine['r2']:.2g}",
                f"{x.intercept:.3g}",
                f"{x.slope:.3g}",
                f"{x.r2:.2g}",
                f"{found[x.joint - 1]:.3g}" if np.isfinite(found[x.joint - 1]) else "none named",
            ]
        )
    steps = [
        [
            name,
            f"{np.median(r2):.2g}",
            f"{r2.min():.1g} to {r2.max():.2g}",
            f"{largest:.1f}",
            str(int(np.sum(np.sign(b[::2]) != 1) + np.sum(np.sign(b[1::2]) != -1))),
        ]
        for name, r2, b, largest in stages(real, arm)
    ]
    return [
        "## Real Panda",
        "",
        "Another Panda than the thesis's, on its own excitation run (../shared/measured), the same "
        "fit. Torque is that of link-side sensors here. Thesis: Table A.1.",
        "",
        *table(
            [
                "line",
                *("thesis: intercept [N·m]", "slope [N·m·s/rad]", "R²"),
                *("this log: intercept", "slope", "R²", "tool: Coulomb [N·m]"),
            ],
            rows,
        ),
        "What of it is noise, what is the model:",
        "",
        *table(
            [
                "signals",
                "R², median",
                "R², range",
                "largest friction torque [N·m]",
                "bands of the wrong sign, of 14",
            ],
            steps,
        ),
        f"RosDyn's least squares on this log: {len(real.links.negative_masses)} links of negative "
        f"mass, {len(real.links.impossible)} of 7 that no body can be; without a nominal model to "
        f"fill up: masses {', '.join(f'{m:.3g}' for m in plain_masses(real.log, arm))} kg.",
        "",
        "What the tool says is wrong with the fit, joint by joint:",
        "",
        *(f"- joint {j}: {'; '.join(why)}" for j, why in sorted(real.squares.breaks.items())),
        "",
        f"The tool on the same log: {real.found.verdict}; "
        + ", ".join(f"{c.name} ({', '.join(map(str, c.joints))})" for c in real.found.causes)
        + ".",
        "",
    ]


def draw(results: dict[str, Result], real: Result | None, arm: Arm) -> None:
    """Draw friction torque over speed, simulated above and real below."""
    panels = []
    for name, r in results.items():
        v, tau = raw_friction(r.log, arm, EVERY)
        panels.append((f"simulated joint 2: {name}", v[:, 1], tau[:, 1], friction_of(1)))
    if real is not None:
        data = real.found.data
        v, tau = raw_friction(real.found.logs[0], arm, EVERY)
        for j in (0, 6):
            panels.append((f"real joint {j + 1}, raw", v[:, j], tau[:, j], None))
            panels.append(
                (f"real joint {j + 1}, filtered", data.dq[:, j], data.residual[:, j], None)
            )
    draw_panels(panels, HERE / "lsm_failure.png")


def friction_of(joint: int) -> Callable[[np.ndarray], np.ndarray]:
    """True friction of one joint (from 0) over speed."""
    return lambda v: friction(np.tile(v[:, None], len(BAND)), BAND)[:, joint]


def main() -> None:
    arm = load_arm("panda")
    results = {
        name: judge(simulated_log("panda", **wrong(SETTINGS)), arm)
        for name, wrong in tqdm(WRONG.items(), desc="simulated logs")
    }
    real = None
    if MEASURED.is_file():
        (log,) = read_logs([MEASURED], arm.n, limits=arm.limits)
        real = judge(log, arm, link_side=True)
    else:
        print(f"real Panda skipped: no {MEASURED}")
    draw(results, real, arm)
    text = page(results, real, arm)
    write_text_atomic(HERE / "lsm_failure.md", text)
    print(text)


if __name__ == "__main__":
    main()
