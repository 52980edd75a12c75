"""Which causes: forward and backward, by the error of blocks that were held out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from stiction_envs.gap.angle_ranges import holds_over_angle, simpler_by_angle
from stiction_envs.gap.candidates import ARM, Candidate, RegressorLibrary
from stiction_envs.gap.causes import Shape
from stiction_envs.gap.slope import slope as _slope

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Gain:
    """What some terms do to the held-out error of a model."""

    less: Array
    """(joints, B) squared error taken away, in units of noise variance."""
    significant_joints: NDArray[np.bool_]
    """(joints,) where what the terms predict comes true, and is large enough to matter."""
    as_a_whole: bool
    """Whether it does so over all joints together, and takes away more than it adds on others."""

    @property
    def total(self) -> float:
        """Squared error taken away, in units of noise variance."""
        return float(self.less.sum())

    @property
    def significant(self) -> bool:
        """Whether it is real, held against the noise from block to block."""
        return self.total > 0 and self.as_a_whole and bool(self.significant_joints.any())


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
    left = grams.held_out(rest)
    less = left - grams.held_out(model)
    if less.sum() <= 0:  # it is not real then, whatever else may be
        return Gain(less, np.zeros(len(less), dtype=bool), False)
    pe, pp = grams.cross_predicted(model, rest, library.own(terms, added))
    strict, single = (
        _quantile(1 - s.chance / tried, grams.blocks - 1)
        for tried in (max(len(library.candidates), 1), 1)
    )
    part = less.sum(axis=1) / np.maximum(left.sum(axis=1), 1e-300)
    limit = np.where(part > s.clear, single, strict)
    whole = _slope(pe.sum(axis=0), pp.sum(axis=0)) > limit.min()
    each = np.array([_slope(*x) > y for x, y in zip(zip(pe, pp, strict=True), limit, strict=True)])
    approximate = [t for t in terms if library.causes[t.cause].approximate and t not in added]
    size, others = grams.gained(model, rest), grams.sizes(model, library.own(terms, approximate))
    share = 0.0 if all(library.causes[t.cause].base_friction for t in added) else s.refinement
    least = np.maximum(s.least_torque, np.maximum(share * others, library.known))
    # noise of the acceleration is in columns as well as in residuals, and explains itself
    count = np.array([g.count.sum() for g in grams.joints])
    large = (size > least) & (left.sum(axis=1) > (1 + s.least_torque**2) * count)
    # log-likelihood of joints each of which has noise of its own, at least the floor
    better = np.log((left.sum(axis=1) + count) / ((left - less).sum(axis=1) + count))
    whole = whole and float(better.sum()) > 0
    return Gain(less, each & large & (less.sum(axis=1) > 0), whole)


@cache
def _quantile(part: float, freedom: int) -> float:
    """Return a quantile of Student's t."""
    return float(student.ppf(part, freedom))


def means_nothing(
    library: RegressorLibrary, terms: Sequence[Candidate], added: Sequence[Candidate]
) -> bool:
    """Whether a value is so small, or so far out, that its cause means nothing.

    Or only repeats angles that were seen, where its cause is one to be judged by others.
    """
    c = library.split(terms, library.grams.fit(library.model_columns(terms)))
    for term, mine in zip(terms, c, strict=True):
        cause = library.causes[term.cause]
        if term in added and (
            cause.negligible(mine, term.shape)
            or cause.on_bound(mine, library.data, term.joint)
            or cause.at_edge(term.shape, library.tried(term), library.data.settings.candidates.edge)
            or (cause.judged_by_angle and not holds_over_angle(library, terms, term))
        ):
            return True
    return False


def pruned(library: RegressorLibrary, terms: Sequence[Candidate]) -> list[Candidate]:
    """Return terms without those that are not significant, of which the weakest goes first."""
    out = list(terms)
    while out:
        weakest: tuple[float, Candidate] | None = None
        for term in out:
            found = gain(library, out, [term])
            significant = found.significant and not means_nothing(library, out, [term])
            if not library.causes[term.cause].standalone:
                have = {t.cause for t in out if t.joint == term.joint}
                significant &= have.issuperset(library.needs(term.cause))
            if not significant and (weakest is None or found.total < weakest[0]):
                weakest = (found.total, term)
        if weakest is None:
            break
        out = [t for t in out if t != weakest[1]]
    return out


@dataclass(frozen=True, eq=False)
class Offer:
    """Terms that could be added."""

    added: list[Candidate]
    found: Gain


