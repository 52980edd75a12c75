"""Draw the README's picture: `python docs/make_pictures.py`."""

from pathlib import Path

from stiction_envs.experiments.sje import plots
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job

experiment = SingleJointExperiment("panda", scatter=False)
where = Configuration(7, "load", "+")
measured = {
    m.job.amplitude_nm: m
    for m in experiment.run([Job(where), Job(where, 15.0, 0.8041)], iterations=1)
}
plots.plot_with_and_without(
    measured[0.0],
    measured[0.8041],
    Path(__file__).parent / "sje.png",
    robot="panda",
    threshold=experiment.protocol.threshold,
    ramp_rate=experiment.protocol.ramp_rate,
)
