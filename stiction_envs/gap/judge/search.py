"""The search for the model with the most evidence: it adds, removes or swaps terms.

Every step changes the model by what raises its score most, and lets the noise be what the new model
leaves; the search ends when no step helps. It is greedy, so it starts from several models.
"""

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.gap.judge.problem import ARM, Term

NAMED = 3.0
"""Nats beyond its prior odds from which on a cause is named: 20 to 1."""
SHORTLIST = 12
"""Number of offers whose exact score is computed in each step [-]; the closed form ranks them."""
PER_CAUSE = 3
"""Number of nonlinear parameters and sizes of one cause on one joint among them [-]."""
SLACK = 1.0
"""Nats by which the closed form, which knows no bounds, may promise too little [-]; assumed."""
CLEAR = 15.0
"""Nats by the closed form from which on a term's removal is not tried [-]; assumed."""
MOST_STEPS = 80
"""Number of steps after which a search ends; assumed: a search of seven joints takes thirty."""


@dataclass(frozen=True, eq=False)
class Model:
    """Named terms, the size of the small errors, the noise, and the evidence of all of it."""

    terms: tuple[Term, ...]
    scales: tuple[float, float]
    """Sizes of the small errors over their tolerance, as of `Problem` [-]."""
    inflation: Array
    """(C,) as of `Problem`."""
    evidence: float
    """Log evidence and log prior odds [nats], comparable between models of the same rows."""

    @property
    def worth(self) -> float:
        """Evidence less what every name must bring [nats]."""
        return self.evidence - NAMED * len(self.terms)


class Scored(Protocol):
    """The evidence of any choice of terms: of columns (`Problem`), or of fits."""

    scales: tuple[float, float]
    inflation: Array

    def score(self, named: Sequence[Term]) -> float:
        """Return log evidence and log prior odds of a model [nats]."""

    def losses(self, named: Sequence[Term]) -> Array:
        """Return (K,) by how much the removal of each of K terms lowers the score, about."""

    def gains(self, named: Sequence[Term], offers: Sequence[Sequence[Term]]) -> Array:
        """Return (K,) by how much each of K sets of terms raises the score, about."""


P = TypeVar("P", bound=Scored)
Refresh = Callable[[P, Sequence[Term]], float]
"""Sets noise and size of the small errors of a problem by what a model leaves; returns the model's
evidence."""
Possible = Callable[[P, Sequence[Term], Sequence[Term]], list[bool]]
"""Whether the value of each of some terms in a model of a problem is one that its cause can have.
"""


