"""A trained policy as numbers: it runs with numpy alone and is stored in a file that runs no code.

policy = Policy.load("policy.zip")
policy.check(robot="panda", environment="GTE-v0", ...)     # what it was trained for
action, _ = policy.predict(observation)                    # [N·m, Hz]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Self

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.compiled import compiled
from stiction_envs.errors import StictionError, unknown
from stiction_envs.method_settings import Positive
from stiction_envs.reporting.json_text import JsonRecord
from tuning.policies.policy_file import Array, read_archive, write_archive

FORMAT = "stiction-envs policy 1"
ACTIVATIONS = ("tanh", "relu")
"""Activations of the hidden layers."""
OUTPUTS = ("tanh", "clip")
"""How an action is limited to [-1, 1] of its range."""


@dataclass(frozen=True, kw_only=True)
class Card:
    """Description of a policy, besides its numbers."""

    robot: str
    """Name of the arm."""
    environment: str
    """End of the environment's identifier with its version: ``GTE-v0``."""
    observation_names: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]
    """Names of all elements, in order."""
    interval: Positive
    """Time between two actions [s]."""
    activation: str
    """One of `ACTIVATIONS`."""
    output: str
    """One of `OUTPUTS`."""
    clip: Positive
    """Bound of normalised observations."""
    epsilon: Positive
    """Added to the variance in the normalisation."""
    training: JsonRecord
    """Origin: algorithm, steps, seed, versions and other facts; for information only."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Policy:
    """Observation → normalised → layers → amplitudes [N·m] and frequencies [Hz].

    A row of a batch gives the same bits as the row alone.
    """

    card: Card
    low: Array
    """(2n,) lowest action: n amplitudes [N·m], n frequencies [Hz]."""
    high: Array
    """(2n,) highest action."""
    mean: Array
    """(observations,) mean of the observations in training."""
    variance: Array
    """(observations,) their variance."""
    weights: tuple[Array, ...]
    """(out, in) of every layer."""
    biases: tuple[Array, ...]
    """(out,) of every layer."""

    def predict(
        self,
        observation: ArrayLike,
        state: object = None,
        episode_start: object = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float64], None]:
        """Return the mean action in the units of the environment; interface of Stable-Baselines3.

        Args:
            observation: (observations,) or (M, observations).
            state: not used: the policy has no memory.
            episode_start: not used.
            deterministic: not used: the policy is deterministic.

        Returns:
            (2n,) or (M, 2n) amplitudes [N·m] and frequencies [Hz], and None.

        Raises:
            StictionError: an observation of another shape.
        """
        x = np.asarray(observation, dtype=float)
        size = len(self.mean)
        if x.ndim not in (1, 2) or x.shape[-1] != size:
            raise StictionError(
                f"observation has shape {x.shape}: expected ({size},) or (M, {size})"
            )
        y = (x.reshape(-1, size) - self.mean) / np.sqrt(self.variance + self.card.epsilon)
        # in single precision, as the networks were trained
        y = np.clip(y, -self.card.clip, self.card.clip).astype(np.float32).astype(float)
        last = len(self.weights) - 1
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            y = _layer(y, weight, bias)
            if k < last:
                y = np.tanh(y) if self.card.activation == "tanh" else np.maximum(y, 0.0)
        y = np.tanh(y) if self.card.output == "tanh" else np.clip(y, -1.0, 1.0)
        # −1 is exactly the lowest action: no dither
        action = self.low + 0.5 * (y + 1.0) * (self.high - self.low)
        return action.reshape(*x.shape[:-1], len(self.low)), None

    # ---- where it belongs --------------------------------------------------------------------

    def check(
        self,
        *,
        robot: str,
        environment: str,
        observation_names: Sequence[str],
        interval: float,
    ) -> None:
        """Raise a StictionError that names the difference if this policy is for something else.

        Args:
            robot: name of the arm.
            environment: end of the identifier, ``GTE-v0``.
            observation_names: of the environment.
            interval: time between two actions [s].
        """
        card = self.card
        kind, version = card.environment.split("-")
        if kind != environment.split("-")[0] or card.robot != robot:
            mine = f"the {kind} environment of {card.robot}"
            other = f"the {environment.split('-')[0]} environment of {robot}"
            raise StictionError(f"policy for {mine}: expected one for {other}")
        if version != environment.split("-")[1]:
            raise StictionError(f"policy for {card.environment}: expected one for {environment}")
        names = tuple(observation_names)
        if card.observation_names != names:
            more = [n for n in card.observation_names if n not in names]
            less = [n for n in names if n not in card.observation_names]
            words = [f"without {', '.join(less[:3])}"] if less else []
            words += [f"with {', '.join(more[:3])}"] if more else []
            raise StictionError(
                f"policy for other observations, {' and '.join(words) or 'in another order'}: "
                f"expected the {len(names)} of {environment}: train it again"
            )
        if abs(card.interval - interval) > 1e-9:  # [s], rounding
            raise StictionError(
                f"policy for a control interval of {card.interval:g} s: expected {interval:g} s"
            )

    # ---- file --------------------------------------------------------------------------------

    def save(self, path: str | Path) -> None:
        """Write a ``policy.zip``: JSON and arrays."""
        card = {"format": FORMAT, **vars(self.card), "layers": len(self.weights)}
        arrays = {name: getattr(self, name) for name in _VECTORS}
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays |= {f"weight_{k}": weight, f"bias_{k}": bias}
        write_archive(Path(path), card, arrays)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a ``policy.zip`` from any source: no code in it is run.

        Raises:
            StictionError: no file, no policy, Stable-Baselines3's own zip, pickled objects, a
                content that is too large, numbers that are not finite, inconsistent shapes.
        """
        path = Path(path)
        raw, arrays = read_archive(path)
        card = _checked_card(path, raw)
        layers = raw.get("layers")
        if type(layers) is not int or not 1 <= layers <= len(arrays):
            raise StictionError(f"{path}: layers is {layers!r}: expected a whole number from 1")
        names = [*_VECTORS, *(f"{p}_{k}" for k in range(layers) for p in ("weight", "bias"))]
        if sorted(names) != sorted(arrays):
            odd = sorted(set(names) ^ set(arrays))
            raise StictionError(
                f"{path}: {odd[0]} is missing or too many: expected {', '.join(names)}"
            )
        weights = tuple(arrays[f"weight_{k}"].astype(float) for k in range(layers))
        biases = tuple(arrays[f"bias_{k}"].astype(float) for k in range(layers))
        out = cls(
            card=card,
            weights=weights,
            biases=biases,
            **{name: arrays[name].astype(float) for name in _VECTORS},
        )
        out._check_shapes(path)
        return out

    def _check_shapes(self, path: Path) -> None:
        observations, actions = len(self.card.observation_names), self.low.size
        sizes = [observations, *(w.shape[0] if w.ndim == 2 else -1 for w in self.weights)]
        lengths = (actions, actions, observations, observations)
        for name, size in zip(_VECTORS, lengths, strict=True):
            shape = getattr(self, name).shape
            if shape != (size,):
                raise StictionError(f"{path}: {name} has shape {shape}: expected ({size},)")
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if weight.shape != (sizes[k + 1], sizes[k]) or bias.shape != (sizes[k + 1],):
                raise StictionError(
                    f"{path}: layer {k} has shapes {weight.shape} and {bias.shape}: expected "
                    f"({bias.size}, {sizes[k]}) and ({bias.size},)"
                )
        if not (actions == sizes[-1] and actions % 2 == 0 and (self.low < self.high).all()):
            raise StictionError(f"{path}: action bounds that are none: expected low < high")
        if self.variance.min() < 0:
            raise StictionError(f"{path}: variance below 0")


