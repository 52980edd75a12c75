"""Posterior of a joint's settings: the simulation, corrected by what was measured.

The ratio y = |τ|/|τ_base| of setting s in configuration c is

    y(s, c) = m(s, c) + d(s, c) + ε,      ε ~ N(0, σ_n²)

where m is the prediction of the simulation and d, its discrepancy, is a Gaussian process (Kennedy &
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
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Kernel

from tuning.robot.candidates import Candidates, Readings
from tuning.settings import RobotSettings, tuning_settings

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


def widening(process: GaussianProcessRegressor, s: RobotSettings) -> float:
    """Return the factor (≥ 1) that widens the posterior for readings further off than it expected.

    It is that of a Student-t process, (ν + dᵀ K⁻¹ d)/(ν + M) for M readings (Shah, Wilson &
    Ghahramani, AISTATS 2014, lemma 3), where that is wider: for a robot unlike those that the
    kernel's numbers come from, the posterior must not be too narrow.
    """
    if not hasattr(process, "alpha_"):
        return 1.0
    d = process.y_train_
    return max(1.0, float((s.firmness + d @ process.alpha_) / (s.firmness + len(d))))


@dataclass(frozen=True, kw_only=True, eq=False)
class Posterior:
    """Normal distribution of |τ|/|τ_base| of every setting of a joint."""

    mean: Array
    """(S,) mean over the four configurations [-]."""
    covariance: Array
    """(S, S) covariance of these means [-]."""
    cell_mean: Array
    """(S, 4) mean of each configuration [-]."""
    cell_sd: Array
    """(S, 4) standard deviation without measuring noise [-]."""
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


def posterior_of(
    candidates: Candidates, readings: Readings, settings: RobotSettings | None = None
) -> Posterior:
    """Return the posterior after some readings; without any it is the simulation's prediction.

    Args:
        candidates: settings of a joint and their predictions.
        readings: what was measured; failed measurements are ignored here.
        settings: numbers of the method; None for those of ``settings.toml``.
    """
    s = settings or tuning_settings().robot
    at = readings.setting[readings.valid] * CONFIGURATIONS + readings.configuration[readings.valid]
    x, m = candidates.features, candidates.predicted.ravel()
    process = GaussianProcessRegressor(discrepancy_kernel(s), alpha=s.noise**2, optimizer=None)
    if len(at):
        process.fit(x[at], readings.ratio[readings.valid] - m[at])
    correction, covariance = process.predict(x, return_cov=True)
    covariance = covariance * widening(process, s)
    cells = (len(candidates), CONFIGURATIONS)
    mean = (m + correction).reshape(cells)
    blocks = covariance.reshape(*cells, *cells)
    return Posterior(
        mean=mean.mean(axis=1),
        covariance=blocks.mean(axis=(1, 3)),
        cell_mean=mean,
        cell_sd=np.sqrt(np.maximum(np.diag(covariance), 0.0)).reshape(cells),
        eligible=candidates.eligible,
    )
