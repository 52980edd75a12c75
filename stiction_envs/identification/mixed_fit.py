"""Links and friction of an arm by the engine of `gap`, without named causes.

Every joint's friction, offset and rotor (where torque is measured in front of the gear) are fixed
effects. Small errors of all links are random effects, whose size is the largest that the data allow
(`RegressorLibrary.likeliest`). The links are the nearest bodies that exist (`nearest_links`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.causes import TOLERANCES, Cause
from stiction_envs.gap.causes.body.link_inertia import LinkInertia
from stiction_envs.gap.causes.friction.coulomb_friction import CoulombFriction
from stiction_envs.gap.causes.friction.viscous_friction import ViscousFriction
from stiction_envs.gap.causes.log.torque_offset import TorqueOffset
from stiction_envs.gap.links import nearest_links
from stiction_envs.gap.selection.candidates import ARM, Candidate, RegressorLibrary
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.friction_state import presliding_distances
from stiction_envs.gap.signals.noise_floor import noise_floor
from stiction_envs.gap.signals.prepare import Signals
from stiction_envs.identification.base_parameters import columns_of
from stiction_envs.robots.regressor import inertial_parameters

Array = NDArray[np.float64]
SCALES = (0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
"""Sizes of the links' errors over the tolerance of CAD that are tried [-]; assumed: a user's model
may be far off, and is never exact."""


class _SmallOffset(TorqueOffset):
    """That of a usual sensor: of a joint that rests it looks like gravity's torque of a link."""

    def prior(self, data: Data, joint: int) -> Array:
        """Return its standard deviation [N·m]."""
        return np.array([self.tolerance(data, joint)])


KINDS: dict[str, Cause] = {
    "rotor": LinkInertia(),
    "Fc": CoulombFriction(),
    "Fv": ViscousFriction(),
    "offset": _SmallOffset(),
}
"""Parameters of each joint's own, and their causes."""


def kinds_of(torque: str) -> tuple[str, ...]:
    """Return the `KINDS` that torques show; rotors only in front of the gear, on the motor side."""
    return tuple(x for x in KINDS if x != "rotor" or torque == "motor")


def fit_library(data: Data, signals: Signals) -> RegressorLibrary:
    """Return the library of the logs' links and friction, with the noise that they leave.

    A first fit gives the noise floor and the presliding distances: in the residual of the nominal
    model, errors of its links would decide them. Links are almost free, by the largest scale.
    """
    library = _library(data)
    c = library.grams.fit(library.model_columns(terms_of(library)))

    def left(terms: Sequence[Candidate]) -> Array:
        own = c[: sum(library.size(t) for t in terms)]
        torque = [library.torque(terms, own, j) for j in range(data.n)]
        return np.asarray(data.residual - np.stack(torque, axis=1))

    noise = noise_floor(data.recording, signals.noise_tau, left(terms_of(library)))
    distance = presliding_distances(data.recording, left(library.random))
    library = _library(replace(data.with_presliding(distance), noise=noise))
    return library.given(library.noise_under(terms_of(library)), library.scale)


def _library(data: Data) -> RegressorLibrary:
    own = [KINDS[x] for x in kinds_of(data.recording.torque)]
    library = RegressorLibrary(data, [TOLERANCES, *own])
    return library.given(library.least_inflation, SCALES[-1])


def terms_of(library: RegressorLibrary) -> list[Candidate]:
    """Return the whole model: errors of all links, then what the logs show of each joint's own."""
    return [*library.random, *library.candidates]


def not_shown(library: RegressorLibrary) -> list[str]:
    """Return the parameters of joints' own that the logs cannot show: ``Fc2``, ``rotor7``."""
    kinds = {cause.name: kind for kind, cause in KINDS.items()}
    return [f"{kinds[name]}{joint + 1}" for name, joint in library.not_identifiable]


def all_columns(library: RegressorLibrary) -> Array:
    """Return (T, n, 10 n + k n) torque per parameter, as of `columns_of`."""
    data = library.data
    own = [
        np.concatenate([cause.columns(data, j, ()) for j in range(data.n)], axis=1)
        for cause in library.causes.values()
        if not cause.arm_wide
    ]
    return columns_of(data.pinocchio, data.q, data.dq, data.ddq, np.stack(own, axis=2))


def parameters(library: RegressorLibrary, terms: Sequence[Candidate]) -> Array:
    """Return (1 + B, 10 n + k n) parameters of a model fitted to all blocks, and to all but each.

    Links exist, and are the nominal ones in models without their errors. What the logs do not show
    of a joint's own is zero.
    """
    model, n = library.model_columns(terms), library.data.n
    c = np.vstack([library.grams.fit(model), library.grams.leave_one_block_out(model)])
    kinds = [x.name for x in library.causes.values() if not x.arm_wide]
    own = np.zeros((len(c), len(kinds), n))
    links = np.tile(inertial_parameters(library.data.pinocchio), (len(c), 1, 1))
    for term, mine in zip(terms, library.split(terms, c), strict=True):
        if term.joint != ARM:
            own[:, kinds.index(term.cause), term.joint] = mine[:, 0]
        else:
            links = nearest_links(library, c)
    return np.concatenate([links.reshape(len(c), -1), own.reshape(len(c), -1)], axis=1)


def held_out(data: Data, columns: Array, values: Array) -> Array:
    """Return (n,) error on blocks that a model was not fitted to, root mean square [N·m].

    Args:
        data: the logs.
        columns: (T, n, p) torque per parameter.
        values: (1 + B, p) as of `parameters`.
    """
    rows = np.flatnonzero(data.block >= 0)
    torque = np.einsum("tjp,tp->tj", columns[rows], values[1 + data.block[rows]])
    return np.asarray(np.sqrt(np.square(data.tau[rows] - torque).mean(axis=0)))
