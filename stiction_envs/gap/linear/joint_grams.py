"""Models of all joints as small linear systems on the sums of `grams.py`.

Fits, held-out errors, likelihoods and resamples of a model, with coefficients that joints share,
priors, and random effects that are eliminated once for all models.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.linear.bounded_fit import RIDGE, solve, solve_all
from stiction_envs.gap.linear.grams import Gram
from stiction_envs.gap.linear.joint_sums import Shown, add_equations, add_rows, products
from stiction_envs.gap.linear.model_columns import ModelColumns, of_joints

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Method = TypeVar("Method", bound=Callable[..., object])
RECENT = 4
"""Number of models whose equations are kept [-]: fits and likelihoods of two are compared."""


def _kept(method: Method) -> Method:
    """Keep the result of a method of `JointGrams` for each model: the search repeats models."""

    @wraps(method)
    def kept(self: JointGrams, model: ModelColumns) -> object:
        key = method.__name__, model
        if key not in self._results:
            self._results[key] = method(self, model)
        return self._results[key]

    return cast(Method, kept)


@dataclass(frozen=True, eq=False)
class Eliminated:
    """Random effects taken out of the normal equations of F fits: to all blocks, or 1 + B."""

    root: Array
    """(F, r, r) L⁻¹."""
    mixed: list[Array]
    """(F, P, r) (L⁻¹DᵀWX)ᵀ for each joint."""
    right: Array
    """(F, r) L⁻¹DᵀWr."""

    @classmethod
    def of(cls, joints: Sequence[Gram], inflation: Array, firm: Array, fits: int) -> Eliminated:
        """Eliminate the first r columns of all joints.

        Args:
            joints: their sums.
            inflation: (joints,) number of rows that form one independent observation.
            firm: (r,) precision of the prior.
            fits: 1 for all blocks only, or 1 + B.
        """
        r = len(firm)

        def left_out(each: Array, whole: Array) -> Array:
            return whole if fits == 1 else np.concatenate([whole, whole - each])

        both = [(g, g.whole, k) for g, k in zip(joints, inflation, strict=True)]
        own = sum(left_out(g.xx[:, :r, :r], w.xx[:, :r, :r]) / k for g, w, k in both)
        root = np.linalg.inv(np.linalg.cholesky(own + np.diag(firm)))
        across = np.swapaxes(root, 1, 2)
        mixed = [left_out(g.xx[..., :r], w.xx[..., :r]) @ across / k for g, w, k in both]
        along = sum(left_out(g.xr[:, :r], w.xr[:, :r]) / k for g, w, k in both)
        return cls(root, mixed, np.asarray(root @ np.asarray(along)[..., None])[..., 0])


class Reduced(NamedTuple):
    """A model's normal equations without its r random effects, for F fits."""

    xx: Array
    """(F, p, p) XᵀWX − ZᵀZ."""
    xr: Array
    """(F, p) XᵀWr − Zᵀz."""
    mixed: Array
    """(F, p, r) Zᵀ."""
    gone: Eliminated | None
    """What was eliminated; None without random effects."""


