"""The ensemble: Table 4.11 under every set-up that was drawn.

    members = run_ensemble(folder / "ensemble.jsonl")
    found = stack(members)

Each set-up runs the cases of the table, the two halves in two sessions (`NO_DITHER`, `DITHER`),
without dither in the second session too (`NO_DITHER_LATER`), and without dither and next to no
friction (`FREE`): what dither does, what another session does, and what is the controller's own lag
can then be told apart.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness import Rows
from benchmarks.thesis.ensemble.set_ups import ROBOT, Prior, SetUp, draw, prior
from stiction_envs.control.settings import DAMPING_DESIGNS, ImpedanceSettings
from stiction_envs.control.trajectory import MotionLimits
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import window_sums
from stiction_envs.experiments.gte.protocol import FLAGS, TRAJECTORIES, Case
from stiction_envs.experiments.gte.rows import (
    thesis_final_dither,
    thesis_stiffness,
    thesis_window_sums,
)
from stiction_envs.friction.parameters import FrictionParameters, scaled
from stiction_envs.friction.sticking import friction_of
from stiction_envs.robots import load_arm
from stiction_envs.version import __version__

Array = NDArray[np.float64]
NO_DITHER, DITHER, NO_DITHER_LATER, FREE = range(4)
"""First axis of `Member.sums`. Dither is compared with no dither in the same session by `DITHER`
and `NO_DITHER_LATER`, as Table 4.11 may have been recorded by `DITHER` and `NO_DITHER`."""
PLACES = 4
"""Path and stiffness, in the order of Table 4.11."""
DRY = ("stiction", "load_coefficient")
"""What makes up dry friction."""


def thesis_cases() -> list[Case]:
    """Return the eight cases: each path and stiffness without dither, then with it."""
    dither = thesis_final_dither()
    return [
        Case(trajectory=t, stiffness=k, dither=d)
        for t in TRAJECTORIES
        for k in thesis_stiffness()
        for d in ((), dither)
    ]


def measured_sums() -> tuple[Array, Array]:
    """Return the sums of Table 4.11 (24,) without dither and with it."""
    cases = thesis_cases()
    printed = np.array([list((thesis_window_sums(c) or {}).values()) for c in cases], dtype=float)
    return printed[::2].ravel(), printed[1::2].ravel()


@dataclass(frozen=True, kw_only=True, eq=False)
class Member:
    """What one set-up gives."""

    number: int
    set_up: SetUp
    refused: dict[str, int]
    """Draws refused before it, by reason."""
    sums: Array
    """(4, 4, I, 6) sums of the absolute error of each condition, place and iteration, by axis
    [m·samples, rad·samples]."""
    flags: dict[str, int]
    """Simulations with friction in which the controller raised each flag."""

    @classmethod
    def from_row(cls, number: int, row: dict[str, Any]) -> Member:
        """Return what `to_row` wrote."""
        values = row["set_up"].items()
        drawn: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values}
        return cls(
            number=number,
            set_up=SetUp(**drawn),
            refused=row["refused"],
            sums=np.array(row["sums"]),
            flags=row["flags"],
        )

    def to_row(self) -> dict[str, Any]:
        """Return JSON values; floats read back bit for bit."""
        return {
            "set_up": dataclasses.asdict(self.set_up),
            "refused": self.refused,
            "sums": self.sums.tolist(),
            "flags": self.flags,
        }


# ---- one set-up ----------------------------------------------------------------------------------


def experiment_of(
    set_up: SetUp, ranges: Prior | None = None, *, scatter: bool = True
) -> GeneratedTrajectoryExperiment:
    """Return the experiment of a set-up, its friction that of the session without dither."""
    offsets = (prior() if ranges is None else ranges)["offsets"]
    hand = (offsets["hand_mass"], *offsets["hand_centre"])
    arm = load_arm(ROBOT, payload=None if set_up.hand == "none" else hand, tilt=set_up.tilt)
    known = load_arm(ROBOT, payload=hand if set_up.hand == "known" else None)
    if set_up.angles == "flange":
        arm = dataclasses.replace(arm, hand_yaw=0.0)
    return GeneratedTrajectoryExperiment(
        arm,
        friction=session_friction(set_up, set_up.no_dither),
        settings=ImpedanceSettings(
            rate_hz=float(arm.controller_rate_hz), damping_design=set_up.damping_design
        ),
        motion=MotionLimits(
            translational_speed=set_up.speed,
            translational_acceleration=set_up.acceleration,
            translational_deceleration=set_up.acceleration,
            position_tolerance=set_up.position_tolerance,
            rotation_tolerance=set_up.rotation_tolerance,
            patience=set_up.patience,
        ),
        start=set_up.start,
        tool=(0.0, 0.0, set_up.tool),
        paths=set_up.paths(),
        controller_model=None if known.xml == arm.xml else known,
        scatter=scatter,
        seed=set_up.seed,
        threads=1,
    )


def session_friction(set_up: SetUp, level: tuple[float, ...]) -> FrictionParameters:
    """Return the shipped friction with a session's dry friction, over the shipped one (n,)."""
    return scaled(
        friction_of(load_arm(ROBOT)),
        {
            **dict.fromkeys(DRY, level),
            "viscous": set_up.viscous,
            "offset": set_up.offset,
            "gravity_error": set_up.gravity,
        },
    )


