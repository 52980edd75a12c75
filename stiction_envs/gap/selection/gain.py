"""Judge terms of a model by the error of held-out blocks, and by the likelihood."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, wraps
from typing import NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from stiction_envs.gap.linear.grams import t_statistic
from stiction_envs.gap.selection.angle_ranges import holds_over_angle
from stiction_envs.gap.selection.candidates import Candidate, RegressorLibrary

Array = NDArray[np.float64]
Judge = TypeVar("Judge", bound=Callable[..., object])
DISTINCT = 3.0
"""Least size of a body's number over its standard error [-]; assumed: rarely by chance."""


@dataclass(frozen=True, eq=False)
class Gain:
    """The effect of some terms on the held-out error of a model."""

    less: Array
    """(joints, B) reduction of squared error, in units of noise variance."""
    significant_joints: NDArray[np.bool_]
    """(joints,) where the terms predict the residual, and are large enough to matter."""
    as_a_whole: bool
    """Whether they do so over all joints together, and reduce the error more than they add."""
    stands_out: bool | None = None
    """Whether a body is likely beside small errors of all links, which can predict the same; None
    for what these cannot imitate, or where there are none."""

    @property
    def total(self) -> float:
        """Reduction of squared error, in units of noise variance."""
        return float(self.less.sum())

    @property
    def significant(self) -> bool:
        """Whether the reduction is significant, given the variation between blocks."""
        if self.stands_out is not None:
            return self.stands_out
        return self.total > 0 and self.as_a_whole and bool(self.significant_joints.any())


def _once(judge: Judge) -> Judge:
    """Keep what is found of terms of a model beside the sums: a search asks again and again."""

    @wraps(judge)
    def known(
        library: RegressorLibrary, terms: Sequence[Candidate], added: Sequence[Candidate]
    ) -> object:
        key = judge.__name__, tuple(terms), tuple(added)
        if key not in library.grams.gains:
            library.grams.gains[key] = judge(library, terms, added)
        return library.grams.gains[key]

    return cast(Judge, known)


@_once
def gain(library: RegressorLibrary, terms: Sequence[Candidate], added: Sequence[Candidate]) -> Gain:
    """Judge terms of a model by blocks that were held out.

    On each block they predict a torque p beyond that of the model without them, both fitted to
    the other blocks. Against what the smaller one leaves there, e, its slope a = Σpᵀe/Σpᵀp is one
    where they are real and zero where not, however much blocks differ in size. Its standard error
    is that between blocks, √(Σ(pᵀe − a pᵀp)²·B/(B − 1))/Σpᵀp (Liang and Zeger, "Longitudinal data
    analysis using generalized linear models", 1986), and follows Student's t of B − 1 degrees of
    freedom; ``chance`` is shared out over all terms that are tried (Bonferroni).
    """
    s, grams, model = library.data.settings.selection, library.grams, library.model_columns(terms)
    rest = library.model_columns([t for t in terms if t not in added])
    large, likely, out = _in_sample(library, terms, added)
    left = grams.held_out(rest)
    less = left - grams.held_out(model)
    if out is not None:
        return Gain(less, large, True, out)
    large = large & (less.sum(axis=1) > 0)
    if not (likely and large.any() and less.sum() > 0):
        return Gain(less, large, False)
    pe, pp = grams.cross_predicted(model, rest, library.own(terms, added))
    strict, single = (
        _quantile(1 - s.chance / tried, grams.blocks - 1)
        for tried in (max(len(library.candidates), 1), 1)
    )
    part = less.sum(axis=1) / np.maximum(left.sum(axis=1), 1e-300)
    limit = np.where(part > s.clear, single, strict)
    whole = bool(t_statistic(pe.sum(axis=0), pp.sum(axis=0)) > limit.min())
    each = t_statistic(pe.T, pp.T) > limit
    # log-likelihood of joints with separate noise, at least the floor
    count = grams.counts
    better = np.log((left.sum(axis=1) + count) / ((left - less).sum(axis=1) + count))
    return Gain(less, each & large, whole and float(better.sum()) > 0)


def is_significant(
    library: RegressorLibrary, terms: Sequence[Candidate], added: Sequence[Candidate]
) -> bool:
    """Return `Gain.significant`; what the fit to all blocks refutes is not fitted without each."""
    return _in_sample(library, terms, added).possible and gain(library, terms, added).significant


