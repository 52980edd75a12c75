"""The columns of all causes on all joints, and models as choices among them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.causes import Cause, Shape
from stiction_envs.gap.linear.grams import Gram
from stiction_envs.gap.linear.joint_grams import JointGrams
from stiction_envs.gap.linear.model_columns import ModelColumns
from stiction_envs.gap.selection.joint_columns import JointColumns, Kept
from stiction_envs.gap.selection.row_weights import (
    certain,
    dependent_rows,
    explained,
    filtered_rows,
)
from stiction_envs.gap.signals.dataset import Data

Array = NDArray[np.float64]
Numbers = tuple[float, ...]
ARM = -1
"""The joint's number of a `Candidate` of all joints."""
SCALES = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
"""Sizes of the random effects over their prior that are tried [-]; assumed."""
ALLOWED = 3.32
"""Drop of the log likelihood to the ends of a 99 % interval [nats]: half of the quantile of χ² with
one degree of freedom. Not 95 %, since one size stands for mass, centre and shape."""
PIECE = 4096
"""Number of rows of columns that are taken into double precision at once; assumed."""
THREADS = 4
"""Largest number of threads that compute columns: each needs its own memory; assumed."""


class Candidate(NamedTuple):
    """One cause on one joint (from 0), or on all of them, with its nonlinear parameters.

    The candidates in a model are its terms.
    """

    cause: str
    joint: int
    shape: Shape
    small: bool = False
    """Whether it is a random effect: an error within its tolerance, never named."""


