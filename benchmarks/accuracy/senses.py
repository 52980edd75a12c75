"""What do real robots' controllers see, and does it change what dither and compensation are worth?

    python -m benchmarks.accuracy.senses [--iterations 4]

Reads ../shared/measured, of which nothing is copied; without it the first part is left out. The
second part runs the paths of the thesis under each arm's ``[sensing]``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy import signal

from benchmarks.harness import EPISODES, MEASURED, Benchmark, Row
from stiction_envs.control.sensing import Sensing, load_sensing
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import measure
from stiction_envs.experiments.gte.protocol import TRAJECTORIES, Case
from stiction_envs.experiments.gte.rows import thesis_final_dither, thesis_stiffness
from stiction_envs.measured.logs.reader import read_logs
from stiction_envs.reporting.markdown import short, table_text
from stiction_envs.reporting.png import save_full
from stiction_envs.robots import BUILTIN, load_arm

Array = NDArray[np.float64]
STUDY = Benchmark(__file__, __doc__, made_by=(*EPISODES, "benchmarks/accuracy/senses.py"))
PANDA = MEASURED / "panda_exciting_trajectory" / "panda_exciting_trajectory.csv.gz"
IIWA = [MEASURED / "iiwa14_joint_friction" / f"joint{j}.csv.gz" for j in (1, 2, 3, 5, 6, 7)]
PICTURE = "senses.png"
ROBUST = 1.4826
"""Standard deviation of a normal number over the median of its size [-]."""
STILL = 5e-6
"""Range of angles within a window in which a joint rests [rad]; assumed: five steps of the log."""
WINDOW = 1.0
"""Length of such a window [s]."""
SMOOTH_HZ, LONGEST = 10.0, 0.1
"""Low-pass before lags are sought [Hz], and the longest lag [s]; assumed."""
SENSES = ("ideal", "robot", "robot, noise × 3", "robot, 5 ms later")
MORE_DELAY = 0.005
"""Of the last, on top of the arm's own [s]."""
TREATMENTS = ("nothing", "Table 4.9", "push")


# ---- what the logs show --------------------------------------------------------------------------


def white_part(x: Array, t: Array) -> Array:
    """Return the standard deviation (n,) of white noise that second differences of (T, n) have."""
    gaps = np.diff(t)
    even = np.flatnonzero(np.abs(gaps[1:] - gaps[:-1]) + np.abs(gaps[1:] - np.median(gaps)) < 1e-6)
    return ROBUST * np.median(np.abs(np.diff(x, 2, axis=0)[even]), axis=0) / np.sqrt(6)


def lag(q: Array, dq: Array, t: Array) -> float:
    """Return by how much a logged speed (T,) lags the derivative of the angle (T,) [s]."""
    dt = float(np.median(np.diff(t)))
    grid = np.arange(t[0], t[-1], dt)
    low = signal.butter(4, SMOOTH_HZ, fs=1 / dt, output="sos")
    slope = signal.sosfiltfilt(low, np.gradient(np.interp(grid, t, q), dt))
    speed = signal.sosfiltfilt(low, np.interp(grid, t, dq))
    inner = slice(round(1 / dt), -round(1 / dt))
    lags = np.arange(0.0, LONGEST, 0.25e-3)
    left = [np.std((np.interp(grid - d, grid, slope) - speed)[inner]) for d in lags]
    return float(lags[np.argmin(left)])


def resolution(x: Array) -> Array:
    """Return the usual step (n,) between neighbouring values of (T, n)."""
    return np.array([np.median(np.diff(np.unique(column))) for column in x.T])


def spectrum(x: Array, dt: float) -> tuple[Array, Array]:
    """Return frequencies [Hz] and amplitude density [1/√Hz] of (T,), robust against events."""
    f, p = signal.welch(x, 1 / dt, nperseg=512, average="median")
    return f[1:], np.sqrt(p[1:])


