"""The judgement of torque tables: the best model, refitted in every step of the search.

Small errors of each pose's friction level and offset are in every model. Effects are not linear, so
the columns among which the search chooses are straight lines: from the nominal model to a trial
value, or through the value found. After every step the chosen values are fitted to the curved
predictions (Gauss-Newton), the whole arm is simulated near them, the evidence is Laplace's, and the
columns are those given these values.
"""

import math
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.gap.judge.problem import ARM, Term
from stiction_envs.gap.judge.search import NAMED, Search
from stiction_envs.gap.tables.data import Effect, State, TableData
from stiction_envs.gap.tables.predictor import Predictor, States, Values
from stiction_envs.gap.tables.table_problem import SCATTER, SIZES, Cells, TableProblem

LEVEL_SD, OFFSET_SD = 0.03, 0.007
"""Prior sizes of the errors of a pose's friction level, and of its offset over friction [-];
assumed: half the sum of two base torques of 1 % scatter each, and a level that varies more."""
TANGENT = 0.3
"""Step of x over its prior size for a tangent [-]; assumed: wider than the steps by which dither's
periods quantise breakaway torques."""
ROUNDS, STEPS, ENOUGH = 4, 12, 0.02
"""Limits of the fit: most states of the whole arm, most steps from each, and a step over the prior
size that ends it; assumed."""
SMALL = 4
"""Number of small errors of a joint: level and offset in both poses."""
RIVALS = 5
"""Number of likely rivals that are fitted; assumed."""
CLOSE = 8.0
"""Log evidence against a model below which it is simulated with the whole arm [nats]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TableFit:
    """The most likely values of some effects, and how likely these effects are."""

    values: dict[Effect, float]
    states: States
    """From which the readings are predicted."""
    problem: TableProblem
    """On tangents at the values."""
    terms: list[Term]
    score: float
    """Log evidence and prior odds [nats]."""

    @property
    def worth(self) -> float:
        """The score less what every name must bring [nats]."""
        return self.score - NAMED * len(self.terms)

    def sd(self) -> dict[Effect, float]:
        """Return the standard deviations of the values."""
        each = np.sqrt(np.diag(self.problem.covariance(self.problem.model(self.terms))))
        own = each[len(each) - len(self.terms) :].tolist()
        return {e: e.size * x for e, x in zip(self.values, own, strict=True)}

    @property
    def sizes(self) -> tuple[int, ...]:
        """Numbers of the likeliest sizes of each joint's errors, as of `TableProblem`."""
        model = self.problem.model(self.terms)
        return tuple(self.problem.likeliest(k, model) for k in range(len(self.problem.channels)))

    def error(self, k: int) -> Array:
        """Return scatter of a joint's readings and their common error, over friction [-]."""
        return np.asarray(SCATTER * SIZES[self.sizes[k]])


Weighed = tuple[list[Effect], TableFit, dict[str, TableFit]]
"""Effects of one cause on the same joints (each bad reading counts alone), the model without them,
and models with another cause in their place, by its name."""