class JointGrams:
    """The Grams of all joints.

    Joints that share coefficients count by their independent observations: sums over joints are
    divided by the number of rows that form one (``inflation``). A prior counts as it is then.

    Random effects are eliminated from the equations of a model, A = Σ DᵀWD + P and L Lᵀ = A being
    computed once for each block that is left out: (XᵀWX − ZᵀZ) c = XᵀWr − Zᵀ z, Z = L⁻¹DᵀWX and
    z = L⁻¹DᵀWr (C. Henderson, "Best linear unbiased estimation and prediction under a selection
    model", Biometrics 1975).
    """

    def __init__(self, grams: Sequence[Gram], inflation: Array | None = None) -> None:
        self.joints = list(grams)
        self.inflation = np.ones(len(self.joints)) if inflation is None else inflation
        """(joints,) number of rows that form one independent observation."""
        self.blocks = len(grams[0].rr)
        self.counts = np.array([g.count.sum() for g in grams])
        """(joints,) number of rows, by their weights."""
        self._results: dict[tuple[str, ModelColumns], Any] = {}
        self._eliminated: dict[tuple[tuple[float, ...], int], Eliminated] = {}
        self._random: dict[tuple[int, int, bool], Shown] = {}
        self._recent: dict[ModelColumns, Reduced] = {}
        self._around: tuple[ModelColumns, Surroundings] | None = None
        self.gains: dict[Hashable, Any] = {}
        """What `selection.gain` found of these sums: a search asks again and again."""

    def system(self, model: ModelColumns, weight: Array | None = None) -> tuple[Array, Array]:
        """Return (xx, xr) of a model, over blocks with multiplicities ``weight`` (B,) or 1."""
        p = len(model.low)
        xx, xr = np.zeros((p, p)), np.zeros(p)
        for j, cols, at in of_joints(model):
            gram = self.joints[j]
            if weight is None:
                part, along = gram.whole.xx[0][cols[:, None], cols], gram.whole.xr[0][cols]
            else:
                part = np.einsum("b,bpq->pq", weight, gram.xx[:, cols[:, None], cols])
                along = np.einsum("b,bp->p", weight, gram.xr[:, cols])
            # each coefficient has at most one column of a joint
            xx[at[:, None], at] += part / self.inflation[j]
            xr[at] += along / self.inflation[j]
        xx[np.diag_indices(p)] += model.prior
        return xx, xr

    def fit(self, model: ModelColumns, weight: Array | None = None) -> Array:
        """Return the coefficients of a model, fitted to blocks with multiplicities ``weight``."""
        if weight is None:
            all_known = self._results.get((JointGrams._fits.__name__, model))
            return np.asarray((self._whole_fit(model) if all_known is None else all_known)[0])
        xx, xr = self.system(model, weight)
        return solve(xx, xr, np.array(model.low), np.array(model.high))

    @_kept
    def _whole_fit(self, model: ModelColumns) -> Array:
        """Return (1, P) the fit to all blocks: the first of `_fits`, without the others."""
        return self._solved(model, self._whole(model))

    @_kept
    def _fits(self, model: ModelColumns) -> Array:
        """Return (1 + B, P) the fit to all blocks, and the fits to all but each."""
        return self._solved(model, self._reduced(model, 1 + self.blocks))

    def _whole(self, model: ModelColumns) -> Reduced:
        """Return the equations of the fit to all blocks; those of the last models are kept."""
        if model not in self._recent:
            if len(self._recent) == RECENT:
                self._recent.pop(next(iter(self._recent)))
            self._recent[model] = self._reduced(model, 1)
        return self._recent[model]

    def _reduced(self, model: ModelColumns, fits: int) -> Reduced:
        """Return the equations of the fit to all blocks, and of the first fits to all but each."""
        r = model.random
        p = len(model.low) - r
        xx, xr = np.zeros((fits, p, p)), np.zeros((fits, p))
        gone = self._without_random(model, fits) if r else None
        mixed = np.zeros((fits, p, r))
        for j, columns, at in model.named:
            gram, to = self.joints[j], at - r
            add_equations(xx, xr, to, columns, gram.xx, gram.xr, self.inflation[j])
            if gone is not None:
                add_rows(mixed, to, columns, gone.mixed[j])
        xx[:, range(p), range(p)] += model.prior[r:]
        if gone is not None:
            xx -= mixed @ np.swapaxes(mixed, 1, 2)
            xr -= (mixed @ gone.right[..., None])[..., 0]
        return Reduced(xx, xr, mixed, gone)

    def _solved(self, model: ModelColumns, reduced: Reduced) -> Array:
        """Return (F, P) the coefficients of a model, random effects first."""
        r, (xx, xr, mixed, gone) = model.random, reduced
        c = solve_all(xx, xr, np.array(model.low[r:]), np.array(model.high[r:]))
        if gone is None:
            return c
        rest = gone.right - (np.swapaxes(mixed, 1, 2) @ c[..., None])[..., 0]
        random = (np.swapaxes(gone.root, 1, 2) @ rest[..., None])[..., 0]
        return np.concatenate([random, c], axis=1)

    def _without_random(self, model: ModelColumns, fits: int) -> Eliminated:
        """Return what is left of all columns once a model's random effects are eliminated."""
        firm = model.firm[: model.random]
        if (firm, fits) not in self._eliminated:
            found = Eliminated.of(self.joints, self.inflation, np.array(firm), fits)
            self._eliminated[firm, fits] = found
        return self._eliminated[firm, fits]

    def _products(
        self, model: ModelColumns, one: Array, two: Array, whole: bool = False
    ) -> Iterator[tuple[int, tuple[Array, Array, Array]]]:
        """Yield of the joints with columns their numbers, and what `products` returns.

        Args:
            model: the model.
            one: (B, P) coefficients c₁ of each block.
            two: (B, P) coefficients c₂.
            whole: whether all blocks count as one.
        """
        for j, columns, at in model.named:
            gram = self.joints[j].whole if whole else self.joints[j]
            shown = self._shown(j, model.random, whole)
            yield j, products(*shown, at, columns, gram.xx, gram.xr, one, two)

    def _shown(self, joint: int, r: int, whole: bool) -> Shown:
        """Return the sums of the random effects that a joint shows, of r: links beyond it."""
        key = joint, r, whole
        if key not in self._random:
            all_blocks = self.joints[joint].whole
            which = np.flatnonzero(np.diag(all_blocks.xx[0])[:r])
            gram = all_blocks if whole else self.joints[joint]
            xx = gram.xx[:, which[:, None], which]
            self._random[key] = Shown(which, *map(np.ascontiguousarray, (xx, gram.xr[:, which])))
        return self._random[key]

    @_kept
    def errors(self, model: ModelColumns) -> Array:
        """Return (joints,) squared errors that the fit leaves, in units of noise variance."""
        return self._left(model, self.fit(model)[None], whole=True)[:, 0]

    def block_systems(self, model: ModelColumns) -> tuple[Array, Array]:
        """Return xx (B, P, P) and xr (B, P) of a model in each block, without its prior."""
        p = len(model.low)
        xx, xr = np.zeros((self.blocks, p, p)), np.zeros((self.blocks, p))
        for j, cols, at in of_joints(model):
            gram = self.joints[j]
            xx[:, at[:, None], at] += gram.xx[:, cols[:, None], cols] / self.inflation[j]
            xr[:, at] += gram.xr[:, cols] / self.inflation[j]
        return xx, xr

    def leave_one_block_out(self, model: ModelColumns) -> Array:
        """Return (B, P) the fit to all blocks but each."""
        return np.asarray(self._fits(model)[1:])

    @_kept
    def held_out(self, model: ModelColumns) -> Array:
        """Return (joints, B) squared errors of each block under the fit of all others."""
        return self._left(model, self.leave_one_block_out(model))

    def held_out_less(self, model: ModelColumns, some: NDArray[np.bool_]) -> Array:
        """Return `held_out` with ``some`` (P,) coefficients at zero, the others as they were."""
        return self._left(model, self.leave_one_block_out(model) * ~some)

    def _left(self, model: ModelColumns, c: Array, whole: bool = False) -> Array:
        """Return (joints, B) squared errors of each block with its coefficients (B, P)."""
        out = np.array([(g.whole if whole else g).rr for g in self.joints])
        for j, (square, _, along) in self._products(model, c, c, whole):
            out[j] += square - 2 * along
        return np.maximum(out, 0.0)

    def cross_predicted(
        self, model: ModelColumns, rest: ModelColumns, own: NDArray[np.bool_]
    ) -> tuple[Array, Array]:
        """Return pᵀe and pᵀp (joints, B) of what a model predicts beyond a smaller one.

        Both are fitted to all blocks but the one they predict; p is the difference of their
        torques there, e is the error of the smaller one. Where the difference is real, pᵀe = pᵀp
        except for noise; where it is not, pᵀe is about zero.

        Args:
            model: the model.
            rest: the smaller model.
            own: (P,) which coefficients only the former has.
        """
        before = np.zeros((self.blocks, len(own)))
        before[:, ~own] = self.leave_one_block_out(rest)
        more = self.leave_one_block_out(model) - before
        pe, pp = np.zeros((2, len(self.joints), self.blocks))
        for j, (square, shared, along) in self._products(model, more, before):
            pp[j], pe[j] = square, along - shared
        return pe, pp

    def covariance(self, model: ModelColumns) -> Array:
        """Return (P, P) covariance of the coefficients, given their priors."""
        xx, _ = self.system(model)
        size = np.sqrt(np.maximum(np.diag(xx), 1e-200))
        across = np.outer(size, size)
        return np.asarray(np.linalg.inv(xx / across + RIDGE * np.eye(len(size))) / across)

    @_kept
    def log_evidence(self, model: ModelColumns) -> float:
        """Return the log marginal likelihood of the residual, up to a constant [nats].

        Coefficients are Gaussian with their prior. One without a prior costs what a prior would
        that a single independent observation gave, about its estimate (R. Kass, L. Wasserman, "A
        reference Bayesian test for nested hypotheses and its relationship to the Schwarz
        criterion", JASA 1995).
        """
        r, (xx, xr, mixed, gone) = model.random, self._whole(model)
        c, prior = self.fit(model)[r:], model.prior[r:]
        left = sum(
            float(g.whole.rr[0]) / k for g, k in zip(self.joints, self.inflation, strict=True)
        )
        misfit, volume = float(left - 2 * xr[0] @ c + c @ xx[0] @ c), 0.0
        if gone is not None:
            misfit -= float(gone.right[0] @ gone.right[0])
            volume = -2 * float(np.log(np.diag(gone.root[0])).sum())
            volume -= float(np.log(model.prior[:r]).sum())
        own, flat = np.diag(xx[0]) + np.square(mixed[0]).sum(axis=1), prior == 0
        observed = max(float((self.counts / self.inflation).sum()), 1.0)
        prior[flat] = np.maximum(own[flat], 1e-300) / observed
        size = np.sqrt(np.maximum(own, 1e-300))
        _, more = np.linalg.slogdet(xx[0] / np.outer(size, size) + RIDGE * np.eye(len(c)))
        volume += float(more) + float(np.log(np.square(size) / prior).sum())
        return -0.5 * (misfit + volume)

    def around(self, model: ModelColumns) -> Surroundings:
        """Return by how much further columns would reduce a model's error; the last is kept."""
        if self._around is None or self._around[0] != model:
            self._around = model, Surroundings(self, model)
        return self._around[1]

    def gained(self, model: ModelColumns, rest: ModelColumns) -> Array:
        """Return (joints,) torque of a model that a smaller one lacks, over the noise.

        Root mean square, from the gain of the fit to all blocks.
        """
        less = self.errors(rest) - self.errors(model)
        return np.asarray(np.sqrt(np.maximum(less, 0.0) / np.maximum(self.counts, 1.0)))

    def sizes(self, model: ModelColumns, own: NDArray[np.bool_]) -> Array:
        """Return (joints,) root mean square torque of some coefficients over the noise."""
        out, c = np.zeros(len(self.joints)), (self.fit(model) * own)[None]
        for j, (square, _, _) in self._products(model, c, c, whole=True):
            out[j] = square[0]
        return np.asarray(np.sqrt(np.maximum(out, 0.0) / np.maximum(self.counts, 1.0)))

    def resample(
        self, model: ModelColumns, times: int, rng: np.random.Generator, spread: Array | None = None
    ) -> Array:
        """Return (times, P) coefficients of bootstrap resamples of the blocks.

        Args:
            model: the model.
            times: number of resamples.
            rng: random generator.
            spread: (P,) standard deviations of the prior, whose mean is drawn too, so that what the
                blocks do not show stays as uncertain; None for no prior.
        """
        draws = rng.multinomial(self.blocks, np.full(self.blocks, 1 / self.blocks), size=times)
        systems = [self.system(model, w) for w in draws.astype(float)]
        xx, xr = (np.array(x) for x in zip(*systems, strict=True))
        if spread is not None and model.prior.any():
            own = np.where(model.prior > 0, spread, 0.0)
            xr = xr + model.prior * own * rng.normal(size=xr.shape)
        return solve_all(xx, xr, np.array(model.low), np.array(model.high))