def panda() -> tuple[dict[str, Array], dict[str, tuple[Array, Array]]]:
    """Return numbers (7,) of the Panda's log, and spectra of joint 4."""
    (log,) = read_logs([PANDA], 7)
    assert log.dq is not None
    found = {
        "lag of dq [ms]": 1e3 * np.array([lag(log.q[:, j], log.dq[:, j], log.t) for j in range(7)]),
        "white part of q [µrad]": 1e6 * white_part(log.q, log.t),
        "white part of dq [mrad/s]": 1e3 * white_part(log.dq, log.t),
        "white part of tau [mN·m]": 1e3 * white_part(log.tau, log.t),
        "step of tau [mN·m]": 1e3 * resolution(log.tau),
    }
    grid = np.arange(log.t[0], log.t[-1], 1e-3)
    shown = {
        "speed": spectrum(np.interp(grid, log.t, log.dq[:, 3]), 1e-3),
        "torque": spectrum(np.interp(grid, log.t, log.tau[:, 3]), 1e-3),
    }
    return found, shown


def iiwa() -> tuple[dict[str, Array], dict[str, tuple[Array, Array]]]:
    """Return numbers (7,) of the iiwa 14's logs, NaN for joint 4's lag, and spectra of joint 4."""
    lags = np.full(7, np.nan)
    rest: dict[str, list[list[float]]] = {name: [[] for _ in range(7)] for name in ("q", "tau")}
    shown: dict[str, tuple[Array, Array]] = {}
    for path in IIWA:
        moving = int(path.name[5]) - 1
        (log,) = read_logs([path], 7)
        assert log.dq is not None
        ends = np.append(np.flatnonzero(np.diff(log.t) > 0.5) + 1, len(log.t))
        first = slice(0, int(ends[0]))  # the slowest run
        lags[moving] = lag(log.q[first, moving], log.dq[first, moving], log.t[first])
        size = round(WINDOW / 0.005)
        for a in range(0, len(log.t) - size, size):
            part = slice(a, a + size)
            still = np.ptp(log.q[part], axis=0) < STILL
            for j in np.flatnonzero(still & (np.arange(7) != moving)):
                rest["q"][j].append(float(np.std(log.q[part, j])))
                rest["tau"][j].append(float(np.std(log.tau[part, j])))
        if moving == 6:
            shown["torque"] = spectrum(log.tau[first, 3], 0.005)
    found = {
        "lag of dq [ms]": 1e3 * lags,
        "q at rest [µrad]": 1e6 * np.array([np.median(x) for x in rest["q"]]),
        "tau at rest [mN·m]": 1e3 * np.array([np.median(x) for x in rest["tau"]]),
    }
    return found, shown


def per_joint(found: Mapping[str, Array]) -> str:
    """Return numbers by joint as a table."""
    rows = [
        [name, *(short(x, 2) if np.isfinite(x) else "" for x in v)] for name, v in found.items()
    ]
    return table_text(["", *(f"joint {j}" for j in range(1, 8))], rows)


def draw(robots: Mapping[str, Mapping[str, tuple[Array, Array]]], path: Path) -> None:
    """Draw the spectra."""
    figure = Figure(figsize=(8.2, 2.9), layout="constrained")
    for axes, (what, unit) in zip(
        figure.subplots(1, 2), (("speed", "rad/s"), ("torque", "N·m")), strict=True
    ):
        for robot, spectra in robots.items():
            if what in spectra:
                axes.loglog(*spectra[what], lw=1, label=robot)
        axes.set_xlabel("frequency [Hz]")
        axes.set_ylabel(f"{what} [{unit}/√Hz]")
        axes.legend(frameon=False)
    save_full(figure, path)


# ---- what it changes -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Job:
    """Both paths at both stiffnesses."""

    robot: str
    senses: str
    treatment: str
    iterations: int


def sensing_of(robot: str, name: str) -> Sensing:
    """Return senses by their name in `SENSES`."""
    own = load_sensing(load_arm(robot), "ideal" if name == "ideal" else "robot")
    if name == "robot, noise × 3":
        noisy = ("angle_noise", "speed_noise", "torque_noise")
        more: dict[str, Any] = {k: tuple(3 * own.of_joint(k, 7)) for k in noisy}
        return replace(own, **more)
    if name == "robot, 5 ms later":
        return replace(own, command_delay=own.command_delay + MORE_DELAY)
    return own


