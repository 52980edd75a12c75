"""Nested models that nobody fitted: made-up predictions, for tests of what reads them."""

from __future__ import annotations

from typing import Any

import numpy as np

from stiction_envs.gap.tables.cells import Cell, cells
from stiction_envs.measured import thesis_dithered
from stiction_envs.thesis.nested_models import PHYSICAL, NestedModel, band, lookup, nothing
from stiction_envs.thesis.nyquist_phase import PhaseStudy

PARAMETERS = {
    "rotor_inertia": (0.24, 0.45, 0.31, 0.33, 0.12, 0.15, 0.09),
    "bristle_stiffness": (1100.0, 1500.0, 1200.0, 1300.0, 1250.0, 800.0, 1400.0),
    "coulomb_ratio": (0.81, 0.77, 0.86, 0.83, 0.84, 0.85, 0.90),
    "stribeck_velocity": (0.002, 0.0015, 0.006, 0.002, 0.003, 0.003, 0.005),
    "joint_stiffness": (13e3, 25e3, 6e3, 14e3),
}
"""By joint, near what physics.md 5.1 has."""
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


def made_up(chosen: list[Cell] | None = None) -> dict[str, NestedModel]:
    """Return all models: each predicts more of the measured change, to its noise."""
    chosen = cells() if chosen is None else chosen
    measured = np.array([c.change for c in chosen])
    noise = 0.01 * np.random.default_rng(0).normal(size=len(chosen))
    models = [
        NestedModel(key=k, name=n, statement=f"{n}.", change=f(chosen).tolist())
        for k, n, f in (
            ("nothing", "dither does nothing", nothing),
            ("lookup", "Table 4.6 looked up", lookup),
            ("band", "stiction as a band", band),
        )
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
        robot="iiwa7",
        rows=rows,
        phase=np.linspace(0, np.pi / 2, 4),
        change=change,
        controller_rate_hz=200.0,
    )
