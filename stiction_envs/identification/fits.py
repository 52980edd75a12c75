"""Fits of links and friction: base parameters without a prior, and physically consistent links.

Torques determine only sums of parameters (`robots.regressor.base_set`). `fit_base` is least squares
on the logs without a prior, over the same sums of squares as a diagnosis. `fit_predictor` is the
engine of `gap` without named causes: every joint's friction, offset and rotor (where torque is
measured in front of the gear) and small errors of all links have the priors of the diagnosis; the
size of the links' errors is the likeliest one. The links are the nearest bodies that exist.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.gap.causes import TOLERANCES, Cause, Shape
from stiction_envs.gap.causes.base import THE_ARM, Prior, filtered_columns
from stiction_envs.gap.causes.body.link_inertia import LinkInertia
from stiction_envs.gap.causes.friction.coulomb_friction import CoulombFriction
from stiction_envs.gap.causes.friction.viscous_friction import ViscousFriction
from stiction_envs.gap.causes.log.torque_offset import TorqueOffset
from stiction_envs.gap.judge.problem import ARM, Term
from stiction_envs.gap.links import nearest_links
from stiction_envs.gap.predictors.torque import FOLDS, TorquePredictor
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.friction_state import noise_floor, presliding_distances
from stiction_envs.gap.signals.rigid_body import passive_torque
from stiction_envs.measured.motion_thresholds import TRAVEL_SPAN
from stiction_envs.robots.regressor import columns_of, inertial_parameters

UNKNOWN = 1e-7
"""Part of a parameter's information that is its own, apart from all others, below which it is
rounding [-]; assumed."""
SCALES = (0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
"""Sizes of link errors to try, over the tolerance of CAD [-]; assumed: a user's model
may be far off, and is never exact."""
WIDE = 0.5
"""Standard deviation of a posterior over the prior's from which on logs do not show it [-]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BaseFit:
    """Least squares on r base parameters, without a prior."""

    values: Array
    """(1 + F, r) of all folds, and of all but each."""
    errors: Array
    """(r,) standard errors; infinite for parameters of which the rows say nothing."""
    condition: float
    """Condition number of the weighted columns, scaled to unit length [-]."""


def torque_to_fit(data: Data) -> Array:
    """Return (T, n) measured torque less springs and gravity compensation of the file [N·m]."""
    return np.asarray(data.tau - passive_torque(data.arm, data.q))


def fit_base(predictor: TorquePredictor, columns: Array, torque: Array) -> BaseFit:
    """Return least squares of the links' and joints' torque (T, n) on columns (T, n, r).

    The weights are those of a predictor; ``torque`` is as of `torque_to_fit`.

    The variance is that of noise that neighbouring rows share, or the mean of it and of the
    jackknife over folds, if that is larger. The former does not see what the model leaves at the
    motion's own frequencies; the latter is too large for few folds (B. Efron, C. Stein, "The
    jackknife estimate of variance", Annals of Statistics 1981).
    """
    data, r = predictor.data, columns.shape[2]
    xx, xr = np.zeros((FOLDS, r, r)), np.zeros((FOLDS, r))
    for j, channel in enumerate(predictor.problem.channels):
        weight = channel.weight / predictor.problem.inflation[j]
        for f in range(FOLDS):
            rows = predictor.fold == f
            own = columns[rows, j]
            xx[f] += own.T @ (own * weight[rows, None])
            xr[f] += own.T @ (torque[rows, j] * weight[rows])
    whole, along = xx.sum(axis=0), xr.sum(axis=0)
    size = np.sqrt(np.maximum(np.diag(whole), 1e-200))
    across = np.outer(size, size)

    def fitted(square: Array, target: Array) -> Array:
        return np.linalg.lstsq(square / across, target / size, rcond=UNKNOWN)[0] / size

    eigenvalues, v = np.linalg.eigh(whole / across)
    least = max(float(eigenvalues[0]), float(np.finfo(float).eps * eigenvalues[-1]))
    seen = eigenvalues > UNKNOWN
    variance = (np.square(v[:, seen]) / eigenvalues[seen]).sum(axis=1) / size**2
    # neighbours within half a period of the filter depend on each other
    variance *= max(1.0, 0.5 / (data.recording.cutoff * data.dt)) / predictor.rows
    known = np.square(v[:, ~seen]).sum(axis=1) < UNKNOWN
    without = np.array([fitted(whole - x, along - y) for x, y in zip(xx, xr, strict=True)])
    jackknife = (FOLDS - 1) * without.var(axis=0)
    return BaseFit(
        values=np.vstack([fitted(whole, along), without]),
        errors=np.where(known, np.sqrt(np.maximum(variance, (variance + jackknife) / 2)), np.inf),
        condition=float(np.sqrt(eigenvalues[-1] / least)),
    )