class Surroundings:
    """A model, and by how much each of some further columns would reduce its error.

    The model's coefficients move along, those on a bound stay there.
    """

    def __init__(self, grams: JointGrams, model: ModelColumns) -> None:
        # the sums keep what they were asked last: a cycle would keep their memory
        self._grams: JointGrams = weakref.proxy(grams)
        self._model, self._c = model, grams.fit(model)
        self._free = (self._c > np.array(model.low)) & (self._c < np.array(model.high))
        xx = grams.system(model)[0][self._free][:, self._free]
        size = np.sqrt(np.maximum(np.diag(xx), 1e-300))
        normal = xx / np.outer(size, size) + RIDGE * np.eye(len(xx))
        self._root = np.linalg.inv(np.linalg.cholesky(normal)) / size
        self._known: dict[int, tuple[Array, Array]] = {}

    def _joint(self, joint: int) -> tuple[Array, Array]:
        """Return of all columns of a joint the gradient (P,) and what the model shares (P, p)."""
        if joint not in self._known:
            gram = self._grams.joints[joint].whole
            whole, along = gram.xx[0], gram.xr[0]
            gradient, mixed = along.copy(), np.zeros((len(self._root), len(along)))
            for _, cols, at in (x for x in of_joints(self._model) if x[0] == joint):
                gradient -= whole[:, cols] @ self._c[at]
                some, place = self._free[at], np.cumsum(self._free) - 1
                mixed[place[at[some]]] = whole[cols[some]] / self._grams.inflation[joint]
            self._known[joint] = gradient, mixed.T @ self._root.T
        return self._known[joint]

    def _systems(self, some: Sequence[ModelColumns]) -> tuple[Array, Array]:
        """Return (k, p, p) and (k, p) systems of further columns beside the model, p in each."""
        p, grams = len(some[0].low), self._grams
        xx, xr = np.zeros((len(some), p, p)), np.zeros((len(some), p))
        xx[:, range(p), range(p)] = [more.prior for more in some]
        across = np.zeros((len(some), p, len(self._root)))
        alike: dict[tuple[int, bytes], list[tuple[int, Index, Index]]] = {}
        for k, more in enumerate(some):
            for j, own, where in more.named:
                alike.setdefault((j, where.tobytes()), []).append((k, own, where))
        for (j, _), same in alike.items():
            rows, columns = np.array([k for k, *_ in same]), np.array([x for _, x, _ in same])
            at, (gradient, mixed) = same[0][2], self._joint(j)
            whole = grams.joints[j].whole.xx[0][columns[:, :, None], columns[:, None, :]]
            xx[rows[:, None, None], at[:, None], at] += whole / grams.inflation[j]
            xr[rows[:, None], at] += gradient[columns] / grams.inflation[j]
            across[rows[:, None], at] += mixed[columns]
        return xx - across @ np.swapaxes(across, 1, 2), xr

    def reductions(self, some: Sequence[ModelColumns]) -> list[float]:
        """Return by how much each of some columns would reduce the squared error.

        In independent observations of the noise. All of one size are solved at once.
        """
        out = [0.0] * len(some)
        sizes = [len(more.low) for more in some]
        for p in set(sizes):
            which = [k for k, size in enumerate(sizes) if size == p]
            xx, xr = self._systems([some[k] for k in which])
            low, high = (np.array([getattr(some[k], x) for k in which]) for x in ("low", "high"))
            for k, *system, c in zip(which, xx, xr, solve_all(xx, xr, low, high), strict=True):
                out[k] = float(2 * system[1] @ c - c @ system[0] @ c)
        return out