class Judge:
    """All effects on the tables, and the evidence of any set of them."""

    def __init__(self, data: TableData, effects: Sequence[Effect]) -> None:
        """Take the effects with their priors."""
        quantities = dict.fromkeys(e.quantity for e in effects if e.quantity is not None)
        self.data, self.predictor = data, Predictor(data, list(quantities))
        self.bounds = {e: self.predictor.bounds(e) for e in effects}
        self.effects: dict[Term, Effect] = {}
        """By candidate; each trial value of an effect is one."""
        self.term: dict[Effect, Term] = {}
        many = Counter(_kind(e) for e in self.bounds)
        self._all = TableProblem([], np.empty(0))
        self._small = [Term("small errors", k, small=True) for k in range(len(self.data.joints))]
        free = np.full(SMALL, np.inf)
        for small in self._small:
            self._all.add(small, {}, np.ones(SMALL), (-free, free), 0.0)
        for e, (low, high) in self.bounds.items():
            k = ARM if len(e.joints) > 1 else self.data.joints.index(e.joints[0])
            odds = e.odds + math.log(many[_kind(e)])
            for x in e.trials:
                if low <= x * e.size <= high:
                    term = Term(f"{e.cause} {e.scope}", k, (x,))
                    ends = np.array([low / e.size]), np.array([high / e.size])
                    self._all.add(term, {}, np.ones(1), ends, odds)
                    self.effects[term] = e
                    self.term.setdefault(e, term)
        self._cells = lru_cache(maxsize=8 * len(data.joints))(self._made)

    # ---- columns ---------------------------------------------------------------------------------

    def problem(
        self, states: States, values: Values, *, tangents: bool, sizes: tuple[int, ...] = ()
    ) -> TableProblem:
        """Return the model near some values: on tangents, or on straight lines for all effects."""
        cells = []
        for j in self.data.joints:
            own = tuple((e, x) for e, x in values.items() if j in e.joints)
            cells.append(self._cells(j, states[j], own, tangents))
        return self._all.on(cells, sizes)

    def _made(
        self, joint: int, state: State, values: tuple[tuple[Effect, float], ...], tangents: bool
    ) -> Cells:
        """Return the readings of a joint, with columns of a prior size each over friction."""
        data, rows, own = self.data, self.data.of_joint[joint], dict(values)
        unit = data.unit[rows]

        def predicted(e: Effect, x: float) -> Array:
            return self.predictor.of_joint(joint, state, {**own, e: x}) / unit

        def line(e: Effect, x: float, to: float) -> Array:
            return (predicted(e, to) - predicted(e, x)) * e.size / (to - x)

        slope = self.predictor.level_slope(joint, state, own) / unit
        poses = [data.pose[rows] == p for p in range(SMALL // 2)]
        columns = [LEVEL_SD * slope * p for p in poses]
        columns += [OFFSET_SD * data.sign[rows] * p for p in poses]
        at = self._all.numbers[self._small[data.joints.index(joint)]].tolist()
        left = data.torque[rows] / unit - self.predictor.of_joint(joint, state, own) / unit
        fitted: dict[Effect, Array] = {}
        for e, x in own.items():
            step = TANGENT * e.size
            fitted[e] = line(e, x - step, x + step) if tangents else line(e, 0.0, x or step)
            left = left + fitted[e] * x / e.size
        for term, e in self.effects.items():
            if joint in e.joints and (e in own or not tangents):
                columns.append(fitted[e] if e in own else line(e, 0.0, term.shape[0] * e.size))
                at += self._all.numbers[term].tolist()
        cells = Cells(left, data.block[rows], data.blocks)
        cells.append(np.stack(columns), at)
        return cells

    # ---- fit -------------------------------------------------------------------------------------

    def found(self, problem: TableProblem, terms: Sequence[Term]) -> dict[Effect, float]:
        """Return the most likely values of terms in a linear model."""
        model = problem.model(terms)
        each = problem.fit(model)[len(problem.at(model)) - len(terms) :].tolist()
        effects = [self.effects[t] for t in terms]
        return {e: x * e.size for e, x in zip(effects, each, strict=True)}

    def fit(
        self, values: Values, states: States | None = None, *, simulate: bool = True
    ) -> TableFit:
        """Return the most likely values of effects, starting from some values.

        Args:
            values: the start.
            states: the first states; None for those near the values.
            simulate: whether the whole arm is simulated again where the values have moved.
        """
        x, terms = dict(values), [self.term[e] for e in values]
        states = states or self.predictor.states(x)
        for _ in range(ROUNDS):
            for _ in range(STEPS):
                to = self.found(self.problem(states, x, tangents=True), terms)
                # a straight line holds for about one prior size
                step = {e: float(np.clip(to[e] - v, -e.size, e.size)) for e, v in x.items()}
                x = {e: v + step[e] for e, v in x.items()}
                if all(abs(d) < ENOUGH * e.size for e, d in step.items()):
                    break
            new = self.predictor.states(x, states) if simulate else states
            if new == states:
                break
            states = new
        problem = self.problem(states, x, tangents=True)
        x, score = self.found(problem, terms), problem.score(terms)
        return TableFit(values=x, states=states, problem=problem, terms=terms, score=score)

    def left_out(self, fit: TableFit) -> Array:
        """Return (N,) measured less predicted by a fit to the other blocks, over friction [-]."""
        data, out = self.data, np.empty(len(self.data.jobs))
        fixed = fit.problem.on(fit.problem.channels, fit.sizes)
        for block in range(data.blocks):
            values = self.found(fixed.without(block), fit.terms)
            left = (data.torque - self.predictor.predict(fit.states, values)) / data.unit
            out[data.block == block] = left[data.block == block]
        return out

    # ---- search ----------------------------------------------------------------------------------

    def search(self, say: Callable[[str], None]) -> tuple[TableFit, list[Weighed]]:
        """Return the best model and its causes.

        Straight lines may promise too little: a rival that turns out better takes a cause's place.
        """
        best = self._climb(self.fit({}), say)
        while True:
            say("looking for what else could have been it")
            causes = self._weigh(best)
            rivals = [f for _, _, others in causes for f in others.values()]
            better = max([best, *rivals], key=lambda f: f.worth)
            if better is best:
                return best, causes
            best = self._climb(better, say)

    def _weigh(self, fit: TableFit) -> list[Weighed]:
        groups: dict[tuple[object, ...], list[Effect]] = {}
        for e in fit.values:
            groups.setdefault((e.cause, e.joints, tuple(e.rows) if e.bad else ()), []).append(e)
        out = []
        for some in groups.values():
            rest = {e: x for e, x in fit.values.items() if e not in some}
            without = self.fit(rest, fit.states)
            out.append((some, without, self._rivals(fit, without, some)))
        return out

    def _searched(
        self,
        fit: TableFit,
        refresh: Callable[[TableProblem, Sequence[Term]], float],
        refused: Collection[frozenset[Effect]] = (),
    ) -> Search[TableProblem]:
        """Return a search on the straight lines that all effects have near a fit."""
        lines = self.problem(fit.states, fit.values, tangents=False)

        def possible(_: TableProblem, terms: Sequence[Term], asked: Sequence[Term]) -> list[bool]:
            return [frozenset(self.effects[t] for t in terms) not in refused] * len(asked)

        return Search(lines, list(self.effects), lambda _: (), refresh, possible)

    def _climb(self, start: TableFit, say: Callable[[str], None]) -> TableFit:
        """Return the best model that steps from a model reach, each verified by a fit."""
        best = now = start
        refused = set[frozenset[Effect]]()

        def refresh(problem: TableProblem, terms: Sequence[Term]) -> float:
            nonlocal best, now
            effects = [self.effects[t] for t in terms]
            if set(effects) != set(now.values):
                say(", ".join(sorted({e.cause for e in effects})) or "nothing")
                new = self.fit(self.found(problem, terms), now.states, simulate=False)
                if new.worth > best.worth:
                    new = self.fit(new.values, new.states)
                if new.worth > best.worth:
                    best = new
                elif len(new.values) >= len(now.values):
                    refused.add(frozenset(effects))
                now = new
            problem.take(self.problem(now.states, now.values, tangents=False).channels)
            return now.score

        self._searched(start, refresh, refused).climb(start.terms)
        return best

    def _rivals(
        self, fit: TableFit, without: TableFit, instead: Sequence[Effect]
    ) -> dict[str, TableFit]:
        """Return models with another cause in place of some effects of one cause, by its name.

        ``fit`` is the model with the effects, ``without`` the model without them.
        """
        search = self._searched(without, lambda problem, terms: problem.score(terms))
        mine = [self.term[e] for e in instead]
        out: dict[str, TableFit] = {}
        for _, terms in sorted(search.rivals(fit.terms, mine), key=lambda x: -x[0]):
            name = self.effects[terms[-1]].cause
            if name == instead[0].cause or name in out or len(out) == RIVALS:
                continue
            values = self.found(search.problem, terms)
            new = self.fit(values, without.states, simulate=False)
            close = new.score > fit.score - CLOSE
            out[name] = self.fit(new.values, new.states) if close else new
        return out


def _kind(e: Effect) -> tuple[str, bool, bool]:
    """Return the key that effects of one cause share."""
    return e.cause, e.torque is None, e.level is None
