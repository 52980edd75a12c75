"""Choose causes forward and backward, by the error of held-out blocks.

Terms are added one at a time, so many small ones may be found before the one cause of the whole arm
that explains them all. Models as a whole are therefore compared too, by their description length

    L = ½ Σ_j N_j log(1 + e_j) + ½ k log N

with the held-out squared error e_j of joint j in units of its noise, N_j independent observations
of it, and k parameters (J. Rissanen, "Modeling by shortest data description", 1978).
"""

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
from stiction_envs.gap.causes.log.actuator_delay import ActuatorDelay
from stiction_envs.gap.normal_equations import t_statistic

Array = NDArray[np.float64]
ROUNDS = 3
"""Largest number of rounds of adding and removing; assumed."""
DISTINCT = 3.0
"""Least size of a body's number over its standard error [-]; assumed: rarely by chance."""
MOST_TERMS = 40
"""Largest number of terms that are added in a round; assumed."""


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


def gain(library: RegressorLibrary, terms: Sequence[Candidate], added: Sequence[Candidate]) -> Gain:
    """Judge terms of a model by blocks that were held out.

    On each block they predict a torque p beyond that of the model without them, both fitted to
    the other blocks. Against what the smaller one leaves there, e, its slope a = Σpᵀe/Σpᵀp is one
    where they are real and zero where not, however much blocks differ in size. Its standard error
    is that between blocks, √(Σ(pᵀe − a pᵀp)²·B/(B − 1))/Σpᵀp (Liang and Zeger, "Longitudinal data
    analysis using generalized linear models", 1986), and follows Student's t of B − 1 degrees of
    freedom; ``chance`` is shared out over all terms that are tried (Bonferroni).
    """
    key = tuple(terms), tuple(added)
    if key not in library.grams.gains:
        library.grams.gains[key] = _gain(library, terms, added)
    found: Gain = library.grams.gains[key]
    return found


def _gain(
    library: RegressorLibrary, terms: Sequence[Candidate], added: Sequence[Candidate]
) -> Gain:
    s, grams, model = library.data.settings.selection, library.grams, library.model_columns(terms)
    others = [t for t in terms if t not in added]
    rest = library.model_columns(others)
    left = grams.held_out(rest)
    less = left - grams.held_out(model)
    if library.scale > 0 and any(library.causes[t.cause].changes_arm for t in added):
        found = Gain(less, *stands_out(library, terms, added))
        if not found.stands_out or any(library.causes[t.cause].body for t in added):
            return found
    if less.sum() <= 0:  # it is not real then, whatever else may be
        return Gain(less, np.zeros(len(less), dtype=bool), False)
    pe, pp = grams.cross_predicted(model, rest, library.own(terms, added))
    strict, single = (
        _quantile(1 - s.chance / tried, grams.blocks - 1)
        for tried in (max(len(library.candidates), 1), 1)
    )
    part = less.sum(axis=1) / np.maximum(left.sum(axis=1), 1e-300)
    limit = np.where(part > s.clear, single, strict)
    whole = t_statistic(pe.sum(axis=0), pp.sum(axis=0)) > limit.min()
    each = np.array(
        [t_statistic(*x) > y for x, y in zip(zip(pe, pp, strict=True), limit, strict=True)]
    )
    approximate = [t for t in terms if library.causes[t.cause].approximate and t not in added]
    size, rough = grams.gained(model, rest), grams.sizes(model, library.own(terms, approximate))
    share = 0.0 if all(library.causes[t.cause].base_friction for t in added) else s.refinement
    least = np.maximum(s.least_torque, np.maximum(share * rough, library.known))
    # columns contain acceleration noise as residuals do, so that it would explain itself
    count = grams.counts
    large = (size > least) & (left.sum(axis=1) > (1 + s.least_torque**2) * count)
    # log-likelihood of joints with separate noise, at least the floor
    better = np.log((left.sum(axis=1) + count) / ((left - less).sum(axis=1) + count))
    whole = whole and float(better.sum()) > 0
    joints = each & large & (less.sum(axis=1) > 0)
    if library.scale > 0 and whole and joints.any():
        # beside random effects a held-out gain may be theirs: the likelihood must agree
        more = grams.log_evidence(model) - grams.log_evidence(rest)
        whole = more > np.log(max(len(library.candidates), 1))
    return Gain(less, joints, whole)


