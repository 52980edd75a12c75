"""Table 4.11 under many set-ups that the thesis does not rule out: the ensemble.

    members = run_ensemble(folder / "ensemble.jsonl")
    found = scores(members, measured_sums())

Each set-up (`ensemble_prior`) runs the cases of the table, the two halves in two sessions
(`NO_DITHER`, `DITHER`), without dither in the second session too (`NO_DITHER_LATER`), and without
dither and next to no friction (`FREE`): what dither does, what another session does, and what is
the controller's own lag can then be told apart.
"""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.control.settings import DAMPING_DESIGNS, ImpedanceSettings
from stiction_envs.control.trajectory import MotionLimits
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import window_sums
from stiction_envs.experiments.gte.protocol import FLAGS, Case, Run
from stiction_envs.friction.parameters import FrictionParameters, scaled
from stiction_envs.friction.sticking import friction_of
from stiction_envs.method_settings import fingerprint
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.robots import load_arm
from stiction_envs.thesis.ensemble_prior import SetUp, draw
from stiction_envs.thesis.ensemble_settings import EnsembleSettings, ensemble_settings
from stiction_envs.thesis.gte import ROBOT, thesis_cases
from stiction_envs.version import __version__

Array = NDArray[np.float64]
NO_DITHER, DITHER, NO_DITHER_LATER, FREE = range(4)
"""First axis of `Member.sums`. Dither is compared with no dither in the same session by `DITHER`
and `NO_DITHER_LATER`, as Table 4.11 may have been recorded by `DITHER` and `NO_DITHER`."""
PLACES = 4
"""Path and stiffness, in the order of Table 4.11."""
DRY = ("stiction", "load_coefficient")
"""What makes up dry friction."""
Told = Callable[[int, int], None]
"""Called with set-ups done and all of them."""


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

    def to_json(self) -> dict[str, Any]:
        """Return JSON values; floats read back bit for bit."""
        return {
            "number": self.number,
            "set_up": dataclasses.asdict(self.set_up),
            "refused": self.refused,
            "sums": self.sums.tolist(),
            "flags": self.flags,
        }

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Member:
        """Return what `to_json` wrote."""
        values = data["set_up"].items()
        drawn: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values}
        return cls(
            number=data["number"],
            set_up=SetUp(**drawn),
            refused=data["refused"],
            sums=np.array(data["sums"]),
            flags=data["flags"],
        )


# ---- one set-up ----------------------------------------------------------------------------------


def experiment_of(
    set_up: SetUp, settings: EnsembleSettings | None = None, *, scatter: bool = True
) -> GeneratedTrajectoryExperiment:
    """Return the experiment of a set-up, its friction that of the session without dither."""
    s = ensemble_settings() if settings is None else settings
    hand = (s.offsets.hand_mass, *s.offsets.hand_centre)
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
        nthread=1,
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
    number: int,
    *,
    seed: int = 0,
    settings: EnsembleSettings | None = None,
    scatter: bool = True,
) -> Member:
    """Draw set-up ``number`` and run all its cases at once.

    Raises:
        StictionError: no feasible draw, or an arm that never accepts its last goal.
    """
    s = ensemble_settings() if settings is None else settings
    drawn = draw(number, seed=seed, settings=s)
    bench = experiment_of(drawn.set_up, s, scatter=scatter)
    cases = thesis_cases()
    plain, shaken = cases[::2], cases[1::2]
    first, second = (
        session_friction(drawn.set_up, level)
        for level in (drawn.set_up.no_dither, drawn.set_up.dither)
    )
    free = without_friction(first, s.run.free)
    # in the order of the constants above
    chosen = [*plain, *shaken, *plain, *_held(plain, s)]
    friction = [p for p in (first, second, second, free) for _ in range(PLACES)]
    runs = bench.run(chosen, parameters=friction, iterations=s.run.iterations)
    sums = np.array([window_sums(run) for run in runs])
    if not np.isfinite(sums).all():
        raise StictionError(f"set-up {number}: an arm never accepted its last goal")
    return Member(
        number=number,
        set_up=drawn.set_up,
        refused=drawn.refused,
        sums=sums.reshape(FREE + 1, PLACES, s.run.iterations, -1),
        flags=_flags(runs[: FREE * PLACES]),
    )


