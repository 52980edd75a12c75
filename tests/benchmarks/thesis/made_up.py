"""What nobody fitted or simulated: models, measurements, paths and set-ups, for tests."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from benchmarks.thesis.ensemble.runs import Member, measured_sums
from benchmarks.thesis.ensemble.set_ups import REASONS, draw
from benchmarks.thesis.nested_models.cells import cells
from benchmarks.thesis.nested_models.models import PHYSICAL, WITHOUT_PHYSICS, NestedModel
from benchmarks.thesis.nested_models.phase import PhaseStudy
from stiction_envs.experiments.gte.protocol import Run
from stiction_envs.experiments.gte.rows import thesis_window_sums
from stiction_envs.experiments.sje.protocol import Job, Measurement
from stiction_envs.measured import thesis_base, thesis_dithered
from tests.experiments.gte.made_up import made_up as made_up_run

PARAMETERS = {
    "rotor_inertia": (0.24, 0.45, 0.31, 0.33, 0.12, 0.15, 0.09),
    "bristle_stiffness": (1100.0, 1500.0, 1200.0, 1300.0, 1250.0, 800.0, 1400.0),
    "coulomb_ratio": (0.81, 0.77, 0.86, 0.83, 0.84, 0.85, 0.90),
    "stribeck_velocity": (0.002, 0.0015, 0.006, 0.002, 0.003, 0.003, 0.005),
    "joint_stiffness": (13e3, 25e3, 6e3, 14e3),
}
"""By joint, near what sources.md 5.1 has."""
SHARE = {
    "inertia": 0.2,
    "presliding": 0.5,
    "path": 0.5,
    "elasticity": 0.6,
    "load": 0.6,
    "offset": 0.8,
    "drift": 0.9,
}
"""How much of the measured change each model predicts."""


def found(joint: int, names: tuple[str, ...], seeds: int = 3) -> list[dict[str, Any]]:
    """Return what a search might have found: seeds 1 % apart."""
    out = []
    for seed in range(seeds):
        parameters = {
            n: PARAMETERS[n][joint - 1] * (1 + 0.01 * seed)
            for n in names
            if joint <= len(PARAMETERS[n])
        }
        entry = {"joint": joint, "seed": seed, "loss": 10.0 + 0.1 * seed}
        out.append({**entry, "parameters": parameters, "on_bound": []})
    return out


def nested_model(
    key: str, change: np.ndarray, *, name: str = "", seeds: int = 1, **changes: Any
) -> NestedModel:
    """Return a model with physics."""
    names = ("rotor_inertia",) if key == "inertia" else tuple(PARAMETERS)
    values: dict[str, Any] = {
        "key": key,
        "name": name or key,
        "statement": f"made up for {key}",
        "change": change.tolist(),
        "found": {str(j): found(j, names, seeds) for j in range(1, 8)},
        "loss": 100.0,
        **changes,
    }
    return NestedModel(**values)


def made_up() -> dict[str, NestedModel]:
    """Return all models: each predicts more of the measured change, to its noise."""
    chosen = cells()
    measured = np.array([c.change for c in chosen])
    noise = 0.01 * np.random.default_rng(0).normal(size=len(chosen))
    models = [
        NestedModel(key=k, name=n, statement=f"{n}.", change=f(chosen).tolist())
        for k, n, f in WITHOUT_PHYSICS
    ]
    for key, name, _ in PHYSICAL:
        models.append(nested_model(key, SHARE[key] * measured + noise, name=name))
    last = SHARE["drift"] * measured + noise
    for rate, more in ((0.04, [30 / 7] * 7), (0.12, [3.0, -2.0, 1.0, -1.0, 2.0, -3.0, 1.0])):
        fitted = nested_model(
            f"ramp {rate:g}",
            last + 0.01 * rate,
            name=f"ramp at {rate:g} N·m/s",
            loss=100.0 + sum(more),
            fixed={"ramp_rate": rate},
        )
        for j, extra in enumerate(more):
            fitted.found[str(j + 1)][0]["loss"] += extra
        models.append(fitted)
    models.append(nested_model("elasto-plastic", last - 0.03, name="elasto-plastic", loss=120.0))
    fixed = {"ramp_rate": 0.07}
    for key, value in (("arm", SHARE["offset"]), ("arm + drift", 0.95)):
        models.append(nested_model(key, value * measured + noise, seeds=3, fixed=fixed))
    return {r.key: r for r in models}


def phase_study(highest: float = 0.0) -> PhaseStudy:
    """Return a study in which the largest phase takes 5 % and the smallest gives ``highest``."""
    rows = tuple(thesis_dithered("iiwa7"))
    change = np.tile(np.linspace(highest, -0.05, 4), (len(rows), 1))
    return PhaseStudy(
        rows=rows,
        phase=np.linspace(0, np.pi / 2, 4),
        change=change,
        controller_rate_hz=200.0,
    )


def measurement(job: Job, tau: float, iterations: int = 3) -> Measurement:
    return Measurement(
        job=job,
        tau=np.full(iterations, tau),
        start=np.zeros(iterations),
        start_torque=np.zeros(iterations),
        shaken_speed=np.zeros(1),
        deviation=0.0,
        traces=tuple(np.linspace(0, 0.15, 5, dtype=np.float32) for _ in range(iterations)),
        trace_dt=0.01,
    )


def run_torques(self, jobs, *, iterations=None, progress=None, simulations=0):
    """Pretend to simulate: base torques as printed, dither takes a tenth of its amplitude."""
    for job in jobs:
        c = job.configuration
        base = thesis_base(self.sticking.arm.name).get(c.joint, c.load, c.direction)
        if progress is not None:
            progress(1.0)
        yield measurement(job, base - 0.1 * c.sign * job.amplitude_nm, iterations or 1)


def run_paths(self, cases, *, iterations=None, progress=None) -> list[Run]:
    """Pretend to run: constant errors whose sums over 200 samples are the printed ones."""
    runs = []
    for case in cases:
        size = np.array(list(thesis_window_sums(case).values())) / 200
        error = np.tile(size, (iterations or 10, 700, 1))
        run = made_up_run(error, iterations=iterations or 10, trajectory=case.trajectory)
        runs.append(dataclasses.replace(run, case=case))
    return runs


SET_UP = draw(0).set_up
"""The set-up of all members."""


def run_set_up(number, *, seed=0, ranges=None, scatter=True) -> Member:
    """Pretend to run a set-up: sums about the printed ones, with a factor of its own."""
    rng = np.random.default_rng([seed, number])
    before, after = (x.reshape(4, 6) for x in measured_sums())
    lift = np.exp(0.3 * rng.normal(size=(4, 6)))
    shifts = np.exp(0.05 * rng.normal(size=(4, 2, 4, 6)))
    levels = np.array([before, after, 1.02 * before, 0.5 * before]) * lift
    return Member(
        number=number,
        set_up=SET_UP,
        refused=dict.fromkeys(REASONS, 1),
        sums=np.moveaxis(levels[:, None] * shifts, 1, 2),
        flags={"singular": 0, "saturated": 3, "near_limit": int(number == 1)},
    )
