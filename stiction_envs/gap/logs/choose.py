"""Which causes: forward and backward, by the error of blocks that were held out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.logs.columns import ARM, Library, Term

Array = NDArray[np.float64]
STANDS = 3.0
"""Standard errors over blocks by which a gain must exceed zero [-]; assumed, with 12 blocks."""
LEAST_GAIN = 0.02
"""Least part of a joint's held-out squared error that a cause must take away [-]; assumed."""
WINS, CLEAR_GAIN = 0.9, 0.05
"""Part of the blocks that must improve, and of the squared error, where blocks differ much [-];
assumed."""
LEAST_TORQUE = 1.5
"""Least torque of a cause, root mean square, over the noise floor of some joint [-]; assumed."""
ALIKE_GAIN, ALIKE_ERRORS = 0.01, 2.0
"""What explains as much but for this part, or for so many standard errors, is as good [-];
assumed."""
MOST_TERMS = 40
SHORTLIST = 6
"""Causes per joint whose held-out error is worked out in each round."""


@dataclass(frozen=True)
class Gain:
    """What a change of the model does to the held-out error."""

    total: float
    """Squared error taken away, in units of noise variance."""
    error: float
    """Its standard error over blocks."""
    part: float
    """Largest part of a joint's squared error that is taken away [-]."""
    wins: float
    """Part of the blocks whose error falls [-]."""

    @property
    def stands(self) -> bool:
        """Whether it stands against the noise from block to block.

        By its mean over blocks, or, where blocks differ much in size, by winning almost all.
        """
        if self.part <= LEAST_GAIN:
            return False
        return self.total > STANDS * self.error or (self.wins >= WINS and self.part > CLEAR_GAIN)


def gain(before: Array, after: Array) -> Gain:
    """Compare held-out errors (joints, B)."""
    each = (before - after).sum(axis=0)
    count = len(each)
    error = float(each.std(ddof=1) * np.sqrt(count)) if count > 1 else np.inf
    base = np.maximum(before.sum(axis=1), 1e-300)
    part = (before - after).sum(axis=1) / base
    return Gain(float(each.sum()), error, float(part.max()), float(np.mean(each > 0)))


@dataclass(frozen=True, eq=False)
class Offer:
    """Terms that could be added."""

    added: list[Term]
    found: Gain
    less: Array
    """(joints, B) squared error that they take away."""


class Chooser:
    """Builds a model term by term."""

    def __init__(self, library: Library, progress: Callable[[int], None] | None = None) -> None:
        self.library = library
        self._progress = progress or (lambda _: None)
        self.terms: list[Term] = []

    def held_out(self, terms: Sequence[Term]) -> Array:
        """Return (joints, B) held-out squared errors of a model."""
        return self.library.stack.held_out(self.library.pick(terms))

    def choose(self) -> list[Term]:
        """Return the terms that stand, in the order in which they were found."""
        now = self.held_out([])
        known: dict[int, list[Offer]] = {}
        for step in range(MOST_TERMS):
            for joint in [ARM, *range(self.library.data.n)]:
                if joint not in known:
                    known[joint] = self._standing(joint, now)
            best = self._simplest([x for offers in known.values() for x in offers])
            if best is None:
                break
            self.terms += best.added
            now = self.held_out(self.terms)
            joint = best.added[-1].joint
            if len(self.library.reach(best.added[-1])) > 1:
                known.clear()
            else:
                known.pop(joint, None)
                known.pop(ARM, None)
            self._progress(step + 1)
        self._prune()
        return self.terms

    def _simplest(self, offers: list[Offer]) -> Offer | None:
        """Return the best offer, or one with fewer parameters that is as good."""
        if not offers:
            return None
        best = max(offers, key=lambda x: x.found.total)
        size = self.library.complexity
        for other in sorted(offers, key=lambda x: (size(x.added), -x.found.total)):
            if size(other.added) >= size(best.added):
                break
            each = (best.less - other.less).sum(axis=0)
            error = float(each.std(ddof=1) * np.sqrt(len(each)))
            lost = float(each.sum())
            if lost < ALIKE_GAIN * best.found.total or (
                lost < ALIKE_ERRORS * error and (lost < 5 * ALIKE_GAIN * best.found.total)
            ):
                return other
        return best

    def _standing(self, joint: int, now: Array) -> list[Offer]:
        """Return what stands on a joint, by held-out error."""
        out = []
        for _, added in self._offers(joint):
            after = self.held_out([*self.terms, *added])
            found = gain(now, after)
            if found.stands and self._visible([*self.terms, *added], added):
                out.append(Offer(added, found, now - after))
        return out

    def _offers(self, joint: int) -> list[tuple[float, list[Term]]]:
        """Return the best term of each cause on a joint by its in-sample gain, best first."""
        lib = self.library
        have = {(t.cause, t.joint) for t in self.terms}
        weight = np.ones(lib.stack.blocks)

        def loss(terms: list[Term], joints: list[int]) -> float:
            pick = lib.pick(terms)
            c = lib.stack.fit(pick, weight)
            return float(lib.stack.errors(pick, c)[joints].sum())

        everywhere = list(range(lib.data.n))
        tied = [t for t in self.terms if joint in lib.reach(t)]
        now = {1: loss(tied, [joint]) if joint != ARM else 0.0}
        now[lib.data.n] = loss(self.terms, everywhere)
        best: dict[str, tuple[float, list[Term]]] = {}
        for term in lib.terms:
            if term.joint != joint or (term.cause, joint) in have:
                continue
            added = [term]
            for name in lib.needs(term.cause):
                if (name, joint) not in have:
                    parents = [t for t in lib.terms if t.cause == name and t.joint == joint]
                    added = [*parents[:1], *added]
            joints = lib.reach(term)
            beside = tied if len(joints) == 1 else self.terms
            value = now[len(joints)] - loss([*beside, *added], joints)
            if value > best.get(term.cause, (0.0, []))[0]:
                best[term.cause] = (value, added)
        return sorted(best.values(), key=lambda x: -x[0])[:SHORTLIST]

    def _visible(self, terms: list[Term], added: list[Term]) -> bool:
        """Whether what was added makes a torque that the noise does not hide."""
        lib = self.library
        c = lib.split(terms, lib.stack.fit(lib.pick(terms)))
        for term, mine in zip(terms, c, strict=True):
            if term not in added:
                continue
            if lib.causes[term.cause].small(mine, term.shape):
                return False
            torques = ((j, lib.columns(term, j) @ mine) for j in lib.reach(term))
            if not any(
                np.sqrt(np.mean(torque**2)) > LEAST_TORQUE * lib.data.noise[j]
                for j, torque in torques
            ):
                return False
        return True

    def _prune(self) -> None:
        """Take out terms that no longer stand, the weakest first."""
        while self.terms:
            now = self.held_out(self.terms)
            weakest: tuple[float, Term] | None = None
            for term in self.terms:
                needed = any(
                    t.joint == term.joint and term.cause in self.library.needs(t.cause)
                    for t in self.terms
                )
                if needed:
                    continue
                rest = [t for t in self.terms if t != term]
                found = gain(self.held_out(rest), now)
                if not found.stands and (weakest is None or found.total < weakest[0]):
                    weakest = (found.total, term)
            if weakest is None:
                return
            self.terms = [t for t in self.terms if t != weakest[1]]