class Chooser:
    """Builds a model term by term."""

    def __init__(
        self,
        library: RegressorLibrary,
        progress: Callable[[int], None] | None = None,
        start: Sequence[Candidate] = (),
        without: Sequence[Candidate] = (),
    ) -> None:
        """Begin with some terms; causes of ``without`` are not tried on their joints again."""
        self.library = library
        self._settings = library.data.settings.selection
        self._progress = progress or (lambda _: None)
        self.terms = list(start)
        self._without = {(t.cause, t.joint) for t in without}

    def choose(self) -> list[Candidate]:
        """Return the significant terms, in the order in which they were found."""
        before: list[Candidate] | None = None
        for _ in range(self._settings.rounds):
            self._add()
            self.terms = pruned(self.library, self.terms)
            # what was taken out may have kept out something better
            if before is not None and set(before) == set(self.terms):
                break
            before = list(self.terms)
        return self.terms

    def _add(self) -> None:
        """Add what is significant, the best first."""
        known: dict[int, list[Offer]] = {}
        for step in range(self._settings.most_terms):
            for joint in [ARM, *range(self.library.data.n)]:
                if joint not in known:
                    known[joint] = self._significant(joint)
            best = self._simplest(self._leading([x for y in known.values() for x in y]))
            if best is None:
                best = self._simplest([x for j in range(self.library.data.n) for x in self._two(j)])
            if best is None:
                return
            self.terms += best.added
            joint = best.added[-1].joint
            if len(self.library.affected_joints(best.added[-1])) > 1:
                known.clear()
            else:
                known.pop(joint, None)
                known.pop(ARM, None)
            self._progress(step + 1)

    def _leading(self, offers: list[Offer]) -> list[Offer]:
        """Return the offers among which to choose: all of one joint, or of the whole arm.

        A cause of single joints may be at work on all of them, so that it is by the sum over
        joints that it is held against causes of the whole arm.
        """
        each: dict[tuple[str, int], float] = {}
        for x in offers:
            key = x.added[-1].cause, x.added[-1].joint
            each[key] = max(each.get(key, 0.0), x.found.total)
        total: dict[str, float] = {}
        for (cause, _), size in each.items():
            if self.library.causes[cause].coupled:  # one of them acts on all joints by itself
                total[cause] = max(total.get(cause, 0.0), size)
            else:
                total[cause] = total.get(cause, 0.0) + size
        arm = [x for x in offers if x.added[-1].joint == ARM]
        if not arm:
            return offers
        most = max(x.found.total for x in arm)
        better = [x for x in offers if x not in arm and total[x.added[-1].cause] > most]
        return better or offers

    def _simplest(self, offers: list[Offer]) -> Offer | None:
        """Return the best offer, or one with fewer parameters that is as good."""
        if not offers:
            return None
        best = max(offers, key=lambda x: x.found.total)
        size, s = self.library.complexity, self._settings
        for other in sorted(offers, key=lambda x: (size(x.added), -x.found.total)):
            if size(other.added) >= size(best.added):
                break
            if simpler_by_angle(self.library, best.added[-1], other.added[-1]):
                continue  # ranges of angle have refuted it already
            each = (best.found.less - other.found.less).sum(axis=0)
            error = float(each.std(ddof=1) * np.sqrt(len(each)))
            lost = float(each.sum())
            if lost < s.as_good * best.found.total or (
                lost < s.as_good_errors * error and (lost < 5 * s.as_good * best.found.total)
            ):
                return other
        return best

    def _significant(self, joint: int) -> list[Offer]:
        """Return what is significant on a joint, by held-out error."""
        out = []
        for _, added in self._offers(joint):
            terms = [*self.terms, *added]
            found = gain(self.library, terms, added)
            if not found.significant:
                continue
            *parents, child = added
            if parents and not gain(self.library, terms, parents).significant:
                # what it usually comes with is not there
                if not self.library.causes[child.cause].standalone:
                    continue
                added, terms = [child], [*self.terms, child]
                found = gain(self.library, terms, added)
            if (
                not means_nothing(self.library, terms, added)
                and gain(self.library, terms, [child]).significant
            ):
                out.append(Offer(added, found))
        return out

    def _two(self, joint: int) -> list[Offer]:
        """Return pairs of causes on a joint that are significant together, and not separately.

        Each by itself leaves the other's torque as noise that is not noise.
        """
        lib = self.library
        errors = lib.grams.held_out(lib.model_columns(self.terms))[joint].sum()
        if errors < self._settings.pair_error**2 * lib.grams.joints[joint].count.sum():
            return []
        out = []
        for (_, one), (_, two) in combinations(self._offers(joint), 2):
            if one[-1].cause == two[-1].cause:
                continue
            added = list(dict.fromkeys([*one, *two]))
            terms = [*self.terms, *added]
            found = gain(lib, terms, added)
            separately = (found.significant and gain(lib, terms, [x]).significant for x in added)
            if all(separately) and not means_nothing(lib, terms, added):
                out.append(Offer(added, found))
        return out

    def _offers(self, joint: int) -> list[tuple[float, list[Candidate]]]:
        """Return the best term of each cause on a joint by its in-sample gain, best first.

        All terms of causes whose nonlinear parameters predict differently from step to step: the
        best in the sample is then often not the one that predicts.
        """
        lib = self.library
        have = {(t.cause, t.joint) for t in self.terms}
        barred = have | self._without

        def loss(terms: list[Candidate], joints: list[int]) -> float:
            return float(lib.grams.errors(lib.model_columns(terms))[joints].sum())

        everywhere = list(range(lib.data.n))
        here = [t for t in self.terms if joint in lib.affected_joints(t)]
        now = {1: loss(here, [joint]) if joint != ARM else 0.0}
        now[lib.data.n] = loss(self.terms, everywhere)
        best: dict[tuple[str, Shape], tuple[float, list[Candidate]]] = {}
        for term in lib.candidates:
            if term.joint != joint or (term.cause, joint) in barred:
                continue
            parents = [
                t
                for name in lib.needs(term.cause)
                for t in lib.candidates
                if (t.cause, t.joint) == (name, joint) and (name, joint) not in have
            ]
            joints = lib.affected_joints(term)
            others = here if len(joints) == 1 else self.terms
            added = [*parents, term]
            value = now[len(joints)] - loss([*others, *added], joints)
            key = (term.cause, term.shape if lib.causes[term.cause].multimodal else ())
            if value > best.get(key, (0.0, []))[0]:
                best[key] = (value, added)
        ranked = sorted(best.values(), key=lambda x: -x[0])
        short = list(dict.fromkeys(added[-1].cause for _, added in ranked))[
            : self._settings.shortlist
        ]
        return [x for x in ranked if x[1][-1].cause in short]
