"""Excitation trajectories for dynamics identification: optimised Fourier series inside all limits.

    from stiction_envs.identification.excitation import excite

    motion = excite("panda", seed=0, sweeps=True)
    print(motion)
    motion.save("runs/excite-panda")

The series rests at the start of every period (J. Swevers et al., 1997), stays inside position,
speed, acceleration and torque limits and clear of the floor and itself, and has a small condition
number of the regressor of the base parameters and of friction. Slow sweeps there and back may
follow: a fast series alone hardly excites dry friction.
"""

import dataclasses
import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import ExperimentError, checked_array
from stiction_envs.friction.sticking import Robot, arm_of
from stiction_envs.identification.excitation_limits import acceleration_limits
from stiction_envs.identification.excitation_motion import FourierSeries, State, Sweeps, sweeps_from
from stiction_envs.identification.excitation_search import FINE, ExcitationProblem, search
from stiction_envs.identification.settings import ExcitationSettings, excitation_settings
from stiction_envs.method_settings import Changes, override
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.json_text import write_json
from stiction_envs.reporting.provenance import Provenance, provenance
from stiction_envs.reporting.result import Result
from stiction_envs.robots import Arm
from stiction_envs.robots.stated import WITHOUT_FRICTION

__all__ = ["Excitation", "ExcitationSettings", "excite"]

