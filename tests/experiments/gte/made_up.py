"""A made-up run of the Generated Trajectory Experiment, with simple numbers."""

import numpy as np

from stiction_envs.experiments.gte.protocol import FLAGS, Case, Run
from stiction_envs.measured.tables import AmplitudeRow

RATE = 100.0
"""Samples per second [Hz]."""
DITHER = (AmplitudeRow(7, 15.0, 0.5),)


def made_up(
    error: np.ndarray | None = None,
    *,
    accepted: tuple[float, ...] = (0.0, 2.0, 4.0),
    reached: tuple[float, ...] = (2.0, 4.0, 6.0),
    iterations: int = 2,
    dithered: bool = False,
    trajectory: str = "triangle",
    stiffness: tuple[float, float, float] = (200.0, 20.0, 0.0),
) -> Run:
    """A run of 7 s: on a square in x and y, its error (iterations, 700, 6) as given or 0."""
    count = 700
    error = np.zeros((iterations, count, 6)) if error is None else error
    time = np.arange(count) / RATE
    reference = np.zeros((iterations, count, 6))
    corners = np.array([[0.3, 0, 0.5], [0.4, 0, 0.5], [0.4, 0.1, 0.5], [0.3, 0, 0.5]])
    for k in range(3):
        reference[..., k] = np.interp(
            time, [0, 1.9, 2, 3.9, 4, 5.9], corners[[0, 1, 1, 2, 2, 3], k]
        )
    reference[..., 3] = np.pi  # a flange that looks down: roll jumps between -pi and pi
    actual = reference + error
    actual[..., 3] -= 2 * np.pi * (actual[..., 3] > np.pi)
    return Run(
        case=Case(trajectory=trajectory, stiffness=stiffness, dither=DITHER if dithered else ()),
        time=time,
        reference=reference,
        actual=actual,
        accepted=np.tile(accepted, (iterations, 1)),
        reached=np.tile(reached, (iterations, 1)),
        mean_square=np.tile([9e-6, 16e-6, 0.0, 0.0, 0.0, 144e-6], (iterations, count, 1)),
        dither_power=np.full((iterations, count), 2.0),
        torque_rate=np.tile(np.arange(1.0, 8.0), (iterations, 1)),
        flags={name: np.zeros(iterations, dtype=bool) for name in FLAGS},
    )
