"""Base torques of an experiment, computed once per process."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterable
from typing import Any

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job
from stiction_envs.friction.parameters import QUANTITIES

_known: dict[tuple[str, Configuration], float] = {}


def fingerprint(experiment: SingleJointExperiment) -> str:
    """Return a hash of everything that an undithered result without scatter depends on."""
    s, i = experiment.sticking, experiment.interface
    return digest(
        *(s.arm.xml, s.timestep, experiment.protocol, i.controller_rate_hz, i.lowpass_hz),
        *(i.torque_rate, i.torque_limit, s.arm.limits.position, experiment.poses.q),
        *(getattr(s.parameters, k) for k in QUANTITIES),
    )


def digest(*parts: Any) -> str:
    """Return a hash of arrays, by their bits, and of anything else by its `repr`."""
    out = hashlib.sha256()
    for part in parts:
        out.update(part.tobytes() if isinstance(part, np.ndarray) else repr(part).encode())
    return out.hexdigest()


def base_torques(
    experiment: SingleJointExperiment, wanted: Iterable[Configuration]
) -> dict[Configuration, float]:
    """Return the base torque τ_base [N·m] of each configuration.

    τ_base is what an episode of the environment gives without dither and without scatter: the
    first ramp after the arm was put into its pose. (The thesis's mean over repeats, `stiction
    sje`, also holds the later ramps, which start from a joint that has slid before.) What is
    missing is computed in one batch; a result does not depend on the batch.

    Raises:
        StictionError: a joint that does not break away without dither.
    """
    key = fingerprint(experiment)
    wanted = list(wanted)
    missing = [Job(c) for c in dict.fromkeys(wanted) if (key, c) not in _known]
    still = dataclasses.replace(experiment, scatter=False)
    for m in still.run(missing, iterations=1):
        c = m.job.configuration
        if not abs(m.mean) > 0:  # NaN too
            raise StictionError(
                f"{experiment.sticking.arm.name}: joint {c.joint}, {c.load}, {c.direction} does "
                f"not break away without dither (base torque {m.mean} N·m)"
            )
        _known[key, c] = m.mean
    return {c: _known[key, c] for c in wanted}
