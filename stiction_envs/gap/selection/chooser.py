"""Choose causes forward and backward, by the error of held-out blocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from stiction_envs.gap.causes import Shape
from stiction_envs.gap.selection.angle_ranges import simpler_by_angle
from stiction_envs.gap.selection.candidates import ARM, Candidate, RegressorLibrary
from stiction_envs.gap.selection.gain import Gain, gain, is_implausible, is_significant, pruned

ROUNDS = 3
"""Largest number of rounds of adding and removing; assumed."""
MOST_TERMS = 40
"""Largest number of terms that are added in a round; assumed."""


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
            if not is_significant(self.library, terms, added):
                continue
            *parents, child = added
            if parents and not is_significant(self.library, terms, parents):
                # the cause that it usually needs is absent
                if not self.library.causes[child.cause].standalone:
                    continue
                added, terms = [child], [*self.terms, child]
            if not is_implausible(self.library, terms, added) and is_significant(
                self.library, terms, [child]
            ):
                out.append(Offer(added, gain(self.library, terms, added)))
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
        pairs = [
            list(dict.fromkeys([*one, *two]))
            for one, two in combinations(self._offers(joint), 2)
            if one[-1].cause != two[-1].cause
        ]
        out, reductions = [], near.reductions([lib.model_columns(x) for x in pairs])
        for added in (x for x, size in zip(pairs, reductions, strict=True) if size > least):
            terms = [*self.terms, *added]
            together_and_alone = (
                is_significant(lib, terms, x) for x in (added, *([y] for y in added))
            )
            if all(together_and_alone) and not is_implausible(lib, terms, added):
                out.append(Offer(added, gain(lib, terms, added)))
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
        own = [t for t in lib.candidates if t.joint == joint]
        offered: list[list[Candidate]] = []
        for term in (t for t in own if (t.cause, joint) not in barred):
            needs = [x for x in lib.needs(term.cause) if (x, joint) not in have]
            offered.append([*(t for name in needs for t in own if t.cause == name), term])
        best: dict[tuple[str, Shape], tuple[float, list[Candidate]]] = {}
        values = near.reductions([lib.model_columns(added) for added in offered])
        for added, value in zip(offered, values, strict=True):
            term = added[-1]
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
