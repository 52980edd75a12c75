"""The judgement of one joint: the causes with the most evidence, by the search of all data.

A choice of causes is fitted from starts near it, and scored by Laplace's evidence (`fit`). What the
search asks first (`gains`, `losses`) is promised by one simulation each.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stiction_envs.arrays import Array, Bools
from stiction_envs.gap.judge.problem import Term
from stiction_envs.gap.judge.search import NAMED, Search
from stiction_envs.gap.servo.causes import LAG, ServoLag, servo_cause
from stiction_envs.gap.servo.fit import LEAST_LAST, Coordinates, Fit, Noise, error_of, fit
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.servo_parameters import (
    ALONE,
    FAR,
    INDEX,
    LIMITS,
    NAMES,
    PARAMETERS,
    InServo,
    bounds,
)

TORQUES = ("damping", "armature", "stiction", "torque_limit")
"""Parameters whose effect on the angle is that of their ratio to the servo's stiffness."""
PERFECT = 100.0
"""Stiffness of a servo that counts as perfect over that of the joint's own [-]; assumed."""
REACHED = 99.5
"""Percentile of torque and speed that counts as reached [%]; assumed."""
STEPS, ROUGH = 6, 8
"""Most steps of a fit, and of the first and the last fit; assumed."""
LIKELY = 2
"""Number of causes whose removal is tried by a fit in each step of the search; assumed."""
CLOSE = 8.0
"""Nats against a rival from which on it is not fitted; assumed."""
Causes = frozenset[str]


