"""The gated table and the torque-and-speed rule that are closest to a policy.

For each joint, the amplitudes that a policy chose are fitted by

    A(τ, q̇) = a · min(1, |τ| / θ) · exp(−(q̇/v)²)                       (rule)
    A(q̇)    = a · exp(−(q̇/v)²)                                         (table)

where τ is the torque without dither over the stiction. For a threshold θ and a gate v, the
amplitude a is linear, so only these two are searched (variable projection, Golub and Pereyra 1973).
A joint's frequency is the mean of the chosen ones, weighted with their power.

    distilled = distil(task, policy, seed=0)
    distilled.save("runs/distilled")                      # final.csv, rule.csv
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from scipy.optimize import least_squares

from stiction_envs.envs.agents import GatedTable
from stiction_envs.envs.evaluation import Policy as Agent
from stiction_envs.envs.evaluation import write_rows
from stiction_envs.envs.gym_env import ArmVectorEnv
from stiction_envs.errors import StictionError
from stiction_envs.experiments.actions import DITHERED
from stiction_envs.measured import AmplitudeRow, write_final
from tuning.policies.evaluation import Evaluated, evaluate_all
from tuning.policies.settings import DistilSettings, policy_settings
from tuning.policies.task import Task

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Fit:
    """One joint as a table and as a rule."""

    joint: int
    """Number of the joint, from 1."""
    frequency_hz: float
    """Mean of the policy's frequencies, weighted with amplitude²; for table and rule [Hz]."""
    frequency_std_hz: float
    """Their standard deviation with the same weights: the loss of using one frequency [Hz]."""
    table_nm: float
    """Amplitude of the table [N·m]; 0 where the joint is not dithered."""
    table_gate_rad_s: float
    """Gate of the table; 0 means none [rad/s]."""
    table_r2: float
    """Share of the amplitude's variance that the table explains; NaN where there is no variance."""
    rule_nm: float
    """Amplitude of the rule [N·m]."""
    rule_gate_rad_s: float
    """Gate of the rule; 0 means none [rad/s]."""
    rule_threshold: float
    """Torque over stiction at which the amplitude reaches its maximum; 0 means no threshold [-]."""
    rule_r2: float
    """The same for the rule."""


class DistilledRule(GatedTable):
    """A table, gated by speed, whose amplitudes also grow with the torque up to a threshold."""

    def __init__(self, env: ArmVectorEnv, fits: Sequence[Fit]) -> None:
        """Create it for an environment of the project."""
        top = env.unwrapped.core.action_space.high
        rows = [_row(f.joint, f.frequency_hz, f.rule_nm, f.rule_gate_rad_s, top) for f in fits]
        super().__init__(env, [r for r in rows if r is not None], speed=np.inf)
        self.threshold = np.array([f.rule_threshold for f in fits])

    def _factor(self, observation: NDArray[np.floating]) -> Array:
        gated = super()._factor(observation)
        return gated * _pushed(np.abs(self.torque(observation)), self.threshold)


@dataclass(frozen=True, kw_only=True)
class Distilled:
    """Table and rule, and their loss of return."""

    fits: tuple[Fit, ...]
    """Fits of all joints."""
    table: tuple[AmplitudeRow, ...]
    """Rows of the dithered joints."""
    joint_names: tuple[str, ...]
    """Names of all the arm's joints."""
    evaluated: Evaluated
    """Evaluation of none, policy, table and rule on the same episodes, not those of the fit."""

    @property
    def lost(self) -> dict[str, float]:
        """Share of the policy's gain in return over no dither that each kind loses [-].

        It is NaN where the policy gains nothing.
        """
        mean = {p: self.evaluated.values(p, "return").mean() for p in self.evaluated.policies}
        gain = mean["policy"] - mean["none"]
        return {
            name: float((mean["policy"] - mean[name]) / gain) if gain > 0 else float("nan")
            for name in ("table", "rule")
        }

    def save(self, folder: str | Path) -> None:
        """Write the table (``final.csv`` and ``.yaml``), ``rule.csv`` and its ``distilled.csv``.

        The table is not written if no joint is dithered.
        """
        folder = Path(folder)
        if self.table:
            write_final(folder, self.table, self.joint_names)
        write_rows(folder / "rule.csv", [asdict(f) for f in self.fits])
        write_rows(folder / "distilled.csv", self.evaluated.rows)

    def to_json(self) -> dict[str, object]:
        """Return fits, losses and the means of the evaluation."""
        return {
            "joints": [asdict(f) for f in self.fits],
            "lost": self.lost,
            "summary": self.evaluated.summary(),
        }


def distil(
    task: Task,
    policy: Agent,
    *,
    episodes: int | None = None,
    seed: int = 0,
) -> Distilled:
    """Return the table and rule closest to an agent of the environment.

    Args:
        task: the environment.
        policy: anything with Stable-Baselines3's `predict`.
        episodes: episodes to record, and as many others to evaluate; None for the settings'.
        seed: seed of the first episode.

    Raises:
        StictionError: an action with more than dither, which no table holds.
    """
    settings = policy_settings().distil
    episodes = settings.episodes if episodes is None else episodes
    env = task.make(episodes)
    if env.core.action_name != DITHERED:
        raise StictionError(f"distil: action {env.core.action_name}: expected {DITHERED}")
    names = env.core.arm.joint_names
    top = env.core.action_space.high[: env.core.n]
    fits = fit(*watch(env, policy, seed), top=top, settings=settings)
    found = [_row(f.joint, f.frequency_hz, f.table_nm, f.table_gate_rad_s, top) for f in fits]
    table = tuple(r for r in found if r is not None)
    agents = [
        ("policy", policy),
        ("table", GatedTable(env, table, speed=np.inf)),
        ("rule", DistilledRule(env, fits)),
    ]
    env.close()
    evaluated = evaluate_all(task, ["none", *agents], episodes=episodes, seed=seed + episodes)
    return Distilled(fits=tuple(fits), table=table, joint_names=names, evaluated=evaluated)


