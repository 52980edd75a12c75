"""The judgement of one joint: the causes with the most evidence, by the search of all data.

A choice of causes is fitted from starts near it, and scored by Laplace's evidence (`fit`). What the
search asks first (`gains`, `losses`) is promised by one simulation each.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stiction_envs.arrays import Array, Bools
from stiction_envs.gap.judge.judgement import WIDTH
from stiction_envs.gap.judge.problem import Term
from stiction_envs.gap.judge.search import NAMED, Search
from stiction_envs.gap.servo.causes import LAG, ServoLag, servo_cause
from stiction_envs.gap.servo.fit import LEAST_LAST, TURN, Coordinates, Fit, Noise, fit
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.questions import passed_speed
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
STEPS = 6
"""Most steps of a fit; assumed."""
LIKELY = 2
"""Number of causes whose removal is tried by a fit in each step of the search; assumed."""
CLOSE = 8.0
"""Nats against a rival from which on it is not fitted; assumed."""
ROUGH = 8
"""Most steps of the first fit, and of the last; assumed."""
Causes = frozenset[str]


@dataclass(frozen=True, kw_only=True, eq=False)
class Question:
    """Question about one joint, and the data that answer it."""

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
    without_scale: bool = False
    """As of `questions.without_scale`: torques are reported for the stiffness that is found."""


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
    lag: Fit | None
    """The same causes with all parts of the lag, where the log shows the lag but not which."""
    noise: Noise
    """Likelihood of the rows that counted."""


class JointProblem:
    """The evidence of any choice of causes of one joint, as `Search` asks for it."""

    scales = (1.0, 1.0)

    def __init__(self, question: Question, last: float = LEAST_LAST) -> None:
        """Take the question; errors ``last`` for some time [s]."""
        self.q = q = question
        self.inflation = np.ones(1)
        m = q.motion
        self.noise = Noise(m, q.counts, q.floor, last)
        self.stiffness = float(q.nominal[INDEX["stiffness"]])
        """Stiffness of the nominal simulation [N·m/rad]."""
        self.own = self.stiffness / (PERFECT if q.perfect else 1.0)
        """Approximate stiffness of the joint's servo [N·m/rad]."""
        stretched = np.abs(m.command - m.q)[q.counts]
        self.error = float(np.sqrt(np.mean(stretched**2)))
        self.reached = {
            "torque_limit": self.own * float(np.percentile(stretched, REACHED)),
            "speed_limit": float(np.percentile(np.abs(np.diff(m.q) / np.diff(m.t)), REACHED)),
        }
        self.passed = passed_speed(m)
        self.fits: dict[Causes, Fit] = {}
        self._tried = set[tuple[Term, ...]]()

    # ---- priors ----------------------------------------------------------------------------------

    def changed(self, causes: Iterable[str]) -> dict[str, float]:
        """Return the parameters that some causes change, with the sizes of their priors."""
        out: dict[str, float] = {}
        for cause in causes:
            for name, size in self.q.candidates[cause].sizes.items():
                out[name] = max(size, out.get(name, 0.0))
        return out

    def needs(self, cause: str) -> list[str]:
        """Return the causes that a cause refines, less those that the nominal simulation has."""
        refined = servo_cause(cause).needs
        return [x for x in refined if x in self.q.candidates and not self._is_nominal(x)]

    def _is_nominal(self, cause: str) -> bool:
        return all(
            self.q.nominal[INDEX[n]] != PARAMETERS[n].absent for n in self.q.candidates[cause].sizes
        )

    def odds(self, causes: Iterable[str]) -> float:
        """Return log prior odds against causes."""
        usual, own = math.log(self.q.hypotheses), (self.q.candidates[c].odds for c in causes)
        return sum(usual if x is None else x for x in own)

    def coordinates(self, causes: Causes) -> Coordinates:
        """Return the free parameters of a choice of causes, with their priors."""
        changed = self.changed(causes)
        dry = "stiction" in changed or self.q.nominal[INDEX["stiction"]] > 0
        always = {n for n in self.q.always if n != "bristle" or dry}
        free = [n for n in NAMES if n in changed or n in always]
        at = np.array([INDEX[n] for n in free], dtype=np.int64)
        centre, size = self.q.nominal[at].copy(), np.empty(len(at))
        for k, name in enumerate(free):
            size[k] = changed.get(name, self.q.always.get(name, 0.0))
            if name in changed and PARAMETERS[name].scale == "stiffness":
                size[k] *= self.own
            if name in LIMITS and centre[k] >= FAR:
                centre[k] = self.reached[name]
            if name == "stiffness":
                centre[k] = self.own
        low, high = bounds(self.own)
        low[INDEX["speed_limit"]] = max(low[INDEX["speed_limit"]], self.passed)
        if "armature" not in changed:  # of links that are lighter than in the file
            low[INDEX["armature"]] = -0.5 * self.q.motion.inertia.min()
        return Coordinates(
            base=self.q.nominal, at=at, centre=centre, size=size, lowest=low, highest=high
        )

    def trials(self, cause: str, now: Array) -> list[dict[str, float]]:
        """Return values from which the parameters of a cause are fitted, given the others (P,)."""
        motion = {
            "error": self.error,
            "gravity": max(float(np.abs(self.q.motion.gravity).mean()), 1e-9),
            "torque": self.reached["torque_limit"],
            "speed": self.reached["speed_limit"],
        }
        return self.q.candidates[cause].starts(motion | dict(zip(NAMES, now.tolist(), strict=True)))

    def terms(self) -> list[Term]:
        """Return all candidates; each trial of a cause is one."""
        return [
            Term(cause, 0, (float(k),))
            for cause in self.q.candidates
            for k in range(len(self.trials(cause, self.q.nominal)))
        ]

    # ---- fits ------------------------------------------------------------------------------------

    def fit(self, causes: Iterable[str], starts: Sequence[Array], steps: int = STEPS) -> Fit:
        """Fit a choice of causes from the best of some starts; return the best fit so far."""
        key = frozenset(causes)
        new = fit(self.q.motion, self.noise, self.coordinates(key), np.stack(starts), steps)
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
        """Return starts of some terms from the fit of another choice of causes."""
        new = [t for t in terms if t.cause not in near]
        starts = self.without(near, near - {t.cause for t in terms})
        for start in starts:
            for t in new:
                for name, x in self.trials(t.cause, start)[int(t.shape[0])].items():
                    start[INDEX[name]] = x
        return starts

    def without(self, near: Causes, causes: Causes) -> list[Array]:
        """Return parameters of a fit less some causes: as they are else, and adjusted for that.

        A perfect servo is so stiff that gravity hardly sags it: its other torques grow with it.
        """
        old = self.fits[near]
        plain, c = old.parameters.copy(), old.coordinates
        gone = self.changed(near).keys() - self.changed(near - causes).keys() - self.q.always.keys()
        if "stiffness" in gone and self.q.perfect:
            some = [INDEX[n] for n in TORQUES if plain[INDEX[n]] < FAR]
            plain[some] *= self.stiffness / plain[INDEX["stiffness"]]
        for name in gone:
            plain[INDEX[name]] = self.q.nominal[INDEX[name]]
        lost = np.array([NAMES[k] in gone and NAMES[k] not in LIMITS for k in c.at], dtype=bool)
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
        of = found.coordinates
        names = self.changed(causes).keys()
        if names & self.q.always.keys():
            for name in names:
                of = of.fixed(INDEX[name])
            rest = fit(self.q.motion, self.noise, of, found.parameters[None], 0)
        without, best = (np.sqrt(np.mean(x.error[self.q.counts] ** 2)) for x in (rest, found))
        return float(without - best)

    def vague(self, causes: Iterable[str], of: Fit) -> list[str]:
        """Return the causes of whose first parameter the interval contains the nominal value."""
        sd = np.sqrt(np.diag(np.linalg.inv(of.precision)))
        near = np.abs(of.z - of.coordinates.z(self.q.nominal)) < WIDTH * sd
        first = {c: INDEX[next(iter(self.q.candidates[c].sizes))] for c in causes}
        return [c for c, k in first.items() if near[of.coordinates.at == k].any()]

    def lag(self, found: Mapping[str, Weighed], vague: Sequence[str], of: Fit) -> Fit | None:
        """Return the fit with all parts of the lag, where another part does for each that is found.

        Damping, armature and delay all make a joint late. A slow motion shows their sum, how late
        the joint is, but not which of them it is: with the others beside it, a part is ``vague``.
        """
        parts = [c for c in LAG if c in found]
        close = {c for c in parts if any(x in LAG and n < NAMED for x, n in found[c].rivals)}
        doubtful = [c for c in parts if c in close or c in vague]
        more = [c for c in LAG if c in self.q.candidates]
        if not parts or doubtful != parts or "damping" not in more:
            return None
        return self.fit({*found, *more}, [of.parameters])

    # ---- what the search asks --------------------------------------------------------------------

    def gains(self, terms: Sequence[Term], offers: Sequence[Sequence[Term]]) -> Array:
        """Return (K,) by how much each of K sets of terms promises to raise the score [nats].

        The angle is taken to be linear between the fit and their trial values, or these to be
        right: far from the likeliest values blocks weigh too little.
        """
        old, near = self.best(terms), frozenset(t.cause for t in terms)
        trials = np.stack([self._starts(near, [*terms, *some])[0] for some in offers])
        columns = np.clip(np.nan_to_num(self.q.motion.simulate(trials) - old.angle), -TURN, TURN)
        weighted = old.slopes * old.weights
        cross, force = columns @ weighted.T, weighted @ old.error - old.z
        inverse = np.linalg.inv(old.precision)
        along = columns @ (old.weights * old.error) - cross @ inverse @ force
        width = (columns * old.weights * columns).sum(axis=1)
        width -= ((cross @ inverse) * cross).sum(axis=1)
        x = np.clip(along / np.maximum(width, 1e-9), 0.0, 2.0)
        there = self.noise.log_likelihood(old.error - columns) - old.log_likelihood
        odds = np.array([self.odds(t.cause for t in some) for some in offers])
        return np.maximum(x * along - 0.5 * x**2 * width, there) - odds

    def losses(self, terms: Sequence[Term]) -> Array:
        """Return (K,) by how much the removal of each of K terms lowers the score [nats].

        Only those that promise to lower it least are fitted; the others are inf.
        """
        now, near = self.score(terms), frozenset(t.cause for t in terms)
        rests = [near - self._refined(t.cause, near) for t in terms]
        promised = []
        for rest in rests:
            less = self.fits.get(rest) or fit(
                self.q.motion,
                self.noise,
                self.coordinates(rest),
                np.stack(self.without(near, near - rest)),
                0,
            )
            promised.append(now - less.evidence + self.odds(rest))
        out = np.full(len(terms), np.inf)
        for k in np.argsort(promised, kind="stable")[:LIKELY]:
            out[k] = now - self.score([t for t in terms if t.cause in rests[k]])
        return out

    def _refined(self, cause: str, causes: Causes) -> Causes:
        """Return a cause, and those of some causes that need it."""
        return frozenset({cause, *(x for x in causes if cause in self.needs(x))})

    # ---- the model of everything -----------------------------------------------------------------

    def rough(self) -> tuple[Fit, list[str]]:
        """Return the fit of lag and plain dry friction, the best of two starts, and its causes."""
        q = self.q
        some = [name for name, part in self.q.candidates.items() if part.stage == 0]
        free = q.always.keys() | self.changed(some).keys()
        k = self.own
        values = {"stiffness": k, "delay": 0.01, "stiction": 0.5 * k * self.error}
        for lag, mass in ((0.02, 0.0003), (0.08, 0.002)):
            start = q.nominal.copy()
            values |= {"damping": lag * k, "armature": mass * k}
            for name in free & values.keys():
                start[INDEX[name]] = values[name]
            best = self.fit(some, [start], ROUGH)
        return best, some

    def everything(self) -> Fit:
        """Return the fit of all candidates, a few more at a time, each from several starts.

        One at a time the search finds nothing where two causes help together only (a softer servo
        and a torque limit).
        """
        best, chosen = self.rough()
        for stage in sorted({part.stage for part in self.q.candidates.values()} - {0}):
            more = [name for name, part in self.q.candidates.items() if part.stage == stage]
            before, chosen = best.parameters, [*chosen, *more]
            groups = [[c] for c in more] if stage == ALONE else [more]
            for group in groups:
                starts = []
                for k in range(len(self.trials(group[0], before))):
                    start = before.copy()
                    for name in self.changed(more).keys() & LIMITS:
                        start[INDEX[name]] = 1.5 * self.reached[name]
                    for cause in group:
                        trials = self.trials(cause, start)
                        for name, x in trials[min(k, len(trials) - 1)].items():
                            start[INDEX[name]] = x
                    starts.append(start)
                best = self.fit(chosen, starts)
        return best


