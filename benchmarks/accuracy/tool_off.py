"""The edit test: a tool is taken out of a model that was found with it on.

    python -m benchmarks.accuracy.tool_off [FIRST] [LAST]

A simulated Panda, its links all 3 % off, is diagnosed with a tool on. The ``[[cause]]`` of the
payload is then deleted from ``model.toml`` by hand, and the model predicts logs of another motion
without the tool. Beside it stands the held-out error of a model that was made from these logs; both
with the sensors' noise, which the filter takes off, and without.

A tool and the last links look alike: with the links' exact prior, which no diagnosis knows, the
best possible estimate from a log with the tool on leaves 0.09 N·m in the root mean square of these
cases, twice the sensors' noise in all. An earlier diagnosis without the tool (``--nominal``) tells
them apart.
"""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs import diagnose
from stiction_envs.gap.model_file import nominal_of
from stiction_envs.gap.report.results import LogDiagnosis
from stiction_envs.gap.signals.dataset import assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.hidden.hidden_logs import TAU_NOISE, HiddenLogs, make_case
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm

AIM = 1.2
"""Largest error of the edited model over that of one made without the tool [-]."""
SCATTER = 0.03
"""How far every link is off [-]."""


def without(text: str, cause: str) -> str:
    """Return a ``model.toml`` without the tables of a cause."""
    tables = re.split(r"^(?=\[)", text, flags=re.MULTILINE)
    mine = f'name = "{cause}"\n'
    return "".join(x for x in tables if not (x.startswith("[[cause]]") and mine in x))


def error(arm: Arm, model: Path, logs: list[JointLog], cutoff: float) -> NDArray[np.float64]:
    """Return (n,) error of a model file on logs, filtered as in its diagnosis [N·m]."""
    arm, nominal = nominal_of(arm, model)
    data = nominal.extend(assemble(arm, prepare(logs, cutoff_hz=cutoff), friction=nominal.friction))
    return np.asarray(np.sqrt(np.mean(np.square(data.residual[data.block >= 0]), axis=0)))


def edited(case: HiddenLogs, folder: Path) -> tuple[str, NDArray[np.float64], NDArray[np.float64]]:
    """Return the tool's found mass, and errors (n,) of the edited and of the tool-free model."""
    found, free = (
        diagnose(logs, case.robot, nominal=case.nominal) for logs in (case.logs, case.unhidden)
    )
    assert isinstance(found, LogDiagnosis)
    assert isinstance(free, LogDiagnosis)
    found.save(folder)
    path = folder / "edited.toml"
    path.write_text(without((folder / "model.toml").read_text("utf-8"), "payload"), "utf-8")
    mass = "not named"
    for cause in found.causes:
        if cause.name == "payload":
            (own,) = cause.parameters.values()
            x = own["mass_kg"]
            mass = f"{x.value:.3f} [{x.ci95[0]:.3f}, {x.ci95[1]:.3f}]"
    cutoff = float(found.diagnosis.data.recording.cutoff)
    return mass, error(case.robot, path, case.unhidden, cutoff), free.diagnosis.extended_rms


def main(first: int = 0, last: int = 20) -> None:
    """Print a row per case."""
    ratios = []
    for seed in range(first, last):
        case = make_case(4200 + seed, ("payload",), seconds=20.0, second=20.0, scatter=SCATTER)
        with tempfile.TemporaryDirectory() as folder:
            mass, tool, free = edited(case, Path(folder))
        noisy = [float(np.hypot(x, TAU_NOISE).mean()) for x in (tool, free)]
        ratios.append(noisy[0] / noisy[1])
        true = case.hidden[0].values["mass_kg"]
        print(f"{seed:3d} {case.motion:10s} true {true:.3f} kg, found {mass}; ", end="")
        plain = tool.mean() / free.mean()
        print(f"{tool.mean():.4f} over {free.mean():.4f} N·m = {plain:.2f}; ", end="")
        print(f"with noise {ratios[-1]:.2f}", flush=True)
    within = np.count_nonzero(np.array(ratios) <= AIM)
    print(f"{within} of {len(ratios)} within {AIM:g}, median {np.median(ratios):.2f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