class _SmallOffset(TorqueOffset):
    """Offset of a usual sensor: on a joint that rests it looks like gravity's torque of a link."""

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return its standard deviation [N·m]."""
        usual = super().prior(data, joint, shape).usual
        return Prior(np.array([usual]), usual=usual)


KINDS: dict[str, Cause] = {
    "rotor": LinkInertia(),
    "Fc": CoulombFriction(),
    "Fv": ViscousFriction(),
    "offset": _SmallOffset(),
}
"""Parameters of a joint (not of its link), and their causes."""


def kinds_of(torque: str) -> tuple[str, ...]:
    """Return the `KINDS` that torques show; rotors only in front of the gear, on the motor side."""
    return tuple(x for x in KINDS if x != "rotor" or torque == "motor")


def fit_predictor(data: Data) -> TorquePredictor:
    """Return the predictor of the logs' links and friction, with the noise that they leave.

    A first fit gives the noise floor and the presliding distances: in the residual of the nominal
    model, errors of its links would decide them. Links are almost free, by the largest scale.
    """
    predictor = _predictor(data)
    terms = terms_of(predictor)
    torques = predictor.torques(terms, predictor.problem.fit(terms))
    links = torques[terms[0]]
    left = data.residual - np.sum(list(torques.values()), axis=0)
    noise = noise_floor(data.recording, left)
    distance = presliding_distances(data.recording, data.residual - links)
    predictor = _predictor(replace(data.with_presliding(distance), noise=noise))
    # the noise is what the whole model leaves
    problem, terms = predictor.problem, terms_of(predictor)
    rest = problem.errors(terms, problem.fit(terms)) / np.maximum(problem.counts(), 1.0)
    problem.given(predictor.rows * np.maximum(rest, 1.0))
    found = []
    for scale in SCALES:
        problem.given(scales=(scale, 1.0))
        found.append(problem.score(predictor.candidates))
    problem.given(scales=(SCALES[int(np.argmax(found))], 1.0))
    return predictor


def _predictor(data: Data) -> TorquePredictor:
    own = [KINDS[x] for x in kinds_of(data.recording.torque)]
    predictor = TorquePredictor(data, [TOLERANCES, *own])
    predictor.problem.always = [t for t in predictor.problem.always if t.joint == ARM]
    predictor.candidates = [t for t in predictor.candidates if t.part == 1.0]
    predictor.expect(predictor.problem, np.zeros((data.n, 2)))  # the noise alone
    predictor.problem.given(scales=(SCALES[-1], 1.0))
    return predictor


def terms_of(predictor: TorquePredictor) -> list[Term]:
    """Return the whole model: errors of all links, then the joint parameters that the logs show."""
    return predictor.problem.model(predictor.candidates)


def not_shown(predictor: TorquePredictor) -> list[str]:
    """Return the joint parameters that the logs cannot show: ``Fc2``, ``rotor7``."""
    kinds = {cause.name: kind for kind, cause in KINDS.items()}
    problem, terms = predictor.problem, terms_of(predictor)
    sd = np.sqrt(np.diag(problem.covariance(terms)))
    wide = {
        t[:2]
        for t, doubt in zip(terms, problem.split(terms, sd), strict=True)
        if t in predictor.candidates and (doubt > WIDE * problem.sd(t)).any()
    }
    data = predictor.data
    still = np.flatnonzero(np.ptp(data.q, axis=0) < TRAVEL_SPAN)
    wide |= {(KINDS[x].name, int(j)) for x in ("Fc", "Fv") for j in still}
    shown = {t[:2] for t in predictor.candidates} - wide
    return [
        f"{kinds[name]}{j + 1}"
        for name in predictor.causes
        if name in kinds
        for j in range(data.n)
        if (name, j) not in shown
    ]


def all_columns(predictor: TorquePredictor) -> Array:
    """Return (T, n, 10 n + k n) torque per parameter, as of `columns_of`."""
    data = predictor.data
    own = [
        np.concatenate(
            [x for j in range(data.n) for x in filtered_columns(cause, data, j, [()])], axis=1
        )
        for cause in predictor.causes.values()
        if cause.acts_on != THE_ARM
    ]
    return columns_of(data.recording.pinocchio, data.q, data.dq, data.ddq, np.stack(own, axis=2))


def parameters(predictor: TorquePredictor, terms: Sequence[Term]) -> Array:
    """Return (1 + F, 10 n + k n) parameters of a model fitted to all folds, and to all but each.

    Links exist, and are the nominal ones in models without their errors. What the logs do not show
    of a joint's own is zero; of a rotor, what the robot's file states.
    """
    problem, n = predictor.problem, predictor.data.n
    c = np.stack([problem.fit(terms), *(problem.without(f).fit(terms) for f in range(FOLDS))])
    kinds = [x.name for x in predictor.causes.values() if x.acts_on != THE_ARM]
    own = np.zeros((len(c), len(kinds), n))
    if LinkInertia.name in kinds:
        own[:, kinds.index(LinkInertia.name)] = predictor.data.friction.rotor
    links = np.tile(inertial_parameters(predictor.data.recording.pinocchio), (len(c), 1, 1))
    for term, mine in zip(terms, problem.split(terms, c), strict=True):
        if term.joint != ARM:
            own[:, kinds.index(term.cause), term.joint] += mine[:, 0]
        else:
            links = nearest_links(predictor, c)
    return np.concatenate([links.reshape(len(c), -1), own.reshape(len(c), -1)], axis=1)


def held_out(predictor: TorquePredictor, columns: Array, values: Array, torque: Array) -> Array:
    """Return (n,) error on folds that a model was not fitted to, root mean square [N·m].

    ``columns`` (T, n, p) are torque per parameter, ``values`` (1 + F, p) as of `parameters`,
    ``torque`` (T, n) as of `torque_to_fit`.
    """
    rows = np.flatnonzero(predictor.fold >= 0)
    fitted = np.einsum("tjp,tp->tj", columns[rows], values[1 + predictor.fold[rows]])
    return np.asarray(np.sqrt(np.square(torque[rows] - fitted).mean(axis=0)))