def stands_out(
    library: RegressorLibrary, terms: Sequence[Candidate], added: Sequence[Candidate]
) -> tuple[NDArray[np.bool_], bool, bool]:
    """Return whether bodies of a model stand out of small errors of all links, as `Gain` has it.

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
        return large, True, False
    least = max(library.causes[t.cause].least_evidence for t in added)
    others = [t for t in terms if t not in added]
    more = library.likeliest(terms)[0] - library.likeliest(others)[0]
    return large, True, more > least


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


@dataclass(frozen=True, eq=False)
class Offer:
    """Terms that may be added."""

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
        """Start with some terms; causes of ``without`` are not tried again on their joints."""
        self.library = library
        self._settings = library.data.settings.selection
        self._progress = progress or (lambda _: None)
        self.terms = library.beside(start)
        self._without = {(t.cause, t.joint) for t in without}

    def choose(self) -> list[Candidate]:
        """Return the significant terms, in the order in which they were found."""
        before: list[Candidate] | None = None
        for _ in range(ROUNDS):
            self._add()
            self.terms = pruned(self.library, self.terms)
            # a removed term may have kept out a better one
            if before is not None and set(before) == set(self.terms):
                break
            before = list(self.terms)
        return self.terms

    def _add(self) -> None:
        """Add significant terms, the best first."""
        known: dict[int, list[Offer]] = {}
        for step in range(MOST_TERMS):
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
        """Return the offers to choose from: all of one joint, or of the whole arm.

        A cause of single joints may act on all of them, so its sum over joints is compared with
        causes of the whole arm.
        """
        each: dict[tuple[str, int], float] = {}
        for x in offers:
            key = x.added[-1].cause, x.added[-1].joint
            each[key] = max(each.get(key, 0.0), x.found.total)
        total: dict[str, float] = {}
        for (cause, _), size in each.items():
            if self.library.causes[cause].coupled:  # one term acts on all joints
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
        """Return the best offer, or an equally good one with fewer parameters."""
        if not offers:
            return None
        best = max(offers, key=lambda x: x.found.total)
        size, s = self.library.complexity, self._settings
        for other in sorted(offers, key=lambda x: (size(x.added), -x.found.total)):
            if size(other.added) >= size(best.added):
                break
            if simpler_by_angle(self.library, best.added[-1], other.added[-1]):
                continue  # ranges of the angle have refuted it already
            each = (best.found.less - other.found.less).sum(axis=0)
            error = float(each.std(ddof=1) * np.sqrt(len(each)))
            lost = float(each.sum())
            if lost < s.as_good * best.found.total or (
                lost < s.as_good_errors * error and (lost < 5 * s.as_good * best.found.total)
            ):
                return other
        return best

    def _significant(self, joint: int) -> list[Offer]:
        """Return the significant terms on a joint, by held-out error."""
        out = []
        for added in self._offers(joint, self._least_reduction(joint)):
            terms = [*self.terms, *added]
            found = gain(self.library, terms, added)
            if not found.significant:
                continue
            *parents, child = added
            if parents and not gain(self.library, terms, parents).significant:
                # the cause that it usually needs is absent
                if not self.library.causes[child.cause].standalone:
                    continue
                added, terms = [child], [*self.terms, child]
                found = gain(self.library, terms, added)
            if (
                not is_implausible(self.library, terms, added)
                and gain(self.library, terms, [child]).significant
            ):
                out.append(Offer(added, found))
        return out

    def _two(self, joint: int) -> list[Offer]:
        """Return pairs of causes on a joint that are significant together, but not separately.

        Each one alone leaves the other's torque, which counts as noise.
        """
        lib = self.library
        errors = lib.grams.held_out(lib.model_columns(self.terms))[joint].sum()
        if errors < self._settings.pair_error**2 * lib.grams.counts[joint]:
            return []
        near, least = lib.grams.around(lib.model_columns(self.terms)), self._least_reduction(joint)
        out = []
        for one, two in combinations(self._offers(joint), 2):
            added = list(dict.fromkeys([*one, *two]))
            if one[-1].cause == two[-1].cause or near.reduction(lib.model_columns(added)) <= least:
                continue
            terms = [*self.terms, *added]
            found = gain(lib, terms, added)
            separately = (found.significant and gain(lib, terms, [x]).significant for x in added)
            if all(separately) and not is_implausible(lib, terms, added):
                out.append(Offer(added, found))
        return out

    def _offers(self, joint: int, least: float = 0.0) -> list[list[Candidate]]:
        """Return the best term of each cause on a joint by its in-sample gain, best first.

        Terms of single joints reduce the squared error by more than ``least``.

        It returns all terms of causes whose predictions differ strongly between neighbouring
        nonlinear parameters: the best in the sample is then often not the best predictor.
        """
        lib = self.library
        have = {(t.cause, t.joint) for t in self.terms}
        barred = have | self._without
        near = lib.grams.around(lib.model_columns(self.terms))
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
            added = [*parents, term]
            value = near.reduction(lib.model_columns(added))
            key = (term.cause, term.shape if lib.causes[term.cause].multimodal else ())
            wide = lib.causes[term.cause].changes_arm
            if value > best.get(key, (0.0 if wide else least, []))[0]:
                best[key] = (value, added)
        ranked = [added for _, added in sorted(best.values(), key=lambda x: -x[0])]
        causes = list(dict.fromkeys(added[-1].cause for added in ranked))
        return [x for x in ranked if x[-1].cause in causes[: self._settings.shortlist]]

    def _least_reduction(self, joint: int) -> float:
        """Return the reduction of squared error under which no term of a joint is significant.

        Beside small errors the likelihood must gain ln(number of candidates), of which half of the
        reduction is the most; else the torque must be large enough. Halved, since bounds may move.
        """
        lib = self.library
        if lib.scale > 0:
            return float(np.log(max(len(lib.candidates), 1)))
        torque = np.square(self._settings.least_torque) * lib.grams.counts / lib.grams.inflation
        return 0.5 * float(torque.min() if joint == ARM else torque[joint])


def with_or_without_random(
    library: RegressorLibrary,
    choose: Callable[[RegressorLibrary], list[Candidate]],
    refine: Callable[[RegressorLibrary, list[Candidate]], list[Candidate]],
) -> list[Candidate]:
    """Return the likelier model: a few bodies explain the arm, or small errors of all its links.

    The library keeps the noise and the size of the random effects under the one that is returned.
    Where a model without bodies leaves little, there is no question.

    Args:
        library: of the logs.
        choose: returns the significant terms.
        refine: returns terms with better nonlinear parameters.
    """
    if not library.random:
        return choose(library)
    if library.data.recording.link_factor is not None:
        # an earlier diagnosis says how well the links are known
        library.given(library.least_inflation, 1.0)
        dense = choose(library)
        library.given(library.noise_under(dense), 1.0)
        return dense
    usual = library.inflation
    # small errors of links would make up for what a first guess leaves
    sparse = prefer_joint_causes(library, refine(library, choose(library)))
    left = library.grams.held_out(library.model_columns(sparse)).sum(axis=1)
    most = float(np.sqrt(np.max(left / np.maximum(library.grams.counts, 1.0))))
    has_body = any(library.causes[t.cause].changes_arm for t in sparse)
    # a delay is exact only once it is applied to the whole model, and leaves more until then
    late = any(isinstance(library.causes[t.cause], ActuatorDelay) for t in sparse)
    if not has_body and (late or most < library.data.settings.verdict.close):
        return sparse
    of_sparse = library.noise_under(sparse)
    library.given(library.least_inflation, 1.0)
    dense = choose(library)
    library.given(np.minimum(of_sparse, library.noise_under(dense)), 1.0)
    (one, small), (other, scale) = library.likeliest(sparse), library.likeliest(dense)
    terms, size = (dense, scale) if other > one else (sparse, small)
    library.given(library.inflation if size else usual, size)
    return library.beside(terms)


def with_set_up(library: RegressorLibrary, terms: list[Candidate]) -> list[Candidate]:
    """Return a model with small errors of the set-up, where that makes the logs likelier.

    They are added once causes are known: in a search that begins with nothing they would take what
    belongs to causes that are not found yet. A cause that they make superfluous goes.
    """
    if library.scale == 0:
        return terms
    grams = library.grams

    def evidence(model: Sequence[Candidate]) -> float:
        return grams.log_evidence(library.model_columns(model))

    out, before = library.add_set_up(terms), evidence(terms)
    if evidence(out) <= before:
        return terms
    least = float(np.log(max(len(library.candidates), 1)))
    while True:
        known = evidence(out)
        each = {
            t: known - evidence([x for x in out if x != t])
            for t in out
            if not t.small and not library.causes[t.cause].changes_arm
        }
        weakest = min(each, key=lambda t: each[t], default=None)
        if weakest is None or each[weakest] > least:
            return out
        out = library.add_set_up([t for t in out if t != weakest])


def description_length(library: RegressorLibrary, terms: Sequence[Candidate]) -> float:
    """Return the description length of the logs' torque under a model [nats]."""
    grams = library.grams
    left = grams.held_out(library.model_columns(terms)).sum(axis=1)
    rows = np.maximum(grams.counts, 1.0)
    seen = rows / library.independent_rows
    fit = 0.5 * float(np.sum(seen * np.log1p(left / rows)))
    return fit + 0.5 * library.complexity(terms) * float(np.log(max(seen.sum(), 2.0)))