def without_friction(p: FrictionParameters, share: float) -> FrictionParameters:
    """Return parameters with a share of their dry friction; viscous friction and offsets stay."""
    return scaled(p, dict.fromkeys(DRY, share))


def run_set_up(
    number: int, *, seed: int = 0, ranges: Prior | None = None, scatter: bool = True
) -> Member:
    """Draw set-up ``number`` and run all its cases at once.

    Raises:
        StictionError: no feasible draw, or an arm that never accepts its last goal.
    """
    of = prior() if ranges is None else ranges
    drawn = draw(number, seed=seed, ranges=of)
    bench = experiment_of(drawn.set_up, of, scatter=scatter)
    cases, iterations = thesis_cases(), of["run"]["iterations"]
    no_dither, dither = cases[::2], cases[1::2]
    first, second = (
        session_friction(drawn.set_up, level)
        for level in (drawn.set_up.no_dither, drawn.set_up.dither)
    )
    free = without_friction(first, of["run"]["free"])
    # in the order of the constants above
    chosen = [*no_dither, *dither, *no_dither, *_with_posture(no_dither, of)]
    friction = [p for p in (first, second, second, free) for _ in range(PLACES)]
    runs = bench.run(chosen, parameters=friction, iterations=iterations)
    sums = np.array([window_sums(run) for run in runs])
    if not np.isfinite(sums).all():
        raise StictionError(f"set-up {number}: an arm never accepted its last goal")
    flags = {n: int(sum(run.flags[n].sum() for run in runs[: FREE * PLACES])) for n in FLAGS}
    return Member(
        number=number,
        set_up=drawn.set_up,
        refused=drawn.refused,
        sums=sums.reshape(FREE + 1, PLACES, iterations, -1),
        flags=flags,
    )


def _with_posture(cases: Sequence[Case], of: Prior) -> list[Case]:
    """Return cases whose arms keep their posture without friction; their tool does not feel it."""
    posture = of["run"]["posture"]
    return [dataclasses.replace(c, stiffness=(*c.stiffness[:2], posture)) for c in cases]


def shipped_lag(
    ranges: Prior | None = None, *, scatter: bool = True, seed: int = 0, threads: int = 0
) -> dict[str, float]:
    """Return by damping law the share of the shipped set-up's error that no friction leaves.

    Median over the 24 cells without dither.
    """
    of, arm, out = prior() if ranges is None else ranges, load_arm(ROBOT), {}
    for law in DAMPING_DESIGNS:
        control = ImpedanceSettings(rate_hz=float(arm.controller_rate_hz), damping_design=law)
        bench = GeneratedTrajectoryExperiment(
            arm, settings=control, scatter=scatter, seed=seed, threads=threads
        )
        p, cases = bench.sticking.parameters, thesis_cases()[::2]
        friction = [q for q in (p, without_friction(p, of["run"]["free"])) for _ in range(PLACES)]
        both, iterations = [*cases, *_with_posture(cases, of)], of["run"]["iterations"]
        runs = bench.run(both, parameters=friction, iterations=iterations)
        sums = np.array([window_sums(run).mean(axis=0) for run in runs])
        out[law] = float(np.median(sums[PLACES:] / sums[:PLACES]))
    return out


# ---- all of them ---------------------------------------------------------------------------------


def run_ensemble(
    path: Path,
    *,
    seed: int = 0,
    ranges: Prior | None = None,
    scatter: bool = True,
    threads: int = 0,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> list[Member]:
    """Run all set-ups, or those that a file lacks; the same bits either way.

    Args:
        path: JSON lines, one per set-up; those of another prior, seed or version are left alone.
        seed: of the draws.
        ranges: that set-ups are drawn from; None for those of ``ensemble.toml``.
        scatter: whether iterations differ.
        threads: set-ups run side by side, 0 for all processors.
        progress: called with set-ups done and all of them.
    """
    of = prior() if ranges is None else ranges
    made_by = json.dumps([of, seed, scatter, __version__])
    kept = Rows(path, hashlib.sha256(made_by.encode()).hexdigest())
    count = of["run"]["set_ups"]
    missing = [k for k in range(count) if str(k) not in kept]
    progress(count - len(missing), count)
    if missing:
        with ThreadPoolExecutor(min(threads or os.cpu_count() or 1, len(missing))) as pool:
            running = [
                pool.submit(run_set_up, k, seed=seed, ranges=of, scatter=scatter) for k in missing
            ]
            try:
                for done, future in enumerate(as_completed(running), count - len(missing) + 1):
                    member = future.result()
                    kept.add(str(member.number), member.to_row())
                    progress(done, count)
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    return [Member.from_row(k, kept[str(k)]) for k in range(count)]
