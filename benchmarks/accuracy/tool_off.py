"""The edit test: a tool is taken out of a model that was found with it on.

    python -m benchmarks.accuracy.tool_off [FIRST] [LAST]

A simulated Panda, its links all 3 % off, is diagnosed with a tool on. The payload is then taken out
of the model, and the rest predicts logs of another motion without the tool. Beside it stands the
held-out error of a model that was made from these logs; both with the sensors' noise, which the
filter takes off, and without.

A tool and the last links look alike: with the links' exact prior, which no diagnosis knows, the
best possible estimate from a log with the tool on leaves 0.09 N·m in the root mean square of these
cases, twice the sensors' noise in all. An earlier diagnosis without the tool (``--nominal``) tells
them apart.
"""

import sys
from dataclasses import replace

import numpy as np

from stiction_envs.arrays import rms
from stiction_envs.gap.diagnosis import diagnose_logs, model_of
from stiction_envs.gap.signals.dataset import assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.hidden.hidden_logs import TAU_NOISE, make_case

AIM = 1.2
"""Largest error of the edited model over that of one made without the tool [-]."""
SCATTER = 0.03
"""How far every link is off [-]."""


def main(first: int = 0, last: int = 20) -> None:
    """Print a row per case, and how many are within the aim."""
    ratios = []
    for seed in range(first, last):
        case = make_case(4200 + seed, ("payload",), seconds=20.0, second=20.0, scatter=SCATTER)
        arm, logs = case.robot, case.unhidden
        found, free = (diagnose_logs(x, arm, nominal=case.nominal) for x in (case.logs, logs))
        model = model_of(found)
        edited = replace(model, parts=tuple(p for p in model.parts if p.cause != "payload"))
        signals = prepare(logs, cutoff_hz=found.data.recording.cutoff)
        data = edited.extend(assemble(arm, signals, friction=edited.friction))
        tool, made = rms(data.residual[data.block >= 0]), free.extended_rms
        ratios.append(float(np.hypot(tool, TAU_NOISE).mean() / np.hypot(made, TAU_NOISE).mean()))
        payloads = [c.parameters for c in found.causes if c.name == "payload"]
        masses = [x["mass_kg"] for each in payloads for x in each.values()]
        named = [f"{np.round(x.value, 3)} {np.round(x.ci95, 3)}" for x in masses] or ["none"]
        true = case.hidden[0].values["mass_kg"]
        print(f"{seed:3d} {case.motion:10s} true {true:.3f} kg, found {named[0]}; ", end="")
        print(f"{tool.mean():.4f} over {made.mean():.4f} N·m; with noise {ratios[-1]:.2f}")
    within = np.count_nonzero(np.array(ratios) <= AIM)
    print(f"{within} of {len(ratios)} within {AIM:g}, median {np.median(ratios):.2f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
