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

The next setting is that of the largest expected improvement over the best measured one (Jones,
Schonlau & Welch, Efficient global optimization of expensive black-box functions, J. Global Optim.
13, 1998) of the difference of two settings, whose common errors cancel. For several at once, each
is added with its posterior mean as measurement before the next is chosen (kriging believer:
Ginsbourger, Le Riche & Carraro 2010).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import ndtr
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Kernel

from stiction_envs.arrays import Array, Bools
from stiction_envs.measured.tables import DIRECTIONS, LOADS, AmplitudeRow
from tuning.settings import RobotSettings

CONFIGURATIONS = tuple((load, direction) for load in LOADS for direction in DIRECTIONS)
"""Pose and direction of a joint, in the order of every axis of length four."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidates:
    """S settings of one joint; a setting is tried in four configurations (`CONFIGURATIONS`)."""

    joint: int  # Number of the joint, from 1
    frequency_hz: Array  # (S,) frequency [Hz]
    amplitude_nm: Array  # (S,) amplitude [N·m]
    predicted: Array  # (S, 4) simulated |τ|/|τ_base|: the prior mean [-]
    displacement: Array  # (S, 4) simulated root mean square oscillation before breakaway [rad]
    deviation: Array
    """(K, S, 4) by how much the predictions under each of K frictions differ from their mean, which
    is ``predicted`` [-]."""
    eligible: Bools
    """(S,) may be proposed and chosen; the others (too much vibration) only serve for learning."""

    def __len__(self) -> int:
        return len(self.frequency_hz)

    def row(self, setting: int) -> AmplitudeRow:
        """Return a setting as a row of an amplitude table."""
        frequency, amplitude = self.frequency_hz[setting], self.amplitude_nm[setting]
        return AmplitudeRow(self.joint, float(frequency), float(amplitude))

    def with_more(self, other: "Candidates") -> "Candidates":
        """Return these candidates and others of the same joint."""
        both = {
            f.name: np.concatenate(
                [getattr(self, f.name), getattr(other, f.name)], axis=int(f.name == "deviation")
            )
            for f in fields(self)[1:]
        }
        return Candidates(joint=self.joint, **both)

    @cached_property
    def features(self) -> Array:
        """(4 S, 4) inputs of `discrepancy_kernel`.

        Cells are in the order of ``predicted.ravel()``. Columns: ln f, ln of the displacement,
        configuration 0…3, setting 0…S−1.
        """
        setting, configuration = np.indices(self.predicted.shape)
        frequency = np.log(self.frequency_hz)[setting]
        columns = (frequency, np.log(self.displacement), configuration, setting)
        return np.stack([x.ravel() for x in columns], axis=1).astype(float)


class Readings:
    """M measured cells of one joint's S settings; a cell may occur several times."""

    def __init__(self, settings: int, rows: Sequence[tuple[int, int, float]] = ()) -> None:
        """Take rows of setting (from 0), configuration (0…3) and ratio |τ|/|τ_base| [-].

        A ratio of NaN says that the joint stuck, or that the run failed.
        """
        self.settings, self.rows = settings, [*rows]
        valid = [row for row in self.rows if np.isfinite(row[2])]
        self.ratio = np.array([ratio for _, _, ratio in valid])
        """Ratios that are numbers [-]."""
        self.cell = np.array([4 * s + c for s, c, _ in valid], dtype=np.int64)
        """Their cells, in the order of ``predicted.ravel()``."""
        self.tried, self.known = np.zeros((2, settings, 4), dtype=bool)
        """(S, 4) cells that were tried, and those that ever gave a number."""
        for s, c, _ in self.rows:
            self.tried[s, c] = True
        self.known.ravel()[self.cell] = True

    def with_rows(self, rows: Sequence[tuple[int, int, float]]) -> "Readings":
        """Return these readings with more rows."""
        return Readings(self.settings, [*self.rows, *rows])

    @property
    def failed(self) -> Bools:
        """(S,) whether a setting has a cell that was tried and never gave a number."""
        return np.asarray((self.tried & ~self.known).any(axis=1))

    @property
    def measured(self) -> Bools:
        """(S,) whether a setting has a number in all four configurations."""
        return np.asarray(self.known.all(axis=1))


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
    kernel's numbers come from, the posterior must not be too narrow. ``d`` (M,) is the readings
    less their predictions [-], ``weighted`` (M,) is K⁻¹ d.
    """
    return max(1.0, float((s.firmness + d @ weighted) / (s.firmness + len(d))))


class Posterior:
    """Normal distribution of |τ|/|τ_base| of every setting of a joint, after some readings."""

    def __init__(self, candidates: Candidates, readings: Readings, settings: RobotSettings) -> None:
        """Take all readings but the failed ones; without any it is the prior."""
        self.candidates, self.readings, self.settings = candidates, readings, settings
        s, at, m = settings, readings.cell, candidates.predicted.ravel()
        prior = prior_covariance(candidates, s)
        mean, covariance = m, prior
        if len(at):
            d = readings.ratio - m[at]
            factor = cho_factor(prior[np.ix_(at, at)] + s.noise**2 * np.eye(len(at)), lower=True)
            weighted = cho_solve(factor, d)
            mean = m + prior[:, at] @ weighted
            covariance = prior - prior[:, at] @ cho_solve(factor, prior[at])
            covariance = covariance * widening(d, weighted, s)
        cells = (len(candidates), 4)
        self.cell_mean: Array = mean.reshape(cells)
        """(S, 4) mean of each configuration [-]."""
        self.mean: Array = self.cell_mean.mean(axis=1)
        """(S,) mean over the four configurations [-]."""
        self.covariance: Array = covariance.reshape(*cells, *cells).mean(axis=(1, 3))
        """(S, S) covariance of these means [-]."""

    @property
    def sd(self) -> Array:
        """(S,) standard deviation of the mean over the four configurations [-]."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def best(self) -> int | None:
        """Setting of the lowest mean among the eligible ones measured in all four configurations.

        None if no eligible setting was.
        """
        measured = np.flatnonzero(self.readings.measured & self.candidates.eligible)
        return int(measured[self.mean[measured].argmin()]) if len(measured) else None

    @property
    def chosen(self) -> int:
        """The best measured setting, or else the best predicted one."""
        mean = np.where(self.candidates.eligible, self.mean, np.inf)
        return int(mean.argmin()) if self.best is None else self.best

    @property
    def open(self) -> Bools:
        """(S,) whether a setting may be proposed: not fully measured, and nothing failed."""
        r = self.readings
        return np.asarray(self.candidates.eligible & ~r.tried.all(axis=1) & ~r.failed)

    def advantage(self, best: int) -> tuple[Array, Array]:
        """Return (S,) mean and standard deviation of how much lower each is than ``best`` [-].

        Errors that both share cancel, so the difference of two neighbouring settings is well known.
        """
        k = self.covariance
        variance = np.diag(k) + k[best, best] - 2 * k[best]
        return self.mean[best] - self.mean, np.sqrt(np.maximum(variance, 0.0))

    @property
    def expected_improvement(self) -> Array:
        """(S,) expected reduction of |τ|/|τ_base| below that of the best measured setting [-].

        Without a best one so far, it is the predicted effect: the lowest mean comes first.
        """
        if self.best is None:
            return 1.0 + self.mean.max() - self.mean
        mean, sd = self.advantage(self.best)
        z = mean / np.maximum(sd, 1e-12)
        return np.asarray(mean * ndtr(z) + sd * np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi))

    def next_settings(self, count: int) -> list[int]:
        """Return up to ``count`` settings to measure next, the most promising first.

        A setting that was measured in some configurations may be among them, for the others. The
        list is shorter, or empty, when every setting was measured.
        """
        chosen, believed = list[int](), self
        while len(chosen) < count and believed.open.any():
            gain = np.where(believed.open, believed.expected_improvement, -np.inf)
            setting = int(gain.argmax())
            chosen.append(setting)
            missing = np.flatnonzero(~believed.readings.tried[setting])
            cells = [(setting, int(c), float(believed.cell_mean[setting, c])) for c in missing]
            readings = believed.readings.with_rows(cells)
            believed = Posterior(self.candidates, readings, self.settings)
        return chosen

    @cached_property
    def chance_of_better(self) -> float:
        """Probability that any untried setting beats the best one by more than the tolerance [-].

        The probability is for all untried settings together, estimated from draws: 1 where none was
        fully measured, 0 where none is left.
        """
        s, free, best = self.settings, np.flatnonzero(self.open), self.best
        if not len(free) or best is None:
            return float(len(free) > 0)
        at = np.append(free, best)
        values, vectors = np.linalg.eigh(self.covariance[np.ix_(at, at)])
        normal = np.random.default_rng(s.seed).standard_normal((s.draws, len(at)))
        drawn = self.mean[at] + normal @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
        better = drawn[:, -1] - drawn[:, :-1].min(axis=1) > s.tolerance
        return float(better.mean())

    @property
    def may_stop(self) -> bool:
        """True if no untried setting is likely to be better."""
        return self.chance_of_better < 1.0 - self.settings.confidence