def watch(env: VectorEnv, policy: Agent, seed: int) -> tuple[Array, Array, Array, Array]:
    """Return a policy's inputs and actions until each arm of a batch has ended an episode.

    Returns:
        Speeds [rad/s], torques without dither over the stiction [-], amplitudes [N·m] and
        frequencies [Hz], (M, n) each.
    """
    reader = GatedTable(env, [])
    observation, _ = env.reset(seed=seed)
    going = np.ones(env.num_envs, dtype=bool)
    seen: list[Array] = []
    while going.any():
        action, _ = policy.predict(observation)
        parts = [reader.speed(observation), reader.torque(observation), *np.hsplit(action, 2)]
        # an arm whose episode has ended starts the next one, which is just as useful
        seen.append(np.stack(parts))
        observation, _, terminated, truncated, _ = env.step(action)
        going &= ~(terminated | truncated)
    speed, torque, amplitude, frequency = np.concatenate(seen, axis=1)
    return speed, torque, amplitude, frequency


def fit(
    speed: Array,
    torque: Array,
    amplitude: Array,
    frequency: Array,
    *,
    top: NDArray[np.floating],
    settings: DistilSettings,
) -> list[Fit]:
    """Return the table and the rule of every joint.

    Args:
        speed: (M, n) [rad/s].
        torque: (M, n) without dither, over the stiction [-].
        amplitude: (M, n) amplitudes that the policy chose [N·m].
        frequency: (M, n) frequencies that it chose [Hz].
        top: (n,) highest amplitudes [N·m].
        settings: bounds of the fit.
    """
    out = []
    for j in range(amplitude.shape[1]):
        a, v, pushed = amplitude[:, j], speed[:, j], np.abs(torque[:, j])
        power = a**2 if np.any(a > 0) else np.ones_like(a)
        mean = float(np.average(frequency[:, j], weights=power))
        spread = float(np.sqrt(np.average((frequency[:, j] - mean) ** 2, weights=power)))
        table = _fitted(a, v, None, float(top[j]), settings)
        rule = _fitted(a, v, pushed, float(top[j]), settings)
        if rule[3] < table[3]:
            # the table is a rule without threshold
            rule = (*table[:2], 0.0, table[3])
        out.append(
            Fit(
                joint=j + 1,
                frequency_hz=mean,
                frequency_std_hz=spread,
                table_nm=table[0],
                table_gate_rad_s=table[1],
                table_r2=table[3],
                rule_nm=rule[0],
                rule_gate_rad_s=rule[1],
                rule_threshold=rule[2],
                rule_r2=rule[3],
            )
        )
    return out


def _fitted(
    a: Array, speed: Array, pushed: Array | None, top: float, settings: DistilSettings
) -> tuple[float, float, float, float]:
    """Return amplitude, gate, threshold (0: none) and R² of one joint."""
    (slow, fast), (low, high) = settings.gate_rad_s, settings.threshold
    bounds = [(np.log(slow), np.log(fast))]
    if pushed is not None:
        bounds.append((np.log(low), np.log(high)))
    lower, upper = np.transpose(bounds)

    def shape(x: Array) -> Array:
        # a parameter at the edge of its range counts as none
        gate = np.inf if x[0] >= upper[0] - settings.edge else np.exp(x[0])
        out = np.exp(-((speed / gate) ** 2))
        if pushed is not None and x[1] > lower[1] + settings.edge:
            out = out * _pushed(pushed, np.exp(x[1]))
        return out

    def level(s: Array) -> float:
        power = float(s @ s)
        return float(np.clip(s @ a / power, 0.0, top)) if power > 0 else 0.0

    def residual(x: Array) -> Array:
        s = shape(x)
        return level(s) * s - a

    best = upper.copy()
    if pushed is not None:
        best[1] = lower[1]
    cost = float(np.sum(residual(best) ** 2))
    total = float(np.sum((a - a.mean()) ** 2))
    if total > len(a) * (settings.least_spread * top) ** 2:
        grids = [np.linspace(lo, hi, settings.starts + 2)[1:-1] for lo, hi in bounds]
        for start in np.stack(np.meshgrid(*grids), axis=-1).reshape(-1, len(bounds)):
            found = least_squares(residual, start, bounds=(lower, upper))
            if 2 * found.cost < cost * (1 - 1e-9):  # beyond rounding
                best, cost = found.x, 2 * float(found.cost)
        r2 = 1.0 - cost / total
    else:
        r2 = float("nan")
    amplitude = level(shape(best))
    if amplitude < settings.least_share * top:
        return 0.0, 0.0, 0.0, r2
    gate = 0.0 if best[0] >= upper[0] - settings.edge else float(np.exp(best[0]))
    threshold = 0.0
    if pushed is not None and best[1] > lower[1] + settings.edge:
        threshold = float(np.exp(best[1]))
    return amplitude, gate, threshold, r2


def _pushed(torque: Array, threshold: Array | float) -> Array:
    """Return min(1, |τ| / θ), or 1 without threshold."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.minimum(1.0, torque / threshold)
    return np.where(np.asarray(threshold) > 0, share, 1.0)


def _row(
    joint: int, frequency: float, amplitude: float, gate: float, top: NDArray[np.floating]
) -> AmplitudeRow | None:
    """Return the row of a joint; None if it is not dithered."""
    if amplitude == 0:
        return None
    amplitude = min(amplitude, float(top[joint - 1]))
    return AmplitudeRow(joint, frequency, amplitude, gate_rad_s=gate)