@cache
def experiment(robot: str, senses: str) -> GeneratedTrajectoryExperiment:
    """Return the experiment of an arm."""
    return GeneratedTrajectoryExperiment(robot, sensing=sensing_of(robot, senses), threads=1)


def run(job: Job) -> Row:
    """Return error left [m, rad], vibration moving and at rest [m]: means over all runs."""
    bench = experiment(job.robot, job.senses)
    dither = thesis_final_dither() if job.treatment == "Table 4.9" else ()
    push = bench.compensation("push") if job.treatment == "push" else None
    cases = [
        Case(trajectory=path, stiffness=stiffness, dither=dither, compensation=push)
        for path in TRAJECTORIES
        for stiffness in dict.fromkeys((k[0], k[1], 0.0) for k in thesis_stiffness())
    ]
    found = [
        measure(r, bench.protocol, bench.motion)
        for r in bench.run(cases, iterations=job.iterations)
    ]
    left = np.mean([m.left.mean(axis=(0, 1)) for m in found], axis=0)
    return {
        "position": float(left[0]),
        "orientation": float(left[1]),
        "moving": float(np.mean([m.shaking for m in found])),
        "rest": float(np.mean([m.shaking_at_rest for m in found])),
    }


def cell(row: Row | None) -> str:
    """Return error left and vibration as text."""
    if row is None:
        return ""
    left = f"{1e3 * row['position']:.1f} mm, {1e3 * row['orientation']:.1f} mrad"
    return f"{left}; {1e3 * row['moving']:.3f} / {1e3 * row['rest']:.3f}"


def main() -> None:
    """Measure, run, write the page."""
    parser = STUDY.parser()
    parser.add_argument("--iterations", type=int, default=4)
    options = parser.parse_args()
    jobs = {
        f"{robot} {senses} {treatment} {options.iterations}": Job(
            robot, senses, treatment, options.iterations
        )
        for robot in ("panda", *(r for r in BUILTIN if r != "panda"))
        for treatment in TREATMENTS
        for senses in (SENSES if robot == "panda" else SENSES[:2])
        if treatment != "Table 4.9" or robot == "panda"
    }
    rows = STUDY.rows(options).fill(jobs, run, minutes=options.minutes)
    if len(rows) < len(jobs):
        print(f"{len(jobs) - len(rows)} rows are missing: run it again to go on")
        return
    by = {(j.robot, j.treatment, j.senses): rows[key] for key, j in jobs.items()}
    lines = [
        [robot, treatment, *(cell(by.get((robot, treatment, s))) for s in SENSES)]
        for robot, treatment in dict.fromkeys((r, t) for r, t, _ in by)
    ]
    values: dict[str, Any] = {"measured": PANDA.is_file()}
    if PANDA.is_file():
        options.out.mkdir(parents=True, exist_ok=True)
        (found, spectra), (other, rest) = panda(), iiwa()
        draw({"Panda, moving": spectra, "iiwa 14, at rest": rest}, options.out / PICTURE)
        values |= {"panda": per_joint(found), "iiwa": per_joint(other)}

    def share(treatment: str, senses: str, what: str) -> float:
        """Return what a treatment leaves of a mean error of the Panda under the same senses [%]."""
        treated, plain = by["panda", treatment, senses], by["panda", "nothing", senses]
        return 100 * float(treated[what] / plain[what])

    STUDY.write_page(
        options,
        table=table_text(["arm", "treatment", *SENSES], lines),
        share=share,
        change=max(
            abs(by[r, t, "robot"][k] / by[r, t, "ideal"][k] - 1)
            for r, t, _ in by
            for k in ("position", "orientation")
        ),
        by=by,
        iterations=options.iterations,
        picture=PICTURE,
        **values,
    )


if __name__ == "__main__":
    main()
