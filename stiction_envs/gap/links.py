"""Small errors of all links, as physically consistent inertias, and their uncertainty.

If a body is also named (the last link's for a payload), the uncertainty is that of the sum.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.gap.causes.body.bodies import link_basis, link_factor, link_squares
from stiction_envs.gap.judge.judgement import WIDTH
from stiction_envs.gap.judge.problem import LINKS, Term
from stiction_envs.gap.predictors.torque import TorquePredictor
from stiction_envs.robots import Arm
from stiction_envs.robots.consistent import nearest_bodies
from stiction_envs.robots.inertias import with_inertias
from stiction_envs.robots.regressor import inertial_parameters

ROUNDING = 1e-10
"""Eigenvalues of correlations, over the largest, that are rounding [-]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LinkErrors:
    """Small errors of n links beside the nominal arm."""

    scale: float
    """Size of the errors over the tolerance of CAD [-]."""
    changes: Array
    """(n, 10) what is added to the links' parameters so that bodies exist; without named bodies."""
    covariance: Array
    """(10 n, 10 n) of the links' parameters, what was named of them included."""
    links: Array
    """(n, 10) parameters of the nominal links."""
    prior: Array
    """(10 n, 10 n) covariance of the links' parameters before the logs: CAD's, or an earlier
    diagnosis's."""

    @property
    def mass(self) -> Array:
        """(n, 2) mass that is added and its 95 % half width [kg]."""
        return np.stack([self.changes[:, 0], WIDTH * self._deviations(self.covariance)[0]], axis=1)

    @property
    def centre(self) -> Array:
        """(n, 3, 2) shift of the centre of mass and its 95 % half width [m]."""
        mass, moment = self.links[:, 0, None], self.links[:, 1:4]
        after = (moment + self.changes[:, 1:4]) / (mass + self.changes[:, :1])
        width = WIDTH * self._deviations(self.covariance)[1]
        return np.stack([after - moment / mass, width], axis=2)

    @property
    def distance(self) -> Array:
        """(n,) largest change of a link's mass or centre, in its prior's standard deviations."""
        mass, centre = self._deviations(self.prior)
        off = np.concatenate([self.mass[:, :1], self.centre[:, :, 0]], axis=1)
        usual = np.concatenate([mass[:, None], centre], axis=1)
        return np.asarray(np.max(np.abs(off) / np.maximum(usual, 1e-12), axis=1))

    def _deviations(self, covariance: Array) -> tuple[Array, Array]:
        """Return (n,) standard deviations of masses [kg] and (n, 3) of centres [m]."""
        mass, moment = self.links[:, 0, None], self.links[:, 1:4]
        # to first order, d(h/m) = (dh − c dm)/m
        slope = np.zeros((len(mass), 3, 10))
        slope[:, :, 0] = -moment / mass**2
        slope[:, range(3), range(1, 4)] = 1 / mass
        n = len(mass)
        own = covariance.reshape(n, 10, n, 10)[range(n), :, range(n)]
        return np.sqrt(own[:, 0, 0]), np.sqrt(np.einsum("nia,nab,nib->ni", slope, own, slope))

    def to_json(self) -> list[dict[str, object]]:
        """Return ``links`` of ``diagnosis.json``."""

        def estimate(value: Array) -> dict[str, object]:
            low, high = value[..., 0] - value[..., 1], value[..., 0] + value[..., 1]
            return {
                "value": value[..., 0].tolist(),
                "ci95": np.stack([low, high], axis=-1).tolist(),
            }

        return [
            {
                "link": k,
                "mass_kg": estimate(mass),
                "com_m": estimate(centre),
                "prior_sd": float(far),
            }
            for k, mass, centre, far in zip(
                range(1, len(self.mass) + 1), self.mass, self.centre, self.distance, strict=True
            )
        ]


def root_of(covariance: Array) -> Array:
    """Return (P, k) F of a covariance F Fᵀ (P, P), without what is rounding."""
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    square, v = np.linalg.eigh(covariance / np.outer(size, size))
    kept = square > ROUNDING * square[-1]
    return np.asarray(size[:, None] * v[:, kept] * np.sqrt(square[kept]))


def link_errors(predictor: TorquePredictor, terms: Sequence[Term], c: Array) -> LinkErrors | None:
    """Return the small errors of all links in a model; None where it has none.

    Args:
        predictor: of the logs.
        terms: the model, its random effects first.
        c: (P,) its coefficients.
    """
    if not terms or terms[0].shape != LINKS:
        return None
    data = predictor.data
    links, basis = inertial_parameters(data.recording.pinocchio), data.recording.derived(link_basis)
    # directions that no torque shows keep the prior's doubt
    prior = link_factor(data.recording)
    unseen = _prior(predictor) - predictor.problem.scales[0] ** 2 * basis @ basis.T
    effect = _effect(predictor, terms)
    shown = effect @ predictor.problem.covariance(terms) @ effect.T
    return LinkErrors(
        scale=predictor.problem.scales[0],
        changes=nearest_links(predictor, c) - links,
        covariance=shown + unseen,
        links=links,
        prior=prior @ prior.T,
    )


def nearest_links(predictor: TorquePredictor, c: Array) -> Array:
    """Return (..., n, 10) physically consistent links of coefficients (..., P), small errors first.

    These links change the fitted torques along the logs least, in units of the noise, and are
    nearest to the prior.
    """
    basis = predictor.data.recording.derived(link_basis)
    return _nearest(predictor, c[..., : basis.shape[1]] @ basis.T)


def with_found_links(predictor: TorquePredictor, terms: Sequence[Term], c: Array) -> Arm:
    """Return the nominal arm with the links of a model's bodies and small errors.

    They are bodies that exist, the nearest as in `nearest_links`.
    """
    return with_inertias(predictor.data.arm, _nearest(predictor, _effect(predictor, terms) @ c))


def _nearest(predictor: TorquePredictor, more: Array) -> Array:
    """Return (..., n, 10) links that exist, nearest to those that are ``more`` (..., 10 n) off."""
    data = predictor.data
    links = inertial_parameters(data.recording.pinocchio)
    torques = np.tensordot(predictor.information(), data.recording.derived(link_squares), axes=1)
    hessian = torques + np.linalg.pinv(_prior(predictor), hermitian=True)
    wanted = links + more.reshape(*more.shape[:-1], *links.shape)
    each = [nearest_bodies(x, hessian, links) for x in wanted.reshape(-1, *links.shape)]
    return np.reshape(each, wanted.shape)


def _effect(predictor: TorquePredictor, terms: Sequence[Term]) -> Array:
    """Return (10 n, P) change of the links' parameters per unit of a model's coefficients."""
    data, causes = predictor.data, predictor.causes
    each = [
        causes[t.cause].on_links(data, t.joint, t.shape, len(predictor.problem.numbers[t]))
        for t in terms
    ]
    return np.concatenate(each, axis=1)


def _prior(predictor: TorquePredictor) -> Array:
    """Return (10 n, 10 n) covariance of the links' parameters before the logs."""
    factor = predictor.problem.scales[0] * link_factor(predictor.data.recording)
    return np.asarray(factor @ factor.T)
