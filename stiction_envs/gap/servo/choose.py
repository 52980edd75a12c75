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
from stiction_envs.gap.servo.fit import LOW, Fit, derivatives, fit
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.parameters import INDEX, PARAMETERS, of_cause

Array = NDArray[np.float64]
LAG = ("damping", "armature", "delay")
"""Causes whose sum, the lag, a log shows better than each of them."""
BLOCK_SECONDS = 2.0
"""Length of a block of time [s]; longer than the memory of a servo's error; assumed."""
LEAST_T = 3.0
"""Least mean over standard error of what a cause takes off the blocks' squares [-]; assumed."""
LEAST_GAIN = 0.02
"""Least share of the joint's root mean square that a cause must take off [-]; assumed."""
LEAST_STEPS = 0.25
"""The same, over the resolution of the angle [-]: smaller errors are rounding; assumed."""
GRAVITY_SEEN = 0.05
"""Least range of gravity over the servo's stiffness, over the angle's error, to scale it [-]."""


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
    resolution: float
    """Step of the measured angle [rad]."""


class Chooser:
    """Chooses the causes of one joint."""

    def __init__(self, question: Question) -> None:
        self.q = question
        motion = question.motion
        seconds = motion.t - motion.t[0]
        segment = np.repeat(np.arange(len(motion.bounds) - 1), np.diff(motion.bounds))
        blocks = np.unique(np.stack([segment, seconds // BLOCK_SECONDS]), axis=1, return_inverse=True)
        self.block = blocks[1].ravel()
        self.low = LOW.copy()

    # ---- fitting -----------------------------------------------------------------------------

    def _free(self, causes: Sequence[str]) -> list[str]:
        return [*self.q.always, *(name for cause in causes for name in of_cause(cause))]

    def _fit(self, start: Array, causes: Sequence[str], iterations: int) -> Fit:
        return fit(
            self.q.motion,
            start,
            self._free(causes),
            counts=self.q.counts,
            iterations=iterations,
            low=self.low,
        )

    def _without(self, parameters: Array, cause: str) -> Array:
        """Return parameters with those of a cause as in the nominal simulation."""
        out = parameters.copy()
        for name in of_cause(cause):
            out[INDEX[name]] = self.q.nominal[INDEX[name]]
        return out

    def everything(self) -> Fit:
        """Return the fit of all candidates, from the best of several starts, stage by stage."""
        q, motion = self.q, self.q.motion
        within = [c for c in q.candidates if c in ("servo_stiffness", *LAG)]
        begin = q.nominal.copy()
        starts = []
        error = np.sqrt(np.mean((motion.command - motion.q)[q.counts] ** 2))
        for lag, armature in ((0.02, 0.003), (0.08, 0.02)):
            start = begin.copy()
            stiffness = start[INDEX["stiffness"]]
            if "damping" in self._free(within):
                start[INDEX["damping"]] = lag * stiffness
            if "armature" in within:
                start[INDEX["armature"]] = armature * stiffness / 10.0
            if "delay" in within:
                start[INDEX["delay"]] = 0.01
            if "coulomb_friction" in q.candidates:
                start[INDEX["stiction"]] = 0.5 * stiffness * error
            starts.append(start)
        dry = [c for c in q.candidates if c == "coulomb_friction"]
        best = min((self._fit(s, [*within, *dry], 8) for s in starts), key=lambda f: f.cost)
        chosen = [*within, *dry]
        for more, values in self._stages():
            if not set(more) <= set(q.candidates):
                more = [c for c in more if c in q.candidates]
                if not more:
                    continue
            tries = [best]
            for value in values(best):
                start = best.parameters.copy()
                for name, x in value.items():
                    start[INDEX[name]] = x
                tries.append(self._fit(start, [*chosen, *more], 8))
            better = min(tries, key=lambda f: f.cost)
            chosen += more
            best = better if better.free else best
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
            return [{"torque_limit": 0.7 * t, "speed_limit": 1.5 * v}, {"torque_limit": 0.9 * t, "speed_limit": 5 * v}]

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
        kept = list(self.q.candidates)
        best = self.everything()
        losses = dict.fromkeys(kept, 0.0)
        while True:
            for cause in sorted(kept, key=losses.__getitem__):
                less = self._less(best, kept, cause)
                losses[cause] = self._loss(best, less)
                if not self._needed(best, less):
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

    def _less(self, best: Fit, kept: Sequence[str], cause: str) -> Fit:
        """Return the fit without a cause."""
        start = best.parameters
        for c in _with(cause):
            start = self._without(start, c)
        return self._fit(start, [c for c in kept if c not in _with(cause)], 5)

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
        floor = self.q.resolution / np.sqrt(12.0)
        return bool(
            blocks.mean() > LEAST_T * spread
            and gain > LEAST_GAIN * rms
            and gain > LEAST_STEPS * floor**2 / max(rms, floor)
        )

    # ---- what is said ------------------------------------------------------------------------

    def _estimates(self, best: Fit) -> tuple[dict[str, Estimate], Array]:
        """Return each fitted parameter with its 95 % interval, and their correlation.

        The scores' scatter between blocks of time stands for noise of any colour.
        """
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
                value=value, ci95=(max(value - half, p.low), min(value + half, p.high)), on_bound=near
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
