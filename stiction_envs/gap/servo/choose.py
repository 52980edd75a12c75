"""The causes of one joint: all are fitted together, then taken out again one by one.

One at a time forward finds nothing where two causes only help together (a softer servo and a
torque limit). A cause stays where, without it, the error rises in more blocks of time than chance
allows, and by enough to matter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.judge.judgement import Estimate
from stiction_envs.gap.servo.fit import AGAIN, LAST, LESS, ROUGH, Fit, fit
from stiction_envs.gap.servo.joint import JointMotion, speeds
from stiction_envs.gap.servo.parameters import FAR, HIGH, INDEX, PARAMETERS, of_cause
from stiction_envs.gap.servo.questions import PASSED, PASSED_SECONDS
from stiction_envs.gap.servo.spread import LAG, SERVO_LAG, Spread, estimates_of, lag_of, spread_of

Array = NDArray[np.float64]
LAW = ("stribeck_friction", "load_dependent_friction", "presliding_hysteresis")
"""Causes that refine dry friction."""
TORQUES = ("damping", "armature", "stiction", "torque_limit")
"""Parameters whose effect on the angle is that of their ratio to the servo's stiffness."""
LAGS = ((0.02, 0.0003), (0.08, 0.002))
"""Damping [s] and armature [s²] over stiffness, one pair per start; assumed."""
DELAY = 0.01
"""Delay of a start [s]; assumed."""
DRY = 0.5
"""Dry friction of a start over stiffness times the usual error [-]; assumed."""
DROP, LOADED_DROP = 0.2, 0.3
"""Share by which friction falls from stiction, without and with dependence on load [-]; assumed."""
RAISED = 1.1
"""Stiction then, over the dry friction without a drop [-]; assumed."""
WHOLE = 0.9
"""Share of gravity from which on a controller compensates all of it [-]; assumed."""
LOADED = 0.5
"""Part of the dry friction that comes from the load [-]; assumed."""
TORQUE_LIMITS = (0.5, 0.8)
"""Torque limits over the torque that is reached [-], one per start; assumed."""
BOTH_LIMITS = (0.7, 1.5)
"""Torque and speed limit over those that are reached [-]: a start with both; assumed."""
DEAD_ZONES = (0.003, 0.015)
"""Dead zones, one per start [rad]; assumed."""
BLOCK_SECONDS = 2.0
"""Length of a block of time [s]; longer than the memory of a servo's error; assumed."""
LEAST_BLOCKS = 4
"""Blocks with fewer than this show nothing; assumed."""
LEAST_T = 3.0
"""Least mean over standard error of what a cause takes off the blocks' squares [-]; assumed."""
ONE_WAY = 4.0
"""Least sum of what blocks lose over what others gain without a cause [-]: a limit acts in few
blocks, which differ too much for a mean, but all in one direction; assumed."""
ONE_WAY_BLOCKS = 3
"""Blocks that must lose then; assumed."""
LEAST_GAIN = 0.02
"""Least share of the joint's root mean square that a cause must take off [-]; assumed."""
LEAST_NOISE = 1.0
"""Least root mean square that a cause takes off, over the noise floor [-]; assumed."""
LINKS_LEAVE = 5.0
"""Largest error over the noise floor that links a little off leave, and that needs no cause [-];
simulated arms of 5 % scatter leave up to 7 (`hidden.servo_logs`); assumed."""
LINKS_OFF = 0.15
"""Share by which a joint's gravity may be off without a cause: every link is a little off [-];
assumed."""
SOFTER = 0.25
"""Logarithm of the ratio of stiffnesses that links of 5 % scatter may look like [-]; assumed."""
SHIFTED = 0.12
"""Offset of an angle that such links may look like [rad]: 5 mm of a centre 40 mm away; assumed."""
PERFECT = 100.0
"""Stiffness of a servo that counts as perfect over that of the joint's own [-]; assumed."""
CORRELATED = 0.95
"""Least correlation of two parameters that this log hardly tells apart [-]; assumed."""
MINOR = 0.06
"""Share of a joint's nominal error below which what a cause takes off is minor [-]; assumed."""
REACHED_PERCENT = 99.5
"""Percentile of torque and speed that counts as reached [%]; starts lie around it; assumed."""
Start = dict[str, float]
"""Values of some parameters by name, SI units."""
Stage = tuple[tuple[str, ...], Callable[[Fit], list[Start]]]
"""Causes to add together, and the starts of their parameters given the best fit so far."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointCauses:
    """What was found on one joint."""

    fit: Fit
    """Fit of all parameters; some belong to no named cause."""
    bounds: tuple[Array, Array]
    """(P,) lower and upper bounds of the fit."""
    causes: dict[str, float]
    """Root mean square without the cause less that with it [rad], by name."""
    minor: tuple[str, ...]
    """Names of the causes that take off too little to be named."""
    estimates: dict[str, Estimate]
    """By parameter, and of the lag where that is named."""
    confused: dict[str, tuple[str, ...]]
    """Causes that this log cannot tell from a cause."""
    blocks: int
    """Blocks of time in which its rows are."""


def count_named(found: Mapping[int, JointCauses]) -> int:
    """Return how many causes of all joints are more than minor."""
    return sum(c not in joint.minor for joint in found.values() for c in joint.causes)


def criterion(found: Mapping[int, JointCauses], more: int = 0) -> float:
    """Return Bayes' information criterion of all joints; blocks of time count as independent.

    Args:
        found: by joint.
        more: parameters of the whole arm; a cause counts as one.
    """
    blocks = max(joint.blocks for joint in found.values())
    out = np.log(blocks) * (count_named(found) + more)
    for joint in found.values():
        counts = max(1, int(np.count_nonzero(joint.fit.error)))
        out += joint.blocks * np.log(max(joint.fit.cost / counts, 1e-16))
    return float(out)


@dataclass(frozen=True, kw_only=True, eq=False)
class Question:
    """What is asked about one joint."""

    motion: JointMotion
    nominal: Array
    """(P,) parameters of the simulation that is judged; stiffness also where it is not judged."""
    always: tuple[str, ...]
    """Parameters that are fitted and belong to no cause: they are unknown."""
    candidates: tuple[str, ...]
    """Causes that this motion could show."""
    low: Array
    """(P,) lower bounds of the parameters."""
    counts: NDArray[np.bool_]
    """(T,) rows that count."""
    noise: float
    """Noise floor of the measured angle [rad]."""
    judged: bool
    """Whether the nominal simulation could be right: its servos are known."""


class Chooser:
    """Chooses the causes of one joint."""

    def __init__(self, question: Question) -> None:
        self.q = question
        motion = question.motion
        seconds = motion.t - motion.t[0]
        segment = np.repeat(np.arange(len(motion.bounds) - 1), np.diff(motion.bounds))
        blocks = np.unique(
            np.stack([segment, seconds // BLOCK_SECONDS]),
            axis=1,
            return_inverse=True,
        )
        self.block = blocks[1].ravel()
        self.speed = speeds(motion, PASSED_SECONDS)
        self.rows = max(1, int(question.counts.sum()))

    # ---- fitting -----------------------------------------------------------------------------

    def _free(self, causes: Sequence[str]) -> list[str]:
        of = [*self.q.always, *(name for cause in causes for name in of_cause(cause))]
        return list(dict.fromkeys(of))

    def _fit(self, start: Array, causes: Sequence[str], iterations: int) -> Fit:
        low, high = self._bounds(causes)
        return fit(
            self.q.motion,
            start,
            self._free(causes),
            counts=self.q.counts,
            iterations=iterations,
            low=low,
            high=high,
        )

    def _bounds(self, causes: Sequence[str]) -> tuple[Array, Array]:
        """Return (P,) lower and upper bounds of a fit with these causes."""
        k = INDEX["compensation"]
        low, high = self.q.low.copy(), HIGH.copy()
        if "gravity_compensation_missing" not in causes:
            high[k] = LINKS_OFF
            low[k] = -high[k]
        return low, high

    def _without(self, parameters: Array, cause: str) -> Array:
        """Return parameters with those of a cause as in the nominal simulation.

        A perfect servo is so stiff that gravity hardly sags it: its other torques grow with it.
        """
        out = parameters.copy()
        if cause == "servo_stiffness" and not self.q.judged:
            k = INDEX["stiffness"]
            torques = [k] + [INDEX[name] for name in TORQUES if out[INDEX[name]] < FAR]
            out[torques] *= PERFECT
            return out
        for name in of_cause(cause):
            out[INDEX[name]] = self.q.nominal[INDEX[name]]
        return out

    def rough(self) -> tuple[Fit, list[str]]:
        """Return the fit of lag and plain dry friction, the best of two starts, and its causes."""
        q, motion = self.q, self.q.motion
        chosen = [c for c in q.candidates if c in ("servo_stiffness", *LAG, "coulomb_friction")]
        error = float(np.sqrt(np.mean((motion.command - motion.q)[q.counts] ** 2)))
        starts = []
        for lag, armature in LAGS:
            start = q.nominal.copy()
            stiffness = start[INDEX["stiffness"]]
            if "damping" in self._free(chosen):
                start[INDEX["damping"]] = lag * stiffness
            if "armature" in chosen:
                start[INDEX["armature"]] = armature * stiffness
            if "delay" in chosen:
                start[INDEX["delay"]] = DELAY
            if "coulomb_friction" in chosen:
                start[INDEX["stiction"]] = DRY * stiffness * error
            starts.append(start)
        fits = (self._fit(s, chosen, ROUGH) for s in starts)
        return min(fits, key=lambda f: f.cost), chosen

    def everything(self) -> Fit:
        """Return the fit of all candidates, from the best of several starts, stage by stage."""
        best, chosen = self.rough()
        for causes, starts in self._stages():
            more = [c for c in causes if c in self.q.candidates]
            if not more:
                continue
            tries = [best]
            for values in starts(best):
                start = best.parameters.copy()
                for name, x in values.items():
                    start[INDEX[name]] = x
                tries.append(self._fit(start, [*chosen, *more], ROUGH))
            best = min(filter(self._reached, tries), key=lambda f: f.cost, default=best)
            chosen += more
        return self._fit(best.parameters, chosen, LAST)

    def _stages(self) -> Iterator[Stage]:
        motion = self.q.motion

        def friction(best: Fit) -> list[Start]:
            level = best.parameters[INDEX["stiction"]]
            out = [{"drop": DROP, "load": 0.0, "stiction": RAISED * level}]
            if "load_dependent_friction" in self.q.candidates:
                weight = float(np.abs(motion.gravity).mean())
                load, rest = LOADED * level / weight, (1.0 - LOADED) * level
                out.append({"drop": LOADED_DROP, "load": load, "stiction": rest})
            return out

        def limits(best: Fit) -> list[Start]:
            torque = best.parameters[INDEX["stiffness"]] * np.abs(motion.command - motion.q)
            speed = np.abs(np.diff(motion.q) / np.diff(motion.t))
            t, v = (
                float(np.percentile(torque, REACHED_PERCENT)),
                float(np.percentile(speed, REACHED_PERCENT)),
            )
            # a limit that is not reached has no slope: starts lie where it would be
            a, b = BOTH_LIMITS
            return [
                *({"torque_limit": x * t} for x in TORQUE_LIMITS),
                {"speed_limit": v},
                {"torque_limit": a * t, "speed_limit": b * v},
            ]

        yield LAW, friction
        yield ("encoder_offset", "gravity_compensation_missing"), lambda _: [{}]
        yield ("torque_limit", "speed_limit"), limits
        yield ("dead_zone",), lambda _: [{"dead_zone": x} for x in DEAD_ZONES]

    # ---- deletion ----------------------------------------------------------------------------

    def choose(self) -> JointCauses:
        """Return the causes without which the error rises."""
        kept = list(reversed(self.q.candidates))  # among equals the unusual go first
        if self.q.judged and self._agrees():
            kept = []
        best = self.everything() if kept else self._as_it_is()
        if kept:
            best, kept = self._compensated(best, kept)
        losses = dict.fromkeys(kept, 0.0)
        while True:
            for cause in sorted(kept, key=losses.__getitem__):
                less = self._less(best, kept, [cause])
                losses[cause] = self._loss(best, less)
                if (
                    not self._needed(best, less)
                    or self._tolerated(cause, best)
                    or (cause == "speed_limit" and not self._reached(best))
                ):
                    kept = [c for c in kept if c not in _with(cause)]
                    best = self._fit(less.parameters, kept, AGAIN)
                    break
            else:
                break
        return self._found(best, kept, {c: losses[c] for c in kept})

    def _compensated(self, best: Fit, kept: list[str]) -> tuple[Fit, list[str]]:
        """Return the fit with the stated servo, where all of gravity is compensated, if that does.

        A joint that does not sag has it, or a servo many times as stiff as stated.
        """
        stiff, share = ("servo_stiffness", "damping"), "gravity_compensation_missing"
        if not self.q.judged or share not in kept:
            return best, kept
        start = best.parameters
        for cause in stiff:
            start = self._without(start, cause)
        start[INDEX["compensation"]] = 1.0
        scale = start[INDEX["stiffness"]] / best.parameters[INDEX["stiffness"]]
        start[[INDEX[k] for k in ("stiction", "armature")]] *= scale
        rest = [c for c in kept if c not in stiff]
        less = self._fit(start, rest, LESS)
        whole = less["compensation"] > WHOLE and not self._needed(best, less)
        return (less, rest) if whole else (best, kept)

    def _found(self, best: Fit, kept: Sequence[str], losses: dict[str, float]) -> JointCauses:
        """Return what is said of the best fit; of its lag where the parts of it are unknown."""
        q = self.q
        minor = self._minor(best, losses)
        spread = self._spread(best, ())
        estimates = estimates_of(best, spread)
        confused = {c: self._confused(c, spread) for c in kept}
        parts = [c for c in LAG if c in kept]
        lag = None
        if parts:
            whole = self._spread(best, [c for c in LAG if c in q.candidates])
            needed = [c for c in parts if self._alone(c, best, kept)]
            confused |= {c: self._confused(c, whole) for c in parts}
            for c in needed:  # no other part does in its place
                confused[c] = tuple(x for x in confused[c] if x not in LAG)
            lag = lag_of(best, whole, q.nominal, needed)
        if lag is not None:
            loss = self._loss(best, self._less(best, kept, parts))
            losses = {c: x for c, x in losses.items() if c not in parts} | {SERVO_LAG: loss}
            minor = tuple(c for c in minor if c not in parts)
            if loss < self._little():
                minor = (*minor, SERVO_LAG)
            estimates[SERVO_LAG] = lag
            confused[SERVO_LAG] = LAG
        return JointCauses(
            fit=best,
            bounds=self._bounds(kept),
            causes=losses,
            minor=minor,
            estimates=estimates,
            blocks=len(np.unique(self.block[q.counts])),
            confused=confused,
        )

    def _alone(self, part: str, best: Fit, kept: Sequence[str]) -> bool:
        """Return whether no other part of the lag does in place of one."""
        others = [c for c in LAG if c in self.q.candidates and c not in kept]
        return self._needed(best, self._less(best, [*kept, *others], [part]))

    def _spread(self, best: Fit, more: Sequence[str]) -> Spread:
        names = tuple(dict.fromkeys([*best.free, *more]))
        return spread_of(self.q.motion, best, names, self.q.counts, self.block)

    def _agrees(self) -> bool:
        """Return whether the nominal simulation, unknown parameters fitted, leaves only noise."""
        enough = LINKS_LEAVE * self.q.noise
        return bool(np.sqrt(self._as_it_is().cost / self.rows) < enough)

    def _as_it_is(self) -> Fit:
        return self._fit(self.q.nominal, [], ROUGH)

    def _less(self, best: Fit, kept: Sequence[str], causes: Sequence[str]) -> Fit:
        """Return the fit without some causes."""
        start = best.parameters
        gone = {c for cause in causes for c in _with(cause)}
        for c in sorted(gone):
            start = self._without(start, c)
        rest = [c for c in kept if c not in gone]
        return self._fit(start, rest, LESS)

    def _minor(self, best: Fit, losses: dict[str, float]) -> tuple[str, ...]:
        """Return the causes that take off too little to be named, even all of them together.

        Two that stand in for each other lose little each, and much together.
        """
        most = self._little()
        little = sorted((c for c in losses if losses[c] < most), key=losses.__getitem__)
        while len(little) > 1 and self._loss(best, self._less(best, [*losses], little)) >= most:
            little.pop()
        return tuple(little)

    def _little(self) -> float:
        """Return the root mean square below which what a cause takes off is minor [rad]."""
        q = self.q
        nominal = q.motion.simulate(q.nominal[None])[0] if q.judged else q.motion.command
        error = float(np.sqrt(np.mean((q.motion.q - nominal)[q.counts] ** 2)))
        return MINOR * error

    def _tolerated(self, cause: str, best: Fit) -> bool:
        """Return whether links that are a little off would do in its place."""
        stiffness, offset = (best.parameters[INDEX[k]] for k in ("stiffness", "offset"))
        ratio = stiffness / self.q.nominal[INDEX["stiffness"]]
        small = {
            "servo_stiffness": abs(np.log(ratio)) < SOFTER,
            "encoder_offset": abs(offset) < SHIFTED,
        }
        return self.q.judged and bool(small.get(cause, False))

    def _reached(self, fit: Fit) -> bool:
        """Return whether the joint was about as fast as a fit's speed limit, if that has one.

        Nothing shows a limit that was not reached; it replaces something else, and spoils
        faster motions.
        """
        limit = fit["speed_limit"]
        near = self.speed >= PASSED * limit
        blocks = np.unique(self.block[near & self.q.counts])
        return limit >= FAR or len(blocks) >= ONE_WAY_BLOCKS

    def _loss(self, best: Fit, less: Fit) -> float:
        return float(np.sqrt(less.cost / self.rows) - np.sqrt(best.cost / self.rows))

    def _needed(self, best: Fit, less: Fit) -> bool:
        """Return whether the error without a cause is larger than chance and rounding allow.

        Blocks count by what their squares lose, and each alike by the share that it loses: the
        friction that slow motion shows is small beside the errors of fast motion.
        """
        rows = np.bincount(self.block, weights=self.q.counts)
        squares = [np.bincount(self.block, weights=f.error**2) for f in (less, best)]
        most, least = (x[rows > 0].astype(np.float64) for x in squares)
        if len(most) < LEAST_BLOCKS:
            return False
        worse, floor = most - least, rows[rows > 0] * self.q.noise**2
        share = np.log((most + floor) / (least + floor))
        up, down = worse[worse > 0].sum(), -worse[worse < 0].sum()
        clear = (worse > 0).sum() >= ONE_WAY_BLOCKS and up > ONE_WAY * down
        return bool(
            (any(_mean_over_error(x) > LEAST_T for x in (worse, share)) or clear)
            and self._loss(best, less) > LEAST_GAIN * np.sqrt(less.cost / self.rows)
            and less.cost - best.cost > self.rows * (LEAST_NOISE * self.q.noise) ** 2
        )

    # ---- what is said ------------------------------------------------------------------------

    def _confused(self, cause: str, spread: Spread) -> tuple[str, ...]:
        """Return causes whose parameters this log hardly tells from those of ``cause``."""
        found = set(ALIKE.get(cause, ()))
        mine = [k for k, name in enumerate(spread.names) if PARAMETERS[name].cause == cause]
        for k in mine:
            for i, name in enumerate(spread.names):
                other = PARAMETERS[name].cause
                near = abs(spread.correlation[k, i]) > CORRELATED
                if other != cause and near:
                    found.add(other)
        return tuple(sorted(found))


def _mean_over_error(x: Array) -> float:
    """Return the mean of blocks over its standard error."""
    return float(x.mean() / max(x.std(ddof=1) / np.sqrt(len(x)), 1e-300))


def _with(cause: str) -> tuple[str, ...]:
    """Return a cause and those that only refine it."""
    return (cause, *LAW) if cause == "coulomb_friction" else (cause,)


ALIKE = {
    "servo_stiffness": ("payload", "encoder_offset", "link_parameters"),
    "dead_zone": ("coulomb_friction",),
    "encoder_offset": ("torque_offset", "payload"),
    "gravity_compensation_missing": ("servo_stiffness", "payload"),
    "speed_limit": ("torque_limit",),
}
"""What positions alone cannot tell apart, or only just."""
