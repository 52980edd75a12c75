"""What the plots of the Single Joint Experiment draw."""

import numpy as np
import pytest

from stiction_envs.experiments.sje import plots
from stiction_envs.experiments.sje.protocol import Configuration, Job, Measurement, load_protocol
from stiction_envs.experiments.sje.rig import BLOCK
from stiction_envs.plant import CONTROL_DT

RATE, STEP = 0.1, BLOCK * CONTROL_DT
PROTOCOL = load_protocol("panda").replace(ramp_rate=RATE)


def measurement(
    direction: str = "+",
    *,
    lengths: tuple[int, ...] = (40, 50),
    start_torque: float = 0.0,
    frequency: float = 0.0,
    amplitude: float = 0.0,
    stuck: bool = False,
) -> Measurement:
    """A made-up measurement: a joint that stands, then runs off."""
    c = Configuration(7, "load", direction)
    traces = tuple(
        (0.01 * k + c.sign * 0.15 * np.linspace(0, 1, n) ** 8).astype(np.float32)
        for k, n in enumerate(lengths)
    )
    tau = np.array([start_torque + c.sign * RATE * STEP * (n - 1) for n in lengths])
    if stuck:
        tau[-1] = np.nan
    return Measurement(
        job=Job(c, frequency_hz=frequency, amplitude_nm=amplitude),
        tau=tau,
        start=np.array([t[0] for t in traces]),
        start_torque=np.full(len(lengths), start_torque),
        shaken_speed=np.zeros(1),
        deviation=0.0,
        traces=traces,
        trace_dt=STEP,
    )


@pytest.mark.parametrize("direction", ["+", "-"])
@pytest.mark.parametrize("start_torque", [0.0, 0.05])
def test_torque_along_the_ramp_ends_at_the_breakaway_torque(direction, start_torque):
    m = measurement(direction, start_torque=start_torque)
    sign = m.job.configuration.sign
    for (torque, angle), tau in zip(plots.ramps(m, RATE), m.tau, strict=True):
        assert torque[0] == pytest.approx(sign * start_torque)
        assert torque[-1] == pytest.approx(sign * tau)
        assert len(torque) == len(angle)


@pytest.mark.parametrize(
    "changes",
    [{"lengths": (30,)}, {"stuck": True}, {"frequency": 15.0, "amplitude": 0.6}],
    ids=["one iteration", "stuck", "dithered"],
)
def test_every_kind_of_measurement_is_drawn(tmp_path, changes):
    plots.plot_sje([measurement(**changes)], tmp_path / "a.png", robot="own", protocol=PROTOCOL)
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