_VECTORS = ("low", "high", "mean", "variance")


def _checked_card(path: Path, raw: JsonRecord) -> Card:
    if raw.get("format") != FORMAT:
        raise StictionError(f"{path}: format {raw.get('format')!r}: expected {FORMAT!r}")
    try:
        card = msgspec.convert(raw, Card)
    except msgspec.ValidationError as error:
        said, _, place = str(error).partition(" - at `$.")
        name = place.rstrip("`").partition("[")[0]
        value = f"{name} is {raw[name]!r}: " if name in raw else ""
        raise StictionError(f"{path}: {value}{said[:1].lower()}{said[1:]}") from None
    if not np.isfinite([card.interval, card.clip, card.epsilon]).all():
        raise StictionError(f"{path}: interval, clip and epsilon: expected finite numbers")
    for name, expected in (("activation", ACTIVATIONS), ("output", OUTPUTS)):
        if getattr(card, name) not in expected:
            raise unknown(f"{name} in {path}", getattr(card, name), expected)
    if card.environment.count("-") != 1:
        raise StictionError(f"{path}: environment {card.environment!r}: expected one as GTE-v0")
    return card


@compiled
def _layer(x: Array, weight: Array, bias: Array) -> Array:
    """Return x Wᵀ + b for x (M, in), summed in an order that does not depend on M."""
    out = np.empty((x.shape[0], weight.shape[0]))
    turned = weight.T.copy()
    for i in range(x.shape[0]):
        for o in range(out.shape[1]):
            out[i, o] = bias[o]
        for k in range(x.shape[1]):
            for o in range(out.shape[1]):
                out[i, o] += x[i, k] * turned[k, o]
    return out