class InSample(NamedTuple):
    """What the fit to all blocks says of some terms."""

    large: NDArray[np.bool_]
    """(joints,) where they are large enough to matter."""
    likely: bool
    """Whether they make the logs likelier, where there are random effects."""
    stands_out: bool | None
    """As of `Gain`."""

    @property
    def possible(self) -> bool:
        """Whether they may be significant."""
        return self.likely and bool(self.large.any())


@_once
def _in_sample(
    library: RegressorLibrary, terms: Sequence[Candidate], added: Sequence[Candidate]
) -> InSample:
    s, grams, model = library.data.settings.selection, library.grams, library.model_columns(terms)
    if library.scale > 0 and any(library.causes[t.cause].changes_arm for t in added):
        large, out = stands_out(library, terms, added)
        if not out or any(library.causes[t.cause].body for t in added):
            return InSample(large, out, out)
    rest = library.model_columns([t for t in terms if t not in added])
    approximate = [t for t in terms if library.causes[t.cause].approximate and t not in added]
    rough = grams.sizes(model, library.own(terms, approximate))
    size = grams.gained(model, rest)
    if library.scale > 0 and library.settled:
        # without the terms, small errors of links would make up for most of their torque
        size = np.maximum(size, grams.sizes(model, library.own(terms, added)))
    share = 0.0 if all(library.causes[t.cause].base_friction for t in added) else s.refinement
    least = np.maximum(s.least_torque, np.maximum(share * rough, library.known))
    # columns contain acceleration noise as residuals do, so that it would explain itself
    left = grams.held_out(rest).sum(axis=1)
    large = (size > least) & (left > (1 + s.least_torque**2) * grams.counts)
    likely = True
    if library.scale > 0 and large.any():
        # beside random effects a held-out gain may be theirs: the likelihood must agree
        more = grams.log_evidence(model) - grams.log_evidence(rest)
        likely = more > np.log(max(len(library.candidates), 1))
    return InSample(large, likely, None)


def stands_out(
    library: RegressorLibrary, terms: Sequence[Candidate], added: Sequence[Candidate]
) -> tuple[NDArray[np.bool_], bool]:
    """Return where bodies of a model are large, and whether they stand out of all links' errors.

    They must make the logs likelier by `least_evidence`, the size of the small errors being chosen
    anew with and without them, and one of their `distinctive` numbers be `DISTINCT` standard errors
    from zero.
    """
    grams, model = library.grams, library.model_columns(terms)
    large = grams.sizes(model, library.own(terms, added)) > (
        library.data.settings.selection.least_torque
    )
    z = np.abs(grams.fit(model)) / np.sqrt(np.diag(grams.covariance(model)))
    clear = all(
        float(mine[: library.causes[t.cause].distinctive].max()) > DISTINCT
        for t, mine in zip(terms, library.split(terms, z), strict=True)
        if t in added and library.causes[t.cause].changes_arm
    )
    if not (clear and large.any()):
        return large, False
    least = max(library.causes[t.cause].least_evidence for t in added)
    others = [t for t in terms if t not in added]
    more = library.likeliest(terms)[0] - library.likeliest(others)[0]
    return large, more > least


@cache
def _quantile(part: float, freedom: int) -> float:
    """Return a quantile of Student's t."""
    return float(student.ppf(part, freedom))


def is_implausible(
    library: RegressorLibrary, terms: Sequence[Candidate], added: Sequence[Candidate]
) -> bool:
    """Whether a value is too small, or too far out, for its cause to be meaningful.

    It is also not meaningful if it only repeats known angles and left-out ranges must confirm it.
    """
    for term, mine in zip(terms, library.fitted(terms), strict=True):
        cause = library.causes[term.cause]
        if term in added and (
            cause.negligible(mine, term.shape)
            or cause.on_bound(mine, library.data, term.joint)
            or cause.at_edge(term.shape, library.tried(term), library.data.settings.candidates.edge)
            or (cause.simpler_over_angle and not holds_over_angle(library, terms, term))
        ):
            return True
    return False


def pruned(library: RegressorLibrary, terms: Sequence[Candidate]) -> list[Candidate]:
    """Return the terms after the removal of insignificant ones, the weakest first."""
    out = list(terms)
    while out:
        weakest: tuple[float, Candidate] | None = None
        for term in (t for t in out if not t.small):
            found = gain(library, out, [term])
            significant = found.significant and not is_implausible(library, out, [term])
            if not library.causes[term.cause].standalone:
                have = {t.cause for t in out if t.joint == term.joint}
                significant &= have.issuperset(library.needs(term.cause))
            if not significant and (weakest is None or found.total < weakest[0]):
                weakest = (found.total, term)
        if weakest is None:
            break
        out = [t for t in out if t != weakest[1]]
    return out
