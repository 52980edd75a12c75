"""Base torques of an experiment, computed once: units of the rewards."""

from collections.abc import Iterable

from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job
from stiction_envs.precomputed import store

KIND = "base_torques"


def fingerprint(experiment: SingleJointExperiment) -> str:
    """Return a hash of everything that an undithered result without scatter depends on."""
    s = experiment.sticking
    return store.digest(
        *(s.arm.fingerprint, s.parameters, s.timestep),
        *(experiment.protocol, experiment.interface, experiment.poses),
        *(experiment.servos, experiment.sensing),
    )


def base_torques(
    experiment: SingleJointExperiment, wanted: Iterable[Configuration]
) -> dict[Configuration, float]:
    """Return the base torque τ_base [N·m] of each configuration.

    τ_base is what an episode of the environment gives without dither and without scatter: the
    first ramp after the arm was put into its pose. (The thesis's mean over repeats, `stiction
    sje`, also holds the later ramps, which start from a joint that has slid before.) What is not
    in the store is computed in one batch; a result does not depend on the batch. Raise a
    StictionError for a joint that does not break away without dither.
    """
    names = {c: f"{c.joint} {c.load} {c.direction}" for c in wanted}
    key = fingerprint(experiment)
    known = store.recall(KIND, key)
    missing = [Job(c) for c, name in names.items() if name not in known]
    still = experiment.replace(scatter=False)
    found = {}
    for m in still.run(missing, iterations=1):
        c = m.job.configuration
        if not abs(m.mean) > 0:  # NaN too
            raise StictionError(
                f"{experiment.sticking.arm.name}: joint {c.joint}, {c.load}, {c.direction} does "
                f"not break away without dither (base torque {m.mean} N·m)"
            )
        found[names[c]] = m.mean
    if found:
        store.keep(KIND, key, found)
    known = store.recall(KIND, key)
    return {c: known[name] for c, name in names.items()}