def _held(cases: Sequence[Case], s: EnsembleSettings) -> list[Case]:
    """Return cases whose arms keep their posture without friction; their tool does not feel it."""
    return [dataclasses.replace(c, stiffness=(*c.stiffness[:2], s.run.posture)) for c in cases]


def shipped_lag(
    settings: EnsembleSettings | None = None,
    *,
    scatter: bool = True,
    seed: int = 0,
    nthread: int = 0,
) -> dict[str, float]:
    """Return by damping law the share of the shipped set-up's error that no friction leaves.

    Median over the 24 cells without dither.
    """
    s = ensemble_settings() if settings is None else settings
    arm = load_arm(ROBOT)
    out = {}
    for law in DAMPING_DESIGNS:
        control = ImpedanceSettings(rate_hz=float(arm.controller_rate_hz), damping_design=law)
        bench = GeneratedTrajectoryExperiment(
            arm, settings=control, scatter=scatter, seed=seed, nthread=nthread
        )
        p, plain = bench.sticking.parameters, thesis_cases()[::2]
        friction = [q for q in (p, without_friction(p, s.run.free)) for _ in range(PLACES)]
        runs = bench.run(
            [*plain, *_held(plain, s)], parameters=friction, iterations=s.run.iterations
        )
        sums = np.array([window_sums(run).mean(axis=0) for run in runs])
        out[law] = float(np.median(sums[PLACES:] / sums[:PLACES]))
    return out


def _flags(runs: Sequence[Run]) -> dict[str, int]:
    return {name: int(sum(run.flags[name].sum() for run in runs)) for name in FLAGS}


# ---- all of them ---------------------------------------------------------------------------------


def run_ensemble(
    path: Path,
    *,
    seed: int = 0,
    settings: EnsembleSettings | None = None,
    scatter: bool = True,
    nthread: int = 0,
    progress: Told | None = None,
) -> list[Member]:
    """Run all set-ups, or go on with those that a file lacks; the same bits either way.

    Args:
        path: JSON lines, one per set-up; always whole.
        seed: of the draws.
        settings: None for the defaults.
        scatter: whether iterations differ.
        nthread: set-ups run side by side, 0 for all processors.
        progress: see `Told`.

    Raises:
        StictionError: the file is of other settings, another seed or version.
    """
    s = ensemble_settings() if settings is None else settings
    head = {
        "settings": fingerprint(s),
        "seed": seed,
        "scatter": scatter,
        "version": __version__,
    }
    done = dict(_read(path, head))
    count = s.run.set_ups
    wanted = [k for k in range(count) if k not in done]
    tell = progress if progress is not None else lambda *_: None
    tell(count - len(wanted), count)
    if wanted:
        with ThreadPoolExecutor(min(nthread or os.cpu_count() or 1, len(wanted))) as pool:
            running = [
                pool.submit(run_set_up, k, seed=seed, settings=s, scatter=scatter) for k in wanted
            ]
            try:
                for future in as_completed(running):
                    member = future.result()
                    done[member.number] = member
                    _write(path, head, done)
                    tell(len(done), count)
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    return [done[k] for k in range(count)]


def _read(path: Path, head: dict[str, Any]) -> Iterator[tuple[int, Member]]:
    if not path.exists():
        return
    first, *lines = path.read_text(encoding="utf-8").splitlines()
    if json.loads(first) != head:
        raise StictionError(
            f"{path}: an ensemble of other settings, seed or version: choose another folder"
        )
    for line in lines:
        member = Member.from_json(json.loads(line))
        yield member.number, member


def _write(path: Path, head: dict[str, Any], done: dict[int, Member]) -> None:
    lines = [head, *(done[k].to_json() for k in sorted(done))]
    write_text_atomic(path, "".join(json.dumps(x, allow_nan=False) + "\n" for x in lines))
