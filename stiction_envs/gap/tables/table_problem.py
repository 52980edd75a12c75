"""Linear models of torque tables, with errors as large as makes each of them most likely.

A channel is a joint's readings over the nominal friction. Their errors have two parts: scatter from
reading to reading, and what no model has, common to the readings of one dither frequency and scale.
Their sizes are those of greatest evidence among some, each with its prior: a model that leaves much
has large errors, and pays for that. A joint has few readings, so sizes are chosen anew for every
model that is compared.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stiction_envs.arrays import Array, Index
from stiction_envs.gap.judge.problem import Channel, Problem, Term

SCATTER = 0.01
"""Usual scatter of a reading over friction [-]; assumed: mean of four iterations with
2 % scatter."""
SPREAD = 0.7
"""Prior size of the logarithm of the scatter over the usual one [-]; assumed."""
COMMON = 1.0
"""Prior mean of the common error over the usual scatter (exponential) [-]; assumed."""
_SCATTERS, _COMMONS = np.sqrt(2.0) ** np.arange(-3, 9), np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0])
"""Scatters and common errors to try, over the usual scatter [-]; assumed."""
SIZES = np.array([(s, c) for s in _SCATTERS for c in _COMMONS])
"""(G, 2) scatter and common error [-]."""
PRIOR = -0.5 * (np.log(SIZES[:, 0]) / SPREAD) ** 2 - SIZES[:, 1] / COMMON
VARIANCE, SHARED = np.square(SCATTER * SIZES).T[:, :, None]


class Cells(Channel):
    """The readings of a joint; each fold but the first, of base torques, has a common error."""

    def __init__(self, residual: Array, fold: Index, folds: int) -> None:
        """Start without columns, as `Channel` does."""
        super().__init__(residual, fold, folds)
        # base torques have no common error: a common change of them is a change of level
        count = np.where(np.arange(folds) > 0, self.count, 0.0)
        each = len(residual) * np.log(VARIANCE[:, 0])
        self.volume = PRIOR - 0.5 * (each + np.log1p(count * SHARED / VARIANCE).sum(axis=1))
        """(G,) log evidence without the misfit [nats]."""
        # the inverse of the covariance within a fold (Sherman, Morrison)
        self._share = SHARED / (VARIANCE + count * SHARED) * (count > 0)
        self._normal: dict[int, Array] = {}

    def normal(self, held_out: int) -> Array:
        """Return (G, P + 1, P + 1) normal equations of columns and residual for each size."""
        if held_out not in self._normal:
            xx, xr, rr = self.sums(held_out)
            whole = np.block([[xx, xr[:, None]], [xr[None], np.array([[rr]])]])
            y = np.vstack([*self._blocks.values(), self.residual])
            total = np.stack([y[:, rows].sum(axis=1) for rows in self._rows])
            share = self._share * (np.arange(len(total)) != held_out)
            common = np.einsum("gf,fp,fq->gpq", share, total, total, optimize=True)
            self._normal[held_out] = (whole - common) / VARIANCE[:, :, None]
        return self._normal[held_out]


@dataclass(eq=False)
class TableProblem(Problem):
    """All terms of torque tables; a coefficient is in units of its prior size."""

    channels: list[Cells]  # type: ignore[assignment]
    sizes: tuple[int, ...] = ()
    """Numbers of each joint's sizes of the errors; () where each model has the likeliest."""
    _known: dict[tuple[int, tuple[int, ...]], Array] = field(default_factory=dict, init=False)

    def on(self, channels: Sequence[Cells], sizes: tuple[int, ...] = ()) -> "TableProblem":
        """Return the same terms on other channels."""
        return replace(self, channels=list(channels), sizes=sizes)

    def take(self, channels: Sequence[Cells]) -> None:
        """Take other columns of the same terms."""
        self.channels = list(channels)
        self._known.clear()
        self.given()

    def _own(self, k: int, terms: Sequence[Term]) -> tuple[Index, Index]:
        """Return which of a model's coefficients act on a channel, and their columns there."""
        at, known = self.at(terms), self.channels[k].at
        mine = np.flatnonzero(np.isin(at, known))
        return mine, np.searchsorted(known, at[mine])

    def likelihoods(self, k: int, terms: Sequence[Term]) -> Array:
        """Return (G,) log evidence of a joint's readings with terms, beside no other joint."""
        local = self._own(k, terms)[1]
        key = k, tuple(local.tolist())
        if key not in self._known:
            channel = self.channels[k]
            n = channel.normal(-1)
            m, b = np.eye(len(local)) + n[:, local[:, None], local], n[:, local, -1]
            solved = np.linalg.solve(m, b[..., None])[..., 0]
            misfit = n[:, -1, -1] - np.einsum("gi,gi->g", b, solved)
            self._known[key] = channel.volume - 0.5 * (misfit + np.linalg.slogdet(m)[1])
        return self._known[key]

    def likeliest(self, k: int, terms: Sequence[Term]) -> int:
        """Return the number of the likeliest sizes of a joint's errors."""
        return self.sizes[k] if self.sizes else int(self.likelihoods(k, terms).argmax())

    def _normal(self, k: int, terms: Sequence[Term]) -> Array:
        return self.channels[k].normal(self.held_out)[self.likeliest(k, terms)]

    def sums_of(self, terms: Sequence[Term]) -> tuple[Array, Array]:
        """Return XᵀWX (P, P) and XᵀWr (P,) of a model, with its likeliest errors."""
        p = len(self.at(terms))
        xx, xr = np.zeros((p, p)), np.zeros(p)
        for k in range(len(self.channels)):
            mine, local = self._own(k, terms)
            n = self._normal(k, terms)
            xx[np.ix_(mine, mine)] += n[np.ix_(local, local)]
            xr[mine] += n[local, -1]
        return xx, xr

    def misfit(self, terms: Sequence[Term]) -> float:
        """Return rᵀWr with the likeliest errors, less twice the log evidence of their sizes."""
        out = 0.0
        for k, channel in enumerate(self.channels):
            volume = channel.volume[self.likeliest(k, terms)]
            out += float(self._normal(k, terms)[-1, -1] - 2 * volume)
        return out

    def losses(self, named: Sequence[Term]) -> Array:
        """Return (K,) by how much the removal of each of K named terms would lower the score."""
        rest = [[x for x in named if x != t] for t in named]
        return self.score(named) - np.array([self.score(x) for x in rest])

    def gains(self, named: Sequence[Term], offers: Sequence[Sequence[Term]]) -> Array:
        """Return (K,) by how much each of K offers would raise the score."""
        now = self.score(named)
        return np.array([self.score([*named, *offer]) - now for offer in offers])

    def common_nats(self, k: int, named: Sequence[Term]) -> float:
        """Return the log evidence for a common error of a joint against none [nats]."""
        of = self.likelihoods(k, self.model(named))
        return float(of.max() - of[SIZES[:, 1] == 0].max())