def judge(question: Question) -> JointFindings:
    """Return the causes with the most evidence on one joint, and how sure each of them is."""
    problem = JointProblem(question)
    full = problem.everything()
    causes = max(problem.fits, key=len)
    last = problem.noise.lasts(full.error) if question.last is None else question.last
    problem = JointProblem(question, last)
    full = problem.fit(causes, [full.parameters])
    none = problem.fit((), [question.nominal])
    terms = problem.terms()
    plain = {t.cause: t for t in reversed(terms)}
    search = Search(problem, terms, problem.needs, lambda _, some: problem.score(some))
    start: list[Term] = [plain[c] for c in question.candidates if c in causes]
    # no model gains more than all causes together take off
    least = none.log_likelihood - 0.5 * float(none.z @ none.z)
    starts = [start, []] if full.log_likelihood - least > NAMED else [[]]
    best = max(map(search.climb, starts), key=lambda m: m.worth)
    while True:
        rests = {t.cause: search.without(best.terms, t) for t in best.terms}
        nats = {c: best.evidence - problem.score(rest) for c, rest in rests.items()}
        poor = min(nats, key=nats.__getitem__, default="")
        if not poor or nats[poor] >= NAMED:
            break
        best = search.climb(rests[poor])
    terms = list(best.terms)
    while True:
        weighed = {t.cause: _weighed(problem, search, terms, t) for t in terms}
        found = predicting = problem.best(terms)
        if weighed:
            more = [name for name, part in question.candidates.items() if part.of_every_joint]
            predicting = problem.fit({*weighed, *more}, [found.parameters], ROUGH)
        if question.without_scale:
            predicting = predicting.given("stiffness")
        vague = problem.vague(weighed, predicting)
        lag = problem.lag(weighed, vague, found)
        gone = [t for t in terms if t.cause in vague and (lag is None or t.cause not in LAG)]
        if not gone:
            break
        terms = search.without(terms, gone[0])
    score = problem.score(terms)
    if lag is not None:
        others = [t for t in terms if t.cause not in LAG]
        parts = sorted(c for c in LAG if c in question.candidates)
        weighed = {c: x for c, x in weighed.items() if c not in LAG}
        weighed[ServoLag.name] = Weighed(
            nats=score - problem.score(others),
            rivals=tuple((part, 0.0) for part in parts),
            lost=problem.lost(parts, problem.best(others), found),
        )
    return JointFindings(
        fit=found, predicting=predicting, score=score, causes=weighed, lag=lag, noise=problem.noise
    )


def _weighed(
    problem: JointProblem, search: "Search[JointProblem]", terms: Sequence[Term], term: Term
) -> Weighed:
    """Return a cause of the best model against the models that lack it."""
    score, rest = problem.score(terms), search.without(terms, term)
    offers = search.rivals(terms, [term], least=score - CLOSE)
    rivals = sorted((score - other, model[-1].cause) for other, model in offers)
    return Weighed(
        nats=score - problem.score(rest),
        rivals=tuple((cause, x) for x, cause in rivals),
        lost=problem.lost([term.cause], problem.best(rest), problem.best(terms)),
    )