class RegressorLibrary:
    """Columns of every candidate that these data can show, with their sums per block."""

    grams: JointGrams
    """Those sums."""

    def __init__(
        self, data: Data, causes: Sequence[Cause], instead_of: RegressorLibrary | None = None
    ) -> None:
        """Compute all columns; nonlinear causes choose the parameters to try.

        Columns that do not depend on what the gears carry are taken from ``instead_of``, a library
        of the same recording, which cannot be used afterwards.
        """
        self.data, self.causes = data, {c.name: c for c in causes}
        self._before = instead_of
        if instead_of is not None:
            instead_of._keep_for(data, causes)
        self.not_identifiable: dict[tuple[str, int], str] = {}
        """Why these data cannot show a cause on a joint."""
        self.candidates: list[Candidate] = []
        self._last: tuple[Candidate, NDArray[np.floating]] | None = None
        self._at: dict[tuple[Candidate, int], tuple[int, ...]] = {}
        self._sizes: dict[Candidate, int] = {}
        self._columns = JointColumns(data.n, len(data.t))
        self._limits: dict[tuple[Candidate, float], tuple[Numbers, Numbers, Numbers]] = {}
        self._models: dict[tuple[float, tuple[Candidate, ...]], ModelColumns] = {}
        self.residual = data.residual
        own = data.settings.candidates
        share = own.diagnosed if data.diagnosed else own.given
        extra = np.sqrt(np.mean(np.square(data.nominal - data.rigid), axis=0))
        self.known = share * extra / data.noise
        """(n,) root mean square error assumed for the nominal model's friction, over the noise."""
        self.independent_rows = filtered_rows(data)
        """Number of rows that form one independent observation."""
        self.scale = 0.0
        """Size of the random effects over their prior [-]; 0 for none."""
        self.settled = False
        """Whether a search has ended: a term's own torque must be large then, beside random effects
        that would make up for it; before, what the model without it leaves."""
        arm_wide = [c for c in causes if c.arm_wide and not c.random]
        each = [c for c in causes if not c.arm_wide]
        self.random = [Candidate(c.name, ARM, (), small=True) for c in causes if c.random]
        """Small errors of all links, whose columns are the first of every joint."""
        for term in self.random:
            self._add(term, self._rows(term))
        first = self._made(0, each)  # also computes what all joints need from the recording
        with ThreadPoolExecutor(min(len(os.sched_getaffinity(0)), THREADS)) as pool:
            made = pool.map(lambda j: self._made(j, each), range(1, data.n))
            for offered in chain([first], made):
                for term, columns in offered:
                    self._add(term, columns)
        for cause in arm_wide:
            for term, columns in self._offered(cause, ARM, self.residual[:, 0]):
                self._add(term, columns)
        order = [
            *((c.name, j) for j in range(data.n) for c in each),
            *((c.name, ARM) for c in causes),
        ]
        reasons = self.not_identifiable  # in whatever order threads came to them
        self.not_identifiable = {x: reasons[x] for x in order if x in reasons}
        self._begun, self._before = len(self.candidates), None
        self.certain = np.stack([certain(data, j) for j in range(data.n)], axis=1)
        """(T, n) weight of rows by how well friction is known there."""
        self.weight = self.certain.copy()
        self.inflation = np.full(data.n, own.prior_rows * self.independent_rows)
        """(n,) number of rows that form one independent observation of the noise floor."""
        self.least_inflation = self.inflation.copy()
        """(n,) the same by what all linear causes together leave."""
        self._reweigh()
        self.grams = JointGrams(
            [self._gram(j, self._columns.parts[j]) for j in range(data.n)], self.inflation
        )

    def _cleaned(self, joint: int) -> Array:
        """Return (T,) residual after the causes that are `removed_first` were subtracted."""
        r, first = self.residual[:, joint], [c for c in self.causes.values() if c.removed_first]
        if not first:
            return np.asarray(r)
        parts = [c.columns(self.data, joint, ()) for c in first]
        x = np.concatenate(parts, axis=1)
        return np.asarray(r - x @ np.linalg.lstsq(x, r, rcond=None)[0])

    def _made(self, joint: int, causes: Sequence[Cause]) -> list[tuple[Candidate, list[Kept]]]:
        """Return the candidates of a joint with their columns."""
        left = self._cleaned(joint)
        return [x for cause in causes for x in self._offered(cause, joint, left)]

    def _offered(self, cause: Cause, joint: int, left: Array) -> list[tuple[Candidate, list[Kept]]]:
        if (before := self._before) is not None and before._holds(cause, self.data):
            if reason := before.not_identifiable.get((cause.name, joint)):
                self.not_identifiable[cause.name, joint] = reason
            same = before.candidates[: before._begun]
            mine = [t for t in same if (t.cause, t.joint) == (cause.name, joint)]
            return [(t, [before._columns.at(joint, before._at[t, joint])]) for t in mine]
        if reason := cause.why_not_identifiable(self.data, max(joint, 0)):
            self.not_identifiable[cause.name, joint] = reason
            return []
        shapes = cause.shapes(self.data, max(joint, 0), left)
        terms = (Candidate(cause.name, joint, x) for x in shapes)
        return [(t, self._rows(t)) for t in terms]

    def _holds(self, cause: Cause, data: Data) -> bool:
        """Whether the columns of a cause of single joints are the same for other data."""
        mine = self.data
        same = mine.recording is data.recording and mine.nominal is data.nominal
        return (
            same
            and mine.friction.is_same(data.friction)
            and self.causes.get(cause.name) is cause
            and not (cause.depends_on_load or cause.coupled or cause.arm_wide)
        )

    def _keep_for(self, data: Data, causes: Sequence[Cause]) -> None:
        """Keep only the columns that are the same for other data: all at once fill the memory."""
        same = {c.name for c in causes if self._holds(c, data)}
        del self.grams
        self.keep([t for t in self._sizes if t.cause in same])

    def keep(self, terms: Sequence[Candidate]) -> None:
        """Give back the memory of all columns but those of some terms; nothing can be refined."""
        kept = frozenset(terms)
        for j in range(self.data.n):
            some = [at for (t, joint), at in self._at.items() if joint == j and t in kept]
            self._columns.keep(j, some)
        self._models.clear()

    def tried(self, term: Candidate) -> list[Shape]:
        """Return the nonlinear parameters of a cause that are tried on its joint."""
        return [t.shape for t in self.candidates if (t.cause, t.joint) == (term.cause, term.joint)]

    def affected_joints(self, term: Candidate) -> list[int]:
        """Return the joints (from 0) whose torques a candidate acts on."""
        if term.joint == ARM or self.causes[term.cause].coupled:
            return list(range(self.data.n))
        return [term.joint]

    def _rows(self, term: Candidate) -> list[Kept]:
        """Return the (k, T) columns on each joint that a candidate acts on, each in one piece.

        They are copied where they are not: a view would keep the whole array in memory.
        """
        cause, joints = self.causes[term.cause], self.affected_joints(term)
        if cause.coupled:
            spread = cause.spread(self.data, term.joint, term.shape)
            return [np.ascontiguousarray(spread[:, j].T, dtype=np.float32) for j in joints]
        each = (cause.columns(self.data, j, term.shape) for j in joints)
        return [np.ascontiguousarray(x.T, dtype=np.float32) for x in each]

    def needs(self, name: str) -> tuple[str, ...]:
        """Return the causes that a cause needs: none if the nominal model has friction."""
        return () if self.data.has_friction else self.causes[name].needs

    def complexity(self, terms: Sequence[Candidate]) -> int:
        """Return the number of free parameters of some terms, linear and nonlinear."""
        have = {t.cause for t in terms}
        return sum(
            self.size(t)
            + len(t.shape)
            - self.causes[t.cause].dependent_parameters
            # a cause without another that it needs is less simple
            + sum(name not in have for name in self.needs(t.cause))
            for t in terms
            if not t.small
        )

    def _add(self, term: Candidate, rows: list[Kept]) -> None:
        self._sizes[term] = len(rows[0])
        for joint, columns in zip(self.affected_joints(term), rows, strict=True):
            self._at[term, joint] = self._columns.add(joint, columns)
        if not term.small:
            self.candidates.append(term)

    def refine(self, terms: Iterable[Candidate]) -> None:
        """Add candidates with other nonlinear parameters, and update the sums."""
        for term in terms:
            if term not in self.candidates and not term.small:
                self._add(term, self._rows(term))
        joints = self.grams.joints
        for j in range(self.data.n):  # those of before go one by one: all at once fill the memory
            joints[j] = self._grown(j)
        self.grams = JointGrams(joints, self.inflation)

    def _gram(self, joint: int, parts: Sequence[Kept]) -> Gram:
        """Return the sums of columns on a joint, in parts (k, T)."""
        d = self.data
        weight = self.weight[:, joint] / d.noise[joint] ** 2
        return Gram.of_parts(parts, self.residual[:, joint], d.block, weight, d.blocks)

    def _parts(self, terms: Sequence[Candidate], joint: int) -> list[Kept]:
        """Return the columns of a model on a joint, in parts (k, T), the first without columns."""
        some = [t for t in terms if joint in self.affected_joints(t)]
        kept = (self._columns.at(joint, self._at[t, joint]) for t in some)
        return [self._columns.parts[joint][0], *kept]

    def _grown(self, joint: int) -> Gram:
        """Return the sums of a joint with the columns that were added since."""
        gram, d = self.grams.joints[joint], self.data
        new = self._columns.width[joint] - gram.xr.shape[1]
        if not new:
            return gram
        before, more = list(self._columns.parts[joint]), list[Kept]()
        while new > sum(len(x) for x in more):
            more.insert(0, before.pop())
        weight = self.weight[:, joint] / d.noise[joint] ** 2
        return gram.with_columns(before, more, self.residual[:, joint], d.block, weight)

    def _reweigh(self) -> None:
        """Reduce the weight of rows that no linear model explains (spikes, contacts)."""
        d = self.data
        huber, n = d.settings.candidates.huber, d.n
        linear = [t for t in self.candidates if self.causes[t.cause].is_linear]
        self.scale = 1.0
        terms = [*self.random, *linear]
        model = self.model_columns(terms)
        parts = [self._parts(terms, j) for j in range(n)]
        grams = JointGrams([self._gram(j, parts[j]) for j in range(n)], self.inflation)
        r = model.random
        among = tuple(tuple(range(r, r + len(at))) for at in model.columns)
        c = grams.fit(replace(model, columns=among))
        for j, at in enumerate(model.coefficients):
            e = self.residual[:, j] - np.concatenate(parts[j]).T @ c[[*range(r), *at]]
            self.weight[:, j] = self.certain[:, j] * explained(e, huber)
            self.least_inflation[j] = dependent_rows(d, j, e, self.weight[:, j])
        self.scale = 0.0

    def given(self, inflation: Array, scale: float) -> RegressorLibrary:
        """Return the library itself with another noise and size of the random effects."""
        self.inflation, self.scale = inflation, scale
        self._models.clear()  # thousands, most of them with the scale of before
        self.grams = JointGrams(self.grams.joints, self.inflation)
        return self

    def add_set_up(self, terms: Sequence[Candidate]) -> list[Candidate]:
        """Return a model with small errors of all causes that have a tolerance.

        They share the causes' columns; one of what is named would be the same torque twice.
        """
        named = [t for t in terms if not t.small]
        have, small = {(t.cause, t.joint) for t in named}, list(self.random)
        for term in self.candidates:
            usual = self.causes[term.cause].tolerance(self.data, term.joint)
            if (term.cause, term.joint) in have or any(term.shape) or not usual:
                continue
            small.append(term._replace(small=True))
            self._sizes[small[-1]] = self._sizes[term]
            for joint in self.affected_joints(term):
                self._at[small[-1], joint] = self._at[term, joint]
        return [*small, *named]

    def settle(self) -> None:
        """Count terms by their own torque from now on."""
        self.settled = True
        self.grams.gains.clear()

    def noise_under(self, terms: Sequence[Candidate]) -> Array:
        """Return (n,) `inflation` by what a model leaves."""
        c = self.grams.fit(self.model_columns(terms))
        left = (self.residual[:, j] - self.torque(terms, c, j) for j in range(self.data.n))
        rows = [dependent_rows(self.data, j, e, self.weight[:, j]) for j, e in enumerate(left)]
        return np.array(rows)

    def likeliest(
        self, terms: Sequence[Candidate], scales: Numbers = SCALES
    ) -> tuple[float, float]:
        """Return the largest log evidence of a model [nats], and the size of random effects.

        The size is the largest that the data allow: the upper end of its 99 % interval by the
        restricted likelihood (H. Patterson, R. Thompson, "Recovery of inter-block information when
        block sizes are unequal", Biometrika 1971), so that parameters are not too sure. It is zero
        where the data are likeliest without random effects. ``scales`` are the sizes to try, in
        order.
        """
        before = self.scale
        tried = (1.0,) if self.data.recording.link_factor is not None else scales
        found = []
        for self.scale in tried:
            found.append(self.grams.log_evidence(self.model_columns(self.beside(terms))))
        self.scale = before
        best = max(found)
        if found[0] == best:
            return best, tried[0]
        return best, max(s for s, x in zip(tried, found, strict=True) if x > best - ALLOWED)

    def beside(self, terms: Sequence[Candidate]) -> list[Candidate]:
        """Return the named terms beside small errors of all links, as far as there are any."""
        return [*(self.random if self.scale > 0 else []), *(t for t in terms if not t.small)]

    # ---- models ------------------------------------------------------------------------------

    def model_columns(self, terms: Sequence[Candidate]) -> ModelColumns:
        """Return the model of some terms; arm-wide terms share their coefficients."""
        key = self.scale, tuple(terms)
        if key not in self._models:
            self._models[key] = self._model_columns(terms)
        return self._models[key]

    def _model_columns(self, terms: Sequence[Candidate]) -> ModelColumns:
        columns: list[list[int]] = [[] for _ in range(self.data.n)]
        where: list[list[int]] = [[] for _ in range(self.data.n)]
        low: list[float] = []
        high: list[float] = []
        firm: list[float] = []
        for term in terms:
            lowest, highest, precision = self._limits_of(term)
            mine = range(len(low), len(low) + len(lowest))
            for joint in () if term in self.random else self.affected_joints(term):
                columns[joint] += self._at[term, joint]
                where[joint] += mine
            low += lowest
            high += highest
            firm += precision
        random = sum(self.size(t) for t in terms if t in self.random)
        by_joint = tuple(map(tuple, columns)), tuple(map(tuple, where))
        return ModelColumns(*by_joint, tuple(low), tuple(high), tuple(firm), random)

    def _limits_of(self, term: Candidate) -> tuple[Numbers, Numbers, Numbers]:
        """Return lowest and highest coefficients of a candidate, and the precision of its prior."""
        key = term, self.scale if term.small else 1.0
        if key not in self._limits:
            low, high = self.bounds(term)
            firm = np.square(1 / self.prior(term))
            self._limits[key] = tuple(low.tolist()), tuple(high.tolist()), tuple(firm.tolist())
        return self._limits[key]

    def bounds(self, term: Candidate) -> tuple[Array, Array]:
        """Return lowest and highest coefficients of a candidate, (k,) each."""
        low, high = self.causes[term.cause].bounds(self.data, term.joint)
        return low[: self.size(term)], high[: self.size(term)]

    def prior(self, term: Candidate) -> Array:
        """Return (k,) prior standard deviations of a candidate's coefficients."""
        cause = self.causes[term.cause]
        if not term.small:
            return cause.prior(self.data, term.joint)[: self.size(term)]
        return np.full(self.size(term), self.scale * (cause.tolerance(self.data, term.joint)))

    def size(self, term: Candidate) -> int:
        """Return the number of coefficients."""
        return self._sizes[term]

    def own(self, terms: Sequence[Candidate], some: Sequence[Candidate]) -> NDArray[np.bool_]:
        """Return (P,) which coefficients of a model belong to some of its terms."""
        sizes = [self.size(t) for t in terms]
        return np.repeat(np.array([t in some for t in terms], dtype=bool), sizes)

    def split(self, terms: Sequence[Candidate], c: Array) -> list[Array]:
        """Return the coefficients of each term."""
        ends = np.cumsum([self.size(t) for t in terms], dtype=int)
        return np.split(c, ends, axis=-1)[:-1]

    def fitted(self, terms: Sequence[Candidate]) -> list[Array]:
        """Return the coefficients of each term, fitted to all blocks."""
        return self.split(terms, self.grams.fit(self.model_columns(terms)))

    def torque(self, terms: Sequence[Candidate], c: Array, joint: int) -> Array:
        """Return (T,) torque of a model on a joint [N·m]."""
        out = np.zeros(len(self.data.t))
        for term, mine in zip(terms, self.split(terms, c), strict=True):
            if joint in self.affected_joints(term):
                out += self.part(term, joint, mine)
        return out

    def part(self, term: Candidate, joint: int, mine: Array) -> Array:
        """Return (T,) torque of a candidate on a joint [N·m], with its coefficients."""
        if not self._columns.holds(joint, at := self._at.get((term, joint), ())):
            return np.asarray(self.columns(term, joint) @ mine)
        rows = self._columns.at(joint, at)  # in double precision, all of them are large
        pieces = (rows[:, k : k + PIECE] for k in range(0, rows.shape[1], PIECE))
        return np.concatenate([mine @ x.astype(np.float64) for x in pieces])

    def columns(self, term: Candidate, joint: int) -> Array:
        """Return the (T, k) columns of a candidate on a joint; not to be changed."""
        if self._columns.holds(joint, at := self._at.get((term, joint), ())):
            return self._columns.at(joint, at).T.astype(np.float64)
        cause = self.causes[term.cause]
        if cause.coupled:
            if self._last is None or self._last[0] != term:
                self._last = (term, cause.spread(self.data, term.joint, term.shape))
            return self._last[1][:, joint].astype(np.float64)
        return cause.columns(self.data, joint, term.shape).astype(np.float64)