class Search(Generic[P]):
    """Climbs from a model to a better one until no step helps."""

    def __init__(
        self,
        problem: P,
        candidates: Sequence[Term],
        needs: Callable[[str], Iterable[str]],
        refresh: Refresh[P],
        possible: Possible[P] = lambda _, __, asked: [True] * len(asked),
    ) -> None:
        """Search among candidates.

        Args:
            problem: their evidence.
            candidates: terms that can be named.
            needs: returns the causes that a cause's joint must have with it.
            refresh: of the noise.
            possible: of the values of terms; by default all are.
        """
        self.problem, self.candidates = problem, list(candidates)
        self.needs, self.refresh, self.possible = needs, refresh, possible
        plain = {t[:2]: t for t in reversed(self.candidates)}
        self._required = {
            t: [plain[k] for name in needs(t.cause) if (k := (name, t.joint)) in plain]
            for t in self.candidates
        }

    def climb(self, start: Sequence[Term], *, swaps: bool = True) -> Model:
        """Return the best model that steps from a start reach; ``swaps`` take most of the time."""
        terms, problem = list(start), self.problem
        evidence = self.refresh(problem, terms)
        for _ in range(MOST_STEPS):
            step = self._step(terms)
            if step is None and swaps:
                step = self._swapped(terms, problem.score(terms))
            if step is None:
                break
            terms = step
            evidence = self.refresh(problem, terms)
        return Model(tuple(terms), problem.scales, problem.inflation.copy(), evidence)

    def _step(self, terms: list[Term]) -> list[Term] | None:
        """Return the terms after the step that raises the score most; None where none does."""
        now = self.problem.score(terms)
        best, gain = None, 0.0
        for promise, added in self.offers(terms):
            if promise + SLACK - NAMED < gain:
                break
            more = self.problem.score([*terms, *added]) - now - NAMED
            if more > gain and self._possible([*terms, *added]):
                best, gain = [*terms, *added], more
        possible = self.possible(self.problem, terms, terms)
        for term, loss, keeps in zip(terms, self.problem.losses(terms), possible, strict=True):
            if loss > CLEAR and keeps:
                continue
            rest = self.without(terms, term)
            less = self.problem.score(rest) - now + NAMED * (len(terms) - len(rest))
            if less > gain or not keeps:
                best, gain = rest, less if keeps else np.inf
        return best

    def _possible(self, terms: Sequence[Term]) -> bool:
        """Return whether the last of some terms has a value that its cause can have."""
        return self.possible(self.problem, terms, terms[-1:])[0]

    def without(self, terms: Sequence[Term], term: Term) -> list[Term]:
        """Return the terms without one of them, and without what needs it."""
        return [
            t
            for t in terms
            if t != term and not (t.joint == term.joint and term.cause in self.needs(t.cause))
        ]

    def offers(self, terms: Sequence[Term]) -> list[tuple[float, list[Term]]]:
        """Return what to add: candidates with what they need, those that promise most first.

        Before each stands by how much it raises the score, without regard to bounds.
        """
        have = {t[:2] for t in terms}
        free = [t for t in self.candidates if t[:2] not in have]
        added = [[*self._needed(t, have), t] for t in free]
        if not added:
            return []
        gains = self.problem.gains(terms, added)
        out, seen = list[tuple[float, list[Term]]](), dict[tuple[str, int], int]()
        for k in np.argsort(-gains, kind="stable"):
            if gains[k] <= 0 or len(out) >= SHORTLIST:
                break
            key = added[k][-1].cause, added[k][-1].joint
            seen[key] = seen.get(key, 0) + 1
            if seen[key] <= PER_CAUSE:
                out.append((float(gains[k]), added[k]))
        return out

    def _needed(self, term: Term, have: Collection[tuple[object, ...]]) -> list[Term]:
        return [t for t in self._required[term] if t[:2] not in have]

    def rivals(
        self,
        terms: Sequence[Term],
        mine: Sequence[Term],
        *,
        reshaped: bool = False,
        least: float = -np.inf,
    ) -> list[tuple[float, list[Term]]]:
        """Return scores and models with some terms replaced by one other candidate each.

        Candidates are of the terms' joints or of the arm; any, in place of one of the arm.
        ``reshaped``: the same causes with other nonlinear parameters are candidates too.
        ``least`` is the score that the closed form must promise for the exact one to be computed.
        """
        rest = [t for t in terms if t not in mine]
        have = {t[:2] for t in (rest if reshaped else terms)}
        joints = {t.joint for t in mine} | {ARM}
        near = [t for j in sorted(joints) for t in self.candidates if t.joint == j]
        gone, left = {t[:2] for t in mine}, {t[:2] for t in rest}
        added = []
        for term in self.candidates if mine[0].joint == ARM else near:
            if term[:2] in have or term in mine:
                continue
            if not any(t[:2] in gone for t in self._required[term]):
                added.append([*self._needed(term, left), term])
        if not added:
            return []
        gains, least = self.problem.gains(rest, added), least - self.problem.score(rest)
        out, seen = list[tuple[float, list[Term]]](), set[str]()
        for k in np.argsort(-gains, kind="stable"):
            if gains[k] < least or len(seen) == SHORTLIST:
                break
            model, cause = [*rest, *added[k]], added[k][-1].cause
            if cause not in seen and self._possible(model):
                out.append((self.problem.score(model), model))
            seen.add(cause)
        return out

    def _swapped(self, terms: Sequence[Term], now: float) -> list[Term] | None:
        """Return the terms with one, or all of one cause, replaced by a better rival."""
        best, gain = None, 1.0
        causes = {t.cause for t in terms}
        groups = [[t for t in terms if t.cause == c and t.joint != ARM] for c in causes]
        some = [[t] for t in terms] + [g for g in groups if len(g) > 1]
        for mine in some:
            least = now + gain - NAMED * len(mine) - SLACK
            for score, model in self.rivals(terms, mine, reshaped=True, least=least):
                fewer = NAMED * (len(terms) - len(model))
                if len(mine) > 1 and model[-1].joint != ARM:
                    continue
                if score - now + fewer > gain:
                    best, gain = model, score - now + fewer
        for whole in (t for t in terms if t.joint == ARM):
            model = self._split(terms, whole)
            more = self.problem.score(model) - now - NAMED * (len(model) - len(terms))
            if more > gain:
                best, gain = model, more
        return best

    def _split(self, terms: Sequence[Term], whole: Term) -> list[Term]:
        """Return the terms with one of the arm replaced by its cause on each joint that needs it.

        Dead sensors of three joints are gains of zero there, not one that other joints take back.
        """
        rest = [t for t in terms if t.cause != whole.cause]
        own = {t.joint: t for t in reversed(self.candidates) if t.cause == whole.cause}
        each = [own[j] for j in sorted(own) if j != ARM]
        while each:
            losses = self.problem.losses([*rest, *each])[len(rest) :]
            if losses.min() > NAMED:
                break
            each.pop(int(np.argmin(losses)))
        return [*rest, *each] if each else list(terms)