@dataclass(frozen=True, kw_only=True, eq=False)
class Weighed:
    """One cause of the best model, and the models that lack it."""

    nats: float
    """Log evidence against the model without it."""
    rivals: tuple[tuple[str, float], ...]
    """Log evidence against models with another cause in its place, nearest first."""
    lost: float
    """Root mean square without it less that with it [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointFindings:
    """Findings on one joint."""

    fit: Fit
    """The best model."""
    predicting: Fit
    """The best model with all causes `of_every_joint`: what moves the joint."""
    score: float
    """Log evidence and log prior odds of it [nats]."""
    causes: dict[str, Weighed]
    noise: Noise
    """Likelihood of the rows that counted."""


@dataclass(kw_only=True, eq=False)
class JointProblem:
    """One joint, and the evidence of any choice of its causes, as `Search` asks for it."""

    motion: JointMotion
    nominal: Array
    """(P,) parameters of the simulation that is judged; stiffness also where it is not judged."""
    always: Mapping[str, float]
    """Usual size [SI] of changes that are fitted and no cause."""
    candidates: Mapping[str, InServo]
    """Causes that this motion could show, in the order of parameters."""
    hypotheses: int
    """Number of causes on all joints."""
    counts: Bools
    """(T,) rows that count."""
    floor: float
    """Error of the angle that every model leaves [rad]."""
    last: float | None = None
    """Time for which errors last, so that evidence is comparable [s]; None: from the residual."""
    perfect: bool = False
    """Whether the servo of the nominal simulation is `PERFECT` times as stiff as the joint's."""
    scales: tuple[float, float] = (1.0, 1.0)
    inflation: Array = field(default_factory=lambda: np.ones(1))

    def __post_init__(self) -> None:
        m = self.motion
        self.noise = Noise(m, self.counts, self.floor, self.last or LEAST_LAST)
        self.stiffness = float(self.nominal[INDEX["stiffness"]])
        """Stiffness of the nominal simulation [N·m/rad]."""
        self.own = self.stiffness / (PERFECT if self.perfect else 1.0)
        """Approximate stiffness of the joint's servo [N·m/rad]."""
        stretched = np.abs(m.command - m.q)[self.counts]
        self.error = float(np.sqrt(np.mean(stretched**2)))
        self.reached = {
            "torque_limit": self.own * float(np.percentile(stretched, REACHED)),
            "speed_limit": float(np.percentile(np.abs(np.diff(m.q) / np.diff(m.t)), REACHED)),
        }
        self.fits: dict[Causes, Fit] = {}
        self._tried = set[tuple[Term, ...]]()

    # ---- priors ----------------------------------------------------------------------------------

    def changed(self, causes: Iterable[str]) -> dict[str, float]:
        """Return the parameters that some causes change, with the sizes of their priors."""
        out: dict[str, float] = {}
        for cause in causes:
            for name, size in self.candidates[cause].sizes.items():
                out[name] = max(size, out.get(name, 0.0))
        return out

    def needs(self, cause: str) -> list[str]:
        """Return the causes that a cause refines, less those that the nominal simulation has."""
        return [
            x
            for x in servo_cause(cause).needs
            if x in self.candidates
            and any(self.nominal[INDEX[n]] == PARAMETERS[n].absent for n in self.changed([x]))
        ]

    def odds(self, causes: Iterable[str]) -> float:
        """Return log prior odds against causes."""
        usual, own = math.log(self.hypotheses), (self.candidates[c].odds for c in causes)
        return sum(usual if x is None else x for x in own)

    def coordinates(self, causes: Causes) -> Coordinates:
        """Return the free parameters of a choice of causes, with their priors."""
        changed = self.changed(causes)
        dry = "stiction" in changed or self.nominal[INDEX["stiction"]] > 0
        sizes = {n: x for n, x in self.always.items() if n != "bristle" or dry}
        for name, x in changed.items():
            sizes[name] = x * (self.own if PARAMETERS[name].scale == "stiffness" else 1.0)
        free = [n for n in NAMES if n in sizes]
        at = np.array([INDEX[n] for n in free], dtype=np.int64)
        unlimited = {n: x for n, x in self.reached.items() if self.nominal[INDEX[n]] >= FAR}
        centres = unlimited | {"stiffness": self.own}
        low, high = bounds(self.own)
        if "armature" not in changed:  # of links that are lighter than in the file
            low[INDEX["armature"]] = -0.5 * self.motion.inertia.min()
        return Coordinates(
            base=self.nominal,
            at=at,
            centre=np.array([centres.get(n, float(self.nominal[INDEX[n]])) for n in free]),
            size=np.array([sizes[n] for n in free]),
            lowest=low,
            highest=high,
        )

    def trials(self, cause: str, now: Array) -> list[Array]:
        """Return parameters (P,) from which those of a cause are fitted, given the others."""
        motion = {
            "error": self.error,
            "gravity": max(float(np.abs(self.motion.gravity).mean()), 1e-9),
            "torque": self.reached["torque_limit"],
            "speed": self.reached["speed_limit"],
        }
        known = motion | dict(zip(NAMES, now.tolist(), strict=True))
        return [_with(now, values) for values in self.candidates[cause].starts(known)]

    # ---- fits ------------------------------------------------------------------------------------

    def fit(self, causes: Iterable[str], starts: Sequence[Array], steps: int = STEPS) -> Fit:
        """Fit a choice of causes from the best of some starts; return the best fit so far."""
        key = frozenset(causes)
        new = fit(self.motion, self.noise, self.coordinates(key), np.stack(starts), steps)
        if key not in self.fits or new.evidence > self.fits[key].evidence:
            self.fits[key] = new
        return self.fits[key]

    def best(self, terms: Sequence[Term]) -> Fit:
        """Return the best fit of some terms, from the trial values of those that are new."""
        key, mark = frozenset(t.cause for t in terms), tuple(sorted(terms))
        if mark not in self._tried:
            self._tried.add(mark)
            others = [k for k in self.fits if k != key]
            if others:
                near = min(others, key=lambda k: (len(k ^ key), -self.fits[k].evidence, sorted(k)))
                self.fit(key, self._starts(near, terms))
        return self.fits[key]

    def score(self, terms: Sequence[Term]) -> float:
        """Return log evidence and log prior odds of some causes [nats]."""
        return self.best(terms).evidence - self.odds(t.cause for t in terms)

    def _starts(self, near: Causes, terms: Sequence[Term]) -> list[Array]:
        """Return starts (P,) of some terms from the fit of another choice of causes."""
        starts = self.without(near, near - {t.cause for t in terms})
        for t in (t for t in terms if t.cause not in near):
            starts = [self.trials(t.cause, start)[int(t.shape[0])] for start in starts]
        return starts

    def without(self, near: Causes, causes: Causes) -> list[Array]:
        """Return parameters of a fit less some causes: as they are else, and adjusted for that.

        A perfect servo is so stiff that gravity hardly sags it: its other torques grow with it.
        """
        old = self.fits[near]
        plain, c = old.parameters.copy(), old.coordinates
        gone = self.changed(near).keys() - self.changed(near - causes).keys() - self.always.keys()
        if "stiffness" in gone and self.perfect:
            some = [INDEX[n] for n in TORQUES if plain[INDEX[n]] < FAR]
            plain[some] *= self.stiffness / plain[INDEX["stiffness"]]
        at = [INDEX[name] for name in gone]
        plain[at] = self.nominal[at]
        lost = np.isin(c.at, [INDEX[n] for n in gone - LIMITS])
        if not lost.any() or lost.all():
            return [plain]
        # the likeliest values of the others given these, were the angle linear
        kept, a = ~lost, old.precision
        change = a[np.ix_(kept, lost)] @ (c.z(plain) - old.z)[lost]
        z = old.z.copy()
        z[kept] -= np.linalg.solve(a[np.ix_(kept, kept)], change)
        moved = c.parameters(np.clip(z, c.low, c.high)[None])[0]
        adjusted = plain.copy()
        adjusted[c.at[kept]] = moved[c.at[kept]]
        return [plain, adjusted]

    def lost(self, causes: Iterable[str], rest: Fit, found: Fit) -> float:
        """Return by how much the error grows without some causes [rad].

        ``rest`` is the fit without them. Small errors that are always fitted would take the place
        of a cause that has the same parameter: then the best fit is taken, less the cause.
        """
        names = self.changed(causes).keys()
        if names & self.always.keys():
            of = found.coordinates
            for name in names:
                of = of.fixed(INDEX[name])
            rest = fit(self.motion, self.noise, of, found.parameters[None], 0)
        without, best = (np.sqrt(np.mean(x.error[self.counts] ** 2)) for x in (rest, found))
        return float(without - best)

    # ---- what the search asks --------------------------------------------------------------------

    def gains(self, terms: Sequence[Term], offers: Sequence[Sequence[Term]]) -> Array:
        """Return (K,) by how much each of K sets of terms promises to raise the score [nats].

        The angle is taken to be linear between the fit and their trial values, or these to be
        right: far from the likeliest values blocks weigh too little.
        """
        old, near = self.best(terms), frozenset(t.cause for t in terms)
        trials = np.stack([self._starts(near, [*terms, *some])[0] for some in offers])
        errors = error_of(self.motion, self.motion.simulate(trials))
        columns, weighted = old.error - errors, old.slopes * old.weights
        cross, force = columns @ weighted.T, weighted @ old.error - old.z
        inverse = np.linalg.inv(old.precision)
        along = columns @ (old.weights * old.error) - cross @ inverse @ force
        width = (columns * old.weights * columns).sum(axis=1)
        width -= ((cross @ inverse) * cross).sum(axis=1)
        x = np.clip(along / np.maximum(width, 1e-9), 0.0, 2.0)
        there = self.noise.log_likelihood(errors) - old.log_likelihood
        odds = np.array([self.odds(t.cause for t in some) for some in offers])
        return np.maximum(x * along - 0.5 * x**2 * width, there) - odds

    def losses(self, terms: Sequence[Term]) -> Array:
        """Return (K,) by how much the removal of each of K terms lowers the score [nats].

        Only those that promise to lower it least are fitted; the others are inf.
        """
        now, near = self.score(terms), frozenset(t.cause for t in terms)
        rests = [near - {t.cause, *(x for x in near if t.cause in self.needs(x))} for t in terms]
        promised = []
        for rest in rests:
            start = np.stack(self.without(near, near - rest))
            less = self.fits.get(rest) or fit(
                self.motion, self.noise, self.coordinates(rest), start, 0
            )
            promised.append(now - less.evidence + self.odds(rest))
        out = np.full(len(terms), np.inf)
        for k in np.argsort(promised, kind="stable")[:LIKELY]:
            out[k] = now - self.score([t for t in terms if t.cause in rests[k]])
        return out

    # ---- where the search starts -----------------------------------------------------------------

    def rough(self) -> tuple[Fit, list[str]]:
        """Return the fit of lag and plain dry friction, the best of two starts, and its causes."""
        some = [name for name, part in self.candidates.items() if part.stage == 0]
        free = self.always.keys() | self.changed(some).keys()
        k = self.own
        values = {"stiffness": k, "delay": 0.01, "stiction": 0.5 * k * self.error}
        for lag, mass in ((0.02, 0.0003), (0.08, 0.002)):
            values |= {"damping": lag * k, "armature": mass * k}
            start = _with(self.nominal, {n: x for n, x in values.items() if n in free})
            best = self.fit(some, [start], ROUGH)
        return best, some

    def everything(self) -> Fit:
        """Return the fit of all candidates, a few more at a time, each from several starts.

        One at a time the search finds nothing where two causes help together only (a softer servo
        and a torque limit).
        """
        best, chosen = self.rough()
        for stage in sorted({part.stage for part in self.candidates.values()} - {0}):
            more = [name for name, part in self.candidates.items() if part.stage == stage]
            limits = {n: 1.5 * self.reached[n] for n in self.changed(more).keys() & LIMITS}
            before, chosen = _with(best.parameters, limits), [*chosen, *more]
            for group in [[c] for c in more] if stage == ALONE else [more]:
                starts = []
                for k in range(len(self.trials(group[0], before))):
                    start = before
                    for cause in group:
                        trials = self.trials(cause, start)
                        start = trials[min(k, len(trials) - 1)]
                    starts.append(start)
                best = self.fit(chosen, starts)
        return best


