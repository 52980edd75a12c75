"""The small errors of all links that a diagnosis found: bodies that exist."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.candidates import RegressorLibrary
from stiction_envs.gap.causes.body.bodies import link_basis, link_factor, link_squares
from stiction_envs.robots.consistent import nearest_bodies
from stiction_envs.robots.regressor import inertial_parameters

Array = NDArray[np.float64]


def link_changes(library: RegressorLibrary, c: Array) -> Array:
    """Return (n, 10) what is added to the links' parameters so that they exist.

    Of all such bodies these change the torques along the logs least, in units of the noise, and
    stray least from the prior.

    Args:
        library: of the logs.
        c: (r,) factors of `link_basis`.
    """
    data = library.data
    recording = data.recording
    links = inertial_parameters(data.pinocchio)
    wanted = (recording.derived(link_basis) @ c).reshape(links.shape)
    weight = library.grams.counts / library.inflation / np.square(data.noise)
    torques = np.tensordot(weight, recording.derived(link_squares), axes=1)
    factor = library.scale * link_factor(recording)
    prior = np.linalg.pinv(factor @ factor.T, hermitian=True)
    return nearest_bodies(links + wanted, torques + prior, links) - links
