"""Trained policies as numbers: they need numpy alone, and their files run no code."""

import io
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.compiled import compiled
from stiction_envs.errors import StictionError, checked_array, opening
from stiction_envs.method_settings import Positive
from stiction_envs.reporting.atomic import write_bytes_atomic
from stiction_envs.reporting.json_text import JsonRecord

Array = NDArray[np.floating]
ENTRY = "policy.json"  # Name of the one file in a ``policy.zip``
MOST_BYTES = 2**26
"""Largest unpacked size of a ``policy.zip`` [B] (assumed): a hundred times a usual network's."""
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest date of the zip format
_SB3 = {"_stable_baselines3_version", "policy.pth", "data"}


@dataclass(frozen=True, kw_only=True)
class Card:
    """Description of a policy, besides its numbers."""

    robot: str
    environment: Annotated[str, msgspec.Meta(pattern="^[^-]+-[^-]+$")]
    """End of the environment's identifier with its version: ``GTE-v0``."""
    observation_names: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]
    interval: Positive  # Time between two actions [s]
    activation: Literal["tanh", "relu"]
    output: Literal["tanh", "clip"]  # How an action is limited to [-1, 1] of its range
    clip: Positive  # Bound of normalised observations
    epsilon: Positive  # Added to the variance in the normalisation
    training: JsonRecord
    """Origin: algorithm, steps, seed, versions and other facts; for information only."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Policy:
    """Observation → normalised → layers → amplitudes [N·m] and frequencies [Hz].

    A row of a batch gives the same bits as the row alone. The fields are those of ``policy.json``.
    """

    format: Literal["stiction-envs policy 2"] = "stiction-envs policy 2"
    card: Card
    low: Array  # (2n,) lowest action: n amplitudes [N·m], n frequencies [Hz]
    high: Array
    mean: Array  # (observations,) mean of the observations in training
    variance: Array  # (observations,) their variance
    weights: Annotated[tuple[Array, ...], msgspec.Meta(min_length=1)]  # (out, in) of every layer
    biases: tuple[Array, ...]  # (out,) of every layer

    def predict(
        self,
        observation: ArrayLike,
        state: object = None,
        episode_start: object = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float64], None]:
        """Return the mean action in the units of the environment; interface of Stable-Baselines3.

        An observation is (observations,) or (M, observations), an action (2n,) or (M, 2n):
        amplitudes [N·m] and frequencies [Hz]. The policy has no memory: other arguments are not
        used.
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

    def check(
        self, *, robot: str, environment: str, observation_names: Sequence[str], interval: float
    ) -> None:
        """Raise a StictionError that names the difference if this policy is for something else.

        ``environment`` is the end of the identifier, ``GTE-v0``; ``interval`` is the time between
        two actions [s].
        """
        card, names = self.card, tuple(observation_names)
        if (card.robot, card.environment) != (robot, environment):
            raise StictionError(
                f"policy for {card.environment} of {card.robot}: expected one for {environment} "
                f"of {robot}"
            )
        if card.observation_names != names:
            different = sorted(set(names) ^ set(card.observation_names))
            words = ", ".join(different[:3]) or "their order"
            raise StictionError(
                f"policy for other observations ({words}): expected the {len(names)} of "
                f"{environment}: train it again"
            )
        if abs(card.interval - interval) > 1e-9:  # [s], rounding
            raise StictionError(
                f"policy for a control interval of {card.interval:g} s: expected {interval:g} s"
            )

    def save(self, path: str | Path) -> None:
        """Write a ``policy.zip``; the same policy gives the same bytes."""
        text = msgspec.json.encode(vars(self), enc_hook=lambda array: array.tolist())
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as file:
            file.writestr(zipfile.ZipInfo(ENTRY, _EPOCH), text)
        write_bytes_atomic(Path(path), out.getvalue())

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a ``policy.zip`` from any source: no code in it is run.

        Raises:
            StictionError: no file, no policy, Stable-Baselines3's own zip, a content that is too
                large, or numbers and shapes that do not belong together.
        """
        try:
            out = msgspec.json.decode(
                _unpacked(Path(path)), type=cls, dec_hook=lambda _, x: checked_array(x, "an array")
            )
            out._check_shapes()
        except (msgspec.DecodeError, ValueError, RecursionError) as error:
            raise StictionError(f"{path}: not a policy of `stiction train`: {error}") from None
        return out

    def _check_shapes(self) -> None:
        """Raise a ValueError if arrays do not belong together."""
        checked_array(self.variance, "variance", low=0)
        observations = (len(self.card.observation_names),)
        if not self.mean.shape == self.variance.shape == observations:
            raise ValueError(f"expected mean and variance of shape {observations}")
        inputs = observations[0]
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if weight.shape != (bias.size, inputs):
                raise ValueError(
                    f"layer {k} has shape {weight.shape}: expected ({bias.size}, {inputs})"
                )
            inputs = bias.size
        if not (self.low.size == self.high.size == inputs and (self.low < self.high).all()):
            raise ValueError(f"bounds of the action: expected {inputs} with low < high")


def _unpacked(path: Path) -> bytes:
    """Return ``policy.json`` of a zip.

    Raises:
        StictionError: no such file, no such zip, or too large a content.
    """
    wanted = "a policy.zip of `stiction train`"
    expected = f"expected {wanted}"
    try:
        with opening(path, wanted), zipfile.ZipFile(path) as file:
            names = set(file.namelist())
            if names & _SB3:
                raise StictionError(
                    f"{path}: Stable-Baselines3's zip holds pickled code and is not opened: "
                    f"{expected}, or what tuning.policies.algorithms.export makes of a model of "
                    "your own"
                )
            if ENTRY not in names:
                raise StictionError(f"{path}: no {ENTRY} in it: {expected}")
            # zipfile unpacks no more of an entry than the size that it claims
            if (size := file.getinfo(ENTRY).file_size) > MOST_BYTES:
                raise StictionError(f"{path}: {size} bytes unpacked: expected up to {MOST_BYTES}")
            return file.read(ENTRY)
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, zlib.error) as error:
        raise StictionError(f"{path}: not a zip: {error}: {expected}") from None


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