def prefer_arm_causes(library: RegressorLibrary, terms: Sequence[Candidate]) -> list[Candidate]:
    """Return a model in which causes of the whole arm replace terms that become unnecessary.

    Each cause that changes the arm (a payload, a tilt, a link) and is not in the model is added,
    and terms that are then no longer significant are removed. The shortest of these models is
    returned if it is shorter than the given one.
    """
    out, best = list(terms), description_length(library, terms)
    while True:
        have = {(t.cause, t.joint) for t in out}
        found: list[Candidate] | None = None
        for wide in library.candidates:
            if (wide.cause, wide.joint) in have or not library.causes[wide.cause].changes_arm:
                continue
            model = [*out, wide]
            if (
                is_implausible(library, model, [wide])
                or not gain(library, model, [wide]).significant
            ):
                continue
            model = pruned(library, model)
            length = description_length(library, model)
            if len(model) <= len(out) and wide in model and length < best:
                found, best = model, length
        if found is None:
            return out
        out = found


def prefer_joint_causes(library: RegressorLibrary, terms: Sequence[Candidate]) -> list[Candidate]:
    """Return a model in which one cause on all joints replaces bodies, if it is shorter.

    Torque sensors that all show a fifth too little look like links that are all a fifth lighter,
    and a body is found before the last of them.
    """
    out, best = list(terms), description_length(library, terms)
    named = [t for t in terms if not t.small]
    rest = [t for t in named if not library.causes[t.cause].changes_arm]
    have = {(t.cause, t.joint) for t in rest}
    for cause in library.causes.values():
        if len(rest) == len(named) or cause.coupled or cause.arm_wide or not cause.is_linear:
            continue
        more = [t for t in library.candidates if t.cause == cause.name]
        model = library.beside([*rest, *(t for t in more if (t.cause, t.joint) not in have)])
        if description_length(library, model) < best:
            model = pruned(library, model)
            if (length := description_length(library, model)) < best:
                out, best = model, length
    return out
