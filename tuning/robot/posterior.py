"""Posterior of a joint's settings: the simulation, corrected by what was measured.

The ratio y = |τ|/|τ_base| of setting s in configuration c is

    y(s, c) = m(s, c) + d(s, c) + ε,      ε ~ N(0, σ_n²)

where m is the prediction of the simulation, the mean under several frictions where the arm's is not
known (`frictions.plausible`), and d, its discrepancy, is a Gaussian process (Kennedy &
O'Hagan, Bayesian calibration of computer models, J. R. Statist. Soc. B 63, 2001; Rasmussen &
Williams, Gaussian Processes for Machine Learning, 2006, eq. 2.22–2.24). The result is the mean of
the four configurations. A common error of the simulation shifts all settings equally and decides
nothing; two errors distinguish settings: one that is smooth over frequency and displacement, and
one that a setting does not share with its neighbours (a sharp resonance, a drift between days).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Kernel

from tuning.robot.candidates import Candidates, Readings
from tuning.settings import RobotSettings

Array = NDArray[np.float64]
CONFIGURATIONS = 4
"""Pose and direction: two of each."""


def discrepancy_kernel(s: RobotSettings) -> Kernel:
    """Return the covariance of the simulation's error between two cells.

    Inputs are `Candidates.features`: ln f, ln of the predicted displacement x, configuration c,
    setting s.

        offset² + configuration² δ_cc' + setting² δ_ss'
        + shape² exp(−½ (Δ ln f / l_f)² − ½ (Δ ln x / l_x)²)
    """
    # an infinite length removes a column; a short one separates whole numbers (1e-3: assumed)
    far, close = np.inf, 1e-3
    shape = RBF([s.frequency_length, s.displacement_length, far, far])
    return (
        ConstantKernel(s.offset**2)
        + ConstantKernel(s.configuration**2) * RBF([far, far, close, far])
        + ConstantKernel(s.setting**2) * RBF([far, far, far, close])
        + ConstantKernel(s.shape**2) * shape
    )


def prior_covariance(candidates: Candidates, s: RobotSettings) -> Array:
    """Return (4 S, 4 S) covariance of the cells before anything was measured.

    It is the discrepancy's, and the sample covariance of predictions under several frictions: a
    reading that fits one of these better moves all settings towards it.
    """
    apart = candidates.deviation.reshape(len(candidates.deviation), -1)
    out: Array = discrepancy_kernel(s)(candidates.features)
    return out + apart.T @ apart / max(len(apart) - 1, 1)


def widening(d: Array, weighted: Array, s: RobotSettings) -> float:
    """Return the factor (≥ 1) that widens the posterior for readings further off than it expected.

    It is that of a Student-t process, (ν + dᵀ K⁻¹ d)/(ν + M) for M readings (Shah, Wilson &
    Ghahramani, AISTATS 2014, lemma 3), where that is wider: for a robot unlike those that the
    kernel's numbers come from, the posterior must not be too narrow.

    Args:
        d: (M,) readings less their predictions [-].
        weighted: (M,) K⁻¹ d.
        s: numbers of the method.
    """
    return max(1.0, float((s.firmness + d @ weighted) / (s.firmness + len(d))))


@dataclass(frozen=True, kw_only=True, eq=False)
class Posterior:
    """Normal distribution of |τ|/|τ_base| of every setting of a joint."""

    mean: Array
    """(S,) mean over the four configurations [-]."""
    covariance: Array
    """(S, S) covariance of these means [-]."""
    cell_mean: Array
    """(S, 4) mean of each configuration [-]."""
    eligible: NDArray[np.bool_]
    """(S,) as in the candidates."""

    @property
    def sd(self) -> Array:
        """(S,) standard deviation of the mean over the four configurations [-]."""
        return np.sqrt(np.diag(self.covariance))

    def advantage(self, best: int) -> tuple[Array, Array]:
        """Return (S,) mean and standard deviation of how much lower each is than ``best`` [-].

        Errors that both share cancel, so the difference of two neighbouring settings is well known.
        """
        k = self.covariance
        variance = np.diag(k) + k[best, best] - 2 * k[best]
        return self.mean[best] - self.mean, np.sqrt(np.maximum(variance, 0.0))


def posterior_of(candidates: Candidates, readings: Readings, s: RobotSettings) -> Posterior:
    """Return the posterior after some readings; without any it is the simulation's prediction.

    Args:
        candidates: settings of a joint and their predictions.
        readings: what was measured; failed measurements are ignored here.
        s: numbers of the method.
    """
    at = readings.setting[readings.valid] * CONFIGURATIONS + readings.configuration[readings.valid]
    m, prior = candidates.predicted.ravel(), prior_covariance(candidates, s)
    mean, covariance = m, prior
    if len(at):
        d = readings.ratio[readings.valid] - m[at]
        factor = cho_factor(prior[np.ix_(at, at)] + s.noise**2 * np.eye(len(at)), lower=True)
        weighted = cho_solve(factor, d)
        mean = m + prior[:, at] @ weighted
        covariance = prior - prior[:, at] @ cho_solve(factor, prior[at])
        covariance = covariance * widening(d, weighted, s)
    cells = (len(candidates), CONFIGURATIONS)
    mean = mean.reshape(cells)
    blocks = covariance.reshape(*cells, *cells)
    return Posterior(
        mean=mean.mean(axis=1),
        covariance=blocks.mean(axis=(1, 3)),
        cell_mean=mean,
        eligible=candidates.eligible,
    )
