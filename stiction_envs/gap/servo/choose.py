"""The causes of one joint: all are fitted together, then taken out again one by one.

One at a time forward finds nothing where two causes only help together (a softer servo and a
torque limit). A cause stays where, without it, the error rises in more blocks of time than chance
allows, and by enough to matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from stiction_envs.gap.estimates import Estimate
from stiction_envs.gap.servo.fit import HIGH, LOW, Fit, derivatives, fit
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.parameters import INDEX, PARAMETERS, of_cause

Array = NDArray[np.float64]
LAG = ("damping", "armature", "delay")
"""Causes whose sum, the lag, a log shows better than each of them."""
BLOCK_SECONDS = 2.0
"""Length of a block of time [s]; longer than the memory of a servo's error; assumed."""
LEAST_T = 3.0
"""Least mean over standard error of what a cause takes off the blocks' squares [-]; assumed."""
ONE_WAY = 4.0
"""Least sum of what blocks lose over what others gain without a cause [-]; assumed."""
LEAST_GAIN = 0.02
"""Least share of the joint's root mean square that a cause must take off [-]; assumed."""
LEAST_NOISE = 1.0
"""Least root mean square that a cause takes off, over the noise floor [-]; assumed."""
LINKS_LEAVE = 5.0
"""Largest error over the noise floor that links of 5 % scatter leave, and that needs no cause [-];
measured on simulated arms (`hidden.servo_logs`): up to 4."""
LINKS_OFF = 0.15
"""Share by which a joint's gravity may be off without a cause: every link is a little off [-];
assumed."""
SOFTER = 0.25
"""Logarithm of the ratio of stiffnesses that links of 5 % scatter may feign [-]; assumed."""
SHIFTED = 0.12
"""Offset of an angle that such links may feign [rad]: 5 mm of a centre 40 mm away; assumed."""
PASSED_SECONDS = 0.1
"""Time over which a speed counts as passed [s]; assumed."""
OFTEN = 85.0
"""Percentile of the distance from the command that no torque limit lies below [%]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointCauses:
    """What was found on one joint."""

    fit: Fit
    causes: dict[str, float]
    """Root mean square without the cause less that with it [rad], by name."""
    free: tuple[str, ...]
    """Fitted parameters, those that belong to no named cause included."""
    estimates: dict[str, Estimate]
    """By parameter."""
    confused: dict[str, tuple[str, ...]]
    """Causes that this log cannot tell from a cause."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Question:
    """What is asked about one joint."""

    motion: JointMotion
    nominal: Array
    """(P,) parameters of the simulation that is judged; stiffness also where it is not judged."""
    always: tuple[str, ...]
    """Parameters that are fitted and belong to no cause: nobody said what they are."""
    candidates: tuple[str, ...]
    """Causes that this motion could show."""
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
            np.stack([segment, seconds // BLOCK_SECONDS]), axis=1, return_inverse=True
        )
        self.block = blocks[1].ravel()
        self.low = LOW.copy()
        # what is reached most of the time is no limit, and what was passed is none
        rows = max(1, round(PASSED_SECONDS / float(np.median(np.diff(motion.t)))))
        speed = np.abs((motion.q[rows:] - motion.q[:-rows]) / (motion.t[rows:] - motion.t[:-rows]))
        self.low[INDEX["speed_limit"]] = max(1e-3, 0.9 * float(np.percentile(speed, 99)))
        stretched = float(np.percentile(np.abs(motion.command - motion.q), OFTEN))
        self.high = HIGH.copy()
        self.low[INDEX["torque_limit"]] = question.nominal[INDEX["stiffness"]] * stretched

    # ---- fitting -----------------------------------------------------------------------------

    def _free(self, causes: Sequence[str]) -> list[str]:
        of = [*self.q.always, *(name for cause in causes for name in of_cause(cause))]
        return list(dict.fromkeys(of))

    def _fit(self, start: Array, causes: Sequence[str], iterations: int) -> Fit:
        k = INDEX["compensation"]
        low, high = self.low.copy(), self.high.copy()
        if "gravity_compensation_missing" not in causes:
            low[k], high[k] = -LINKS_OFF, LINKS_OFF
        return fit(
            self.q.motion,
            start,
            self._free(causes),
            counts=self.q.counts,
            iterations=iterations,
            low=low,
            high=high,
        )

    def _without(self, parameters: Array, cause: str) -> Array:
        """Return parameters with those of a cause as in the nominal simulation."""
        out = parameters.copy()
        for name in of_cause(cause):
            out[INDEX[name]] = self.q.nominal[INDEX[name]]
        return out

    def rough(self) -> Fit:
        """Return the fit of the servo's lag and plain dry friction, from the best of two starts."""
        return self._rough()[0]

    def _rough(self) -> tuple[Fit, list[str]]:
        q, motion = self.q, self.q.motion
        chosen = [c for c in q.candidates if c in ("servo_stiffness", *LAG, "coulomb_friction")]
        error = float(np.sqrt(np.mean((motion.command - motion.q)[q.counts] ** 2)))
        starts = []
        for lag, armature in ((0.02, 0.003), (0.08, 0.02)):
            start = q.nominal.copy()
            stiffness = start[INDEX["stiffness"]]
            if "damping" in self._free(chosen):
                start[INDEX["damping"]] = lag * stiffness
            if "armature" in chosen:
                start[INDEX["armature"]] = armature * stiffness / 10.0
            if "delay" in chosen:
                start[INDEX["delay"]] = 0.01
            if "coulomb_friction" in chosen:
                start[INDEX["stiction"]] = 0.5 * stiffness * error
            starts.append(start)
        return min((self._fit(s, chosen, 8) for s in starts), key=lambda f: f.cost), chosen

    def everything(self) -> Fit:
        """Return the fit of all candidates, from the best of several starts, stage by stage."""
        best, chosen = self._rough()
        for more, values in self._stages():
            more = [c for c in more if c in self.q.candidates]
            if not more:
                continue
            tries = [best]
            for value in values(best):
                start = best.parameters.copy()
                for name, x in value.items():
                    start[INDEX[name]] = x
                tries.append(self._fit(start, [*chosen, *more], 8))
            best = min(tries, key=lambda f: f.cost)
            chosen += more
        return self._fit(best.parameters, chosen, 10)

    def _stages(self):  # type: ignore[no-untyped-def]
        """Yield causes to add together, and the starts of their parameters given the best fit."""
        motion = self.q.motion

        def friction(best: Fit) -> list[dict[str, float]]:
            level = best.parameters[INDEX["stiction"]]
            out = [{"drop": 0.2, "load": 0.0, "stiction": 1.1 * level}]
            if "load_dependent_friction" in self.q.candidates:
                weight = float(np.abs(motion.gravity).mean())
                out.append({"drop": 0.3, "load": 0.5 * level / weight, "stiction": 0.5 * level})
            return out

        def limits(best: Fit) -> list[dict[str, float]]:
            torque = best.parameters[INDEX["stiffness"]] * np.abs(motion.command - motion.q)
            speed = np.abs(np.diff(motion.q) / np.diff(motion.t))
            t, v = float(np.percentile(torque, 99.5)), float(np.percentile(speed, 99.5))
            # a limit that is not reached has no slope: starts lie where it would be
            return [
                {"torque_limit": 0.5 * t},
                {"torque_limit": 0.8 * t},
                {"speed_limit": v},
                {"torque_limit": 0.7 * t, "speed_limit": 1.5 * v},
            ]

        yield (
            ["stribeck_friction", "load_dependent_friction", "presliding_hysteresis"],
            friction,
        )
        yield ["encoder_offset", "gravity_compensation_missing"], lambda _: [{}]
        yield ["torque_limit", "speed_limit"], limits
        yield ["dead_zone"], lambda _: [{"dead_zone": 0.003}, {"dead_zone": 0.015}]

    # ---- deletion ----------------------------------------------------------------------------

    def choose(self) -> JointCauses:
        """Return the causes without which the error rises."""
        kept = list(reversed(self.q.candidates))  # among equals the unusual go first
        if self.q.judged and self._agrees():
            kept = []
        best = self.everything() if kept else self._fit(self.q.nominal, [], 8)
        losses = dict.fromkeys(kept, 0.0)
        while True:
            for cause in sorted(kept, key=losses.__getitem__):
                less = self._less(best, kept, cause)
                losses[cause] = self._loss(best, less)
                if not self._needed(best, less) or self._tolerated(cause, best):
                    kept = [c for c in kept if c not in _with(cause)]
                    best = self._fit(less.parameters, kept, 6)
                    break
            else:
                break
        estimates, correlation = self._estimates(best)
        return JointCauses(
            fit=best,
            causes={c: losses[c] for c in kept},
            free=best.free,
            estimates=estimates,
            confused={c: self._confused(c, best, correlation) for c in kept},
        )

    def _agrees(self) -> bool:
        """Return whether the nominal simulation, and what nobody judges, is down to the noise."""
        best = self._fit(self.q.nominal, [], 8)
        n = max(1, int(self.q.counts.sum()))
        return bool(np.sqrt(best.cost / n) < LINKS_LEAVE * self.q.noise)

    def _less(self, best: Fit, kept: Sequence[str], cause: str) -> Fit:
        """Return the fit without a cause."""
        start = best.parameters
        for c in _with(cause):
            start = self._without(start, c)
        return self._fit(start, [c for c in kept if c not in _with(cause)], 5)

    def _tolerated(self, cause: str, best: Fit) -> bool:
        """Return whether links that are a little off would do in its place."""
        stiffness, offset = (best.parameters[INDEX[k]] for k in ("stiffness", "offset"))
        ratio = stiffness / self.q.nominal[INDEX["stiffness"]]
        small = {
            "servo_stiffness": abs(np.log(ratio)) < SOFTER,
            "encoder_offset": abs(offset) < SHIFTED,
        }
        return self.q.judged and bool(small.get(cause, False))

    def _loss(self, best: Fit, less: Fit) -> float:
        n = max(1, int(self.q.counts.sum()))
        return float(np.sqrt(less.cost / n) - np.sqrt(best.cost / n))

    def _needed(self, best: Fit, less: Fit) -> bool:
        """Return whether the error without a cause is larger than chance and rounding allow."""
        worse = less.error**2 - best.error**2
        blocks = np.bincount(self.block, weights=worse)
        blocks = blocks[np.bincount(self.block, weights=self.q.counts) > 0]
        if len(blocks) < 4:
            return False
        spread = blocks.std(ddof=1) / np.sqrt(len(blocks))
        n = max(1, int(self.q.counts.sum()))
        rms = np.sqrt(less.cost / n)
        gain = rms - np.sqrt(best.cost / n)
        up, down = blocks[blocks > 0].sum(), -blocks[blocks < 0].sum()
        # a limit acts in few blocks: they differ too much for a mean, but all in one direction
        clear = (blocks > 0).sum() >= 3 and up > ONE_WAY * down
        return bool(
            (blocks.mean() > LEAST_T * spread or clear)
            and gain > LEAST_GAIN * rms
            and less.cost - best.cost > n * (LEAST_NOISE * self.q.noise) ** 2
        )

    # ---- what is said ------------------------------------------------------------------------

    def _estimates(self, best: Fit) -> tuple[dict[str, Estimate], Array]:
        """Return each fitted parameter with its 95 % interval, and their correlation.

        The scores' scatter between blocks of time stands for noise of any colour.
        """
        if not best.free:
            return {}, np.zeros((0, 0))
        at = np.array([INDEX[name] for name in best.free], dtype=np.int64)
        slopes = derivatives(self.q.motion, best.parameters, at, best.angle) * self.q.counts
        hessian = slopes @ slopes.T + 1e-15 * np.eye(len(at))
        scores = np.stack([np.bincount(self.block, weights=row * best.error) for row in slopes])
        inverse = np.linalg.pinv(hessian)
        covariance = inverse @ (scores @ scores.T) @ inverse
        blocks = scores.shape[1]
        quantile = float(student.ppf(0.975, max(1, blocks - len(at))))
        estimates = {}
        for k, name in enumerate(best.free):
            p = PARAMETERS[name]
            value = float(best.parameters[INDEX[name]])
            half = quantile * float(np.sqrt(max(covariance[k, k], 0.0))) * p.step
            near = value <= p.low + 1e-9 or value >= p.high - 1e-9
            estimates[name] = Estimate(
                value=value,
                ci95=(max(value - half, p.low), min(value + half, p.high)),
                on_bound=near,
            )
        scale = np.sqrt(np.maximum(np.diag(inverse), 1e-300))
        return estimates, inverse / np.outer(scale, scale)

    def _confused(self, cause: str, best: Fit, correlation: Array) -> tuple[str, ...]:
        """Return causes whose parameters this log hardly tells from those of ``cause``."""
        found = set(_ALIKE.get(cause, ()))
        mine = [k for k, name in enumerate(best.free) if PARAMETERS[name].cause == cause]
        for k in mine:
            for i, name in enumerate(best.free):
                other = PARAMETERS[name].cause
                if other != cause and abs(correlation[k, i]) > 0.95:
                    found.add(other)
        return tuple(sorted(found))


def _with(cause: str) -> tuple[str, ...]:
    """Return a cause and those that only refine it."""
    return (cause, *_LAW) if cause == "coulomb_friction" else (cause,)


_LAW = ("stribeck_friction", "load_dependent_friction", "presliding_hysteresis")
_ALIKE = {
    "servo_stiffness": ("payload", "encoder_offset", "link_parameters"),
    "dead_zone": ("backlash", "coulomb_friction"),
    "encoder_offset": ("torque_offset", "payload"),
    "gravity_compensation_missing": ("servo_stiffness", "payload"),
    "damping": ("delay", "armature"),
    "armature": ("damping", "delay"),
    "delay": ("damping", "armature"),
    "speed_limit": ("torque_limit",),
}
"""What positions alone cannot tell apart, or only just."""