def _with(parameters: Array, values: Mapping[str, float]) -> Array:
    """Return parameters (P,) with other values of some."""
    out = parameters.copy()
    for name, x in values.items():
        out[INDEX[name]] = x
    return out


def judge(problem: JointProblem) -> JointFindings:
    """Return the causes with the most evidence on one joint, and how sure each of them is."""
    full = problem.everything()
    last = problem.noise.lasts(full.error) if problem.last is None else problem.last
    problem = replace(problem, last=last)
    full = problem.fit(problem.candidates, [full.parameters])
    none = problem.fit((), [problem.nominal])
    terms = [
        Term(cause, 0, (float(k),))
        for cause in problem.candidates
        for k in range(len(problem.trials(cause, problem.nominal)))
    ]
    search = Search(
        problem, terms, problem.needs, lambda _, some: problem.score(some), lambda *_: True
    )
    # no model gains more than all causes together take off
    least = none.log_likelihood - 0.5 * float(none.z @ none.z)
    start = [t for t in terms if t.shape[0] == 0]
    starts = [start, []] if full.log_likelihood - least > NAMED else [[]]
    best = max(map(search.climb, starts), key=lambda m: m.worth)
    while True:
        rests = {t.cause: search.without(best.terms, t) for t in best.terms}
        nats = {c: best.evidence - problem.score(rest) for c, rest in rests.items()}
        poor = min(nats, key=nats.__getitem__, default="")
        if not poor or nats[poor] >= NAMED:
            break
        best = search.climb(rests[poor])
    found = problem.best(best.terms)
    weighed = {}
    for term in best.terms:
        offers = search.rivals(best.terms, [term], least=best.evidence - CLOSE)
        rivals = sorted((best.evidence - score, model[-1].cause) for score, model in offers)
        rest = problem.best(rests[term.cause])
        weighed[term.cause] = Weighed(
            nats=nats[term.cause],
            rivals=tuple((cause, x) for x, cause in rivals),
            lost=problem.lost([term.cause], rest, found),
        )
    predicting = found
    if weighed:
        more = [name for name, part in problem.candidates.items() if part.of_every_joint]
        predicting = problem.fit({*weighed, *more}, [found.parameters], ROUGH)
    parts = [c for c in LAG if c in weighed]
    # a slow motion shows how late a joint is, but not which part of the lag it is
    doubtful = [c for c in parts if any(x in LAG and n < NAMED for x, n in weighed[c].rivals)]
    if parts and doubtful == parts and "damping" in problem.candidates:
        others = [t for t in best.terms if t.cause not in LAG]
        weighed = {c: x for c, x in weighed.items() if c not in LAG}
        weighed[ServoLag.name] = Weighed(
            nats=best.evidence - problem.score(others),
            rivals=tuple((part, 0.0) for part in sorted(LAG)),
            lost=problem.lost(LAG, problem.best(others), found),
        )
    return JointFindings(
        fit=found,
        predicting=predicting,
        score=best.evidence,
        causes=weighed,
        noise=problem.noise,
    )