DRAWN_HZ = 50.0  # samples per second of the drawn lines [Hz]; assumed
SWEEP_TRIES = 20
"""Signs of the sweeps' first directions to try until all keep the limits; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Excitation(Result):
    """A motion to run on a robot; at rest before its start and after its end."""

    arm: Arm
    series: FourierSeries
    periods: int
    sweeps: Sweeps | None
    """After the series, or None."""
    condition: float
    """Condition number κ of the scaled regressor along one period."""
    condition_si: float
    random_condition: Array
    """(R,) κ of random motions inside the same limits."""
    columns: tuple[str, ...]
    """Base parameters, friction among them, that the regressor is of; sums in words."""
    used: dict[str, float]
    """Largest part of each limit that is used, margins taken off [-]."""
    clearance: float
    """Least distance to the floor and between links [m], 0.5 at most."""
    notes: tuple[str, ...]
    rate_hz: float
    """Rate of the samples of ``trajectory.csv`` [Hz]."""
    provenance: Provenance

    @property
    def duration(self) -> float:
        """From rest to rest [s]."""
        seconds = self.periods / self.series.base_frequency
        return seconds + (self.sweeps.duration if self.sweeps is not None else 0.0)

    def state(self, t: Array) -> State:
        """Return angles [rad], speeds [rad/s], accelerations [rad/s²], (T, n) at times (T,) [s]."""
        moving = np.clip(t, 0.0, self.duration)
        fourier = self.periods / self.series.base_frequency
        out = self.series.state(np.minimum(moving, fourier))
        later = moving > fourier
        if self.sweeps is not None and later.any():
            for whole, part in zip(out, self.sweeps.state(moving[later] - fourier), strict=True):
                whole[later] = part
        resting = (t < 0) | (t > self.duration)
        out[1][resting], out[2][resting] = 0.0, 0.0
        return out

    def times(self, rate_hz: float) -> Array:
        """Return (T,) times of samples from start to end [s]; the rate must be positive."""
        checked_array(rate_hz, "rate", (), above=0, unit="Hz")
        return np.asarray(np.arange(int(np.floor(self.duration * rate_hz + 1e-9)) + 1) / rate_hz)

    def to_csv(self, path: str | os.PathLike[str], rate_hz: float = 1000.0) -> None:
        """Write ``t,q1..qn,dq1..dqn`` [s, rad, rad/s]."""
        t = self.times(rate_hz)
        q, dq, _ = self.state(t)
        joints = range(1, self.arm.n + 1)
        names = ["t", *(f"q{j}" for j in joints), *(f"dq{j}" for j in joints)]
        lines = [",".join(names)]
        lines += [",".join(f"{v:.9g}" for v in row) for row in np.column_stack([t, q, dq])]
        write_text_atomic(Path(path), "\n".join(lines) + "\n")

    def to_json(self) -> dict[str, object]:
        """Return JSON values."""
        return {
            "robot": self.arm.name,
            "duration_s": self.duration,
            "condition": self.condition,
            "condition_si": self.condition_si,
            "random_condition": {
                "median": float(np.median(self.random_condition)),
                "least": float(self.random_condition.min()),
                "motions": len(self.random_condition),
            },
            "used": self.used,
            "clearance_m": self.clearance,
            "base_frequency_hz": self.series.base_frequency,
            "offset_rad": self.series.offset.tolist(),
            "sine_rad_s": self.series.sine.tolist(),
            "cosine_rad_s": self.series.cosine.tolist(),
            "parameters": list(self.columns),
            "notes": list(self.notes),
        }

    def plot(self, path: str | os.PathLike[str]) -> None:
        """Draw angles and speeds in their ranges, and the condition number, as a PNG."""
        from stiction_envs.identification.plots import plot_excitation

        t = self.times(DRAWN_HZ)
        q, dq, _ = self.state(t)
        plot_excitation(
            t, q, dq, path, arm=self.arm, condition=self.condition, random=self.random_condition
        )

    def write(self, folder: Path) -> None:
        """Write ``trajectory.csv``, ``excitation.json`` and a plot."""
        self.to_csv(folder / "trajectory.csv", self.rate_hz)
        write_json(folder / "excitation.json", self.to_json())
        self.plot(folder / "excitation.png")

    def __repr__(self) -> str:
        name, seconds = self.arm.name, self.duration
        return f"<Excitation of {name}: {seconds:.4g} s, condition {self.condition:.3g}>"

    def __str__(self) -> str:
        random = self.random_condition
        used = ", ".join(f"{k} {100 * v:.0f} %" for k, v in self.used.items())
        return "\n".join(
            [
                f"{self.duration:.4g} s, from rest to rest",
                f"condition number {self.condition:.3g} (random motions inside the same limits: "
                f"{np.median(random):.3g} in the median, {random.min():.3g} at best)",
                f"of what the margins leave of each limit: {used}",
                f"clearance {self.clearance:.3g} m",
                *self.notes,
            ]
        )


def excite(
    robot: Robot,
    settings: ExcitationSettings | Changes | None = None,
    *,
    sweeps: bool = False,
    rate_hz: float | None = None,
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
) -> Excitation:
    """Search for a motion that excites an arm's dynamics well.

    Args:
        robot: name, model file or arm.
        settings: settings of the motion: changes to ``settings.toml`` by name
            (``{"harmonics": 3}``), a TOML file of changes, or all settings.
        sweeps: whether slow sweeps with reversals for friction follow the series.
        rate_hz: samples per second of ``trajectory.csv`` [Hz]; None for the controller's rate.
        seed: seed of all random numbers; the same seed gives the same motion.
        progress: called with a stage and its part done.

    Raises:
        StictionError: the arm cannot be loaded.
        ExperimentError: no motion keeps the limits.
    """
    say = progress or (lambda *_: None)
    arm = arm_of(robot)
    rate = float(arm.controller_rate_hz) if rate_hz is None else rate_hz
    checked_array(rate, "rate", (), above=0, unit="Hz")
    s = override(excitation_settings(), settings)
    rng = np.random.default_rng(seed)
    problem = ExcitationProblem(arm, s)
    points, conditions = [], []
    for k in range(max(s.randoms, s.starts)):
        points.append(problem.random(rng))
        state = problem.series(points[-1]).state(problem.fine)
        conditions.append(problem.condition(state))
        say("random motions", (k + 1) / max(s.randoms, s.starts))
    order = np.argsort(conditions)
    best, done = (points[order[0]], conditions[order[0]]), count(1)
    for start in order[: s.starts]:
        found = search(
            problem,
            points[start],
            lambda: say("search", min(1.0, next(done) / (s.starts * s.iterations))),
        )
        if found is not None and found[1] < best[1]:
            best = found
    say("search", 1.0)
    series = problem.series(best[0])
    fine = check = series.state(problem.fine)
    slow = None
    if sweeps:
        slow, after = _sweeps(problem, series.state(np.zeros(1))[0][0])
        q, dq, ddq = (np.vstack(pair) for pair in zip(fine, after, strict=True))
        check = q, dq, ddq
    notes = [*arm.notes(WITHOUT_FRICTION), *problem.clearance.notes]
    if not problem.clearance.own_geometry:
        notes.append("the model has no collision geometry: only the flange was kept clear")
    if not acceleration_limits(arm, s.acceleration_free)[1]:
        notes.append(f"no acceleration limits are known: {s.acceleration_free:g} rad/s² assumed")
    made = {
        "robot": arm.name,
        "arm_sha256": hashlib.sha256(arm.xml.encode()).hexdigest(),
        "settings": dataclasses.asdict(s),
        "sweeps": sweeps,
        "rate_hz": rate,
    }
    return Excitation(
        arm=arm,
        series=series,
        periods=s.periods,
        sweeps=slow,
        condition=problem.condition(fine),
        condition_si=problem.condition(fine, scaled=False),
        random_condition=np.array(conditions),
        columns=problem.base.expressions(),
        used=problem.used(check),
        clearance=float(problem.clearance.least(check[0], max(0.5, 2 * s.clearance)).min()),
        notes=tuple(notes),
        rate_hz=rate,
        provenance=provenance("excite", made, seed=seed),
    )


def _sweeps(problem: ExcitationProblem, start: Array) -> tuple[Sweeps, State]:
    """Return sweeps inside all limits, and their states; first directions turn and spans shrink."""
    rng, b = np.random.default_rng(0), problem.bounds
    for trial in range(SWEEP_TRIES):
        side = None if trial == 0 else rng.choice([-1.0, 1.0], len(start))
        part = 1.0 if trial < SWEEP_TRIES // 2 else 0.5
        slow = sweeps_from(start, b.low, b.high, side=side, part=part)
        state = slow.state(np.arange(0.0, slow.duration, problem.settings.period / FINE))
        if problem.inside(state):
            return slow, state
    raise ExperimentError(
        f"{problem.arm.name}: no sweeps keep the limits where the series begins: choose another "
        "seed, or leave them out"
    )
