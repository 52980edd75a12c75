"""All of a training on disk, so that it goes on to the bit: a folder that is there or not.

    checkpoint/000020480/state.json    counters, random generators, the curve so far
                         arrays.npz    episodes, normalisation, replay buffer
                         weights.pt    networks and optimisers
                         policy.zip    the best policy so far

Neither part is pickled code: tensors are read with ``weights_only``, arrays without pickle. It is
made under another name and takes its own when it is complete; then older ones are removed.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import zipfile
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError
from stiction_envs.reporting.atomic import naming
from stiction_envs.reporting.json_text import plain
from tuning.policies.extra import (
    BaseAlgorithm,
    OffPolicyAlgorithm,
    RunningMeanStd,
    VecMonitor,
    VecNormalize,
    torch,
)
from tuning.policies.recorded import RecordedVecEnv

PART = "next"
"""Name of a checkpoint that is being made."""
_REPLAY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_current_progress_remaining")


def save(
    folder: Path,
    model: BaseAlgorithm,
    identity: Mapping[str, Any],
    more: Mapping[str, Any],
    best: Path,
    *,
    finished: bool = False,
) -> None:
    """Write a checkpoint between two rollouts; it takes the place of older ones.

    Args:
        folder: of the checkpoints.
        model: with its environments.
        identity: what makes the training.
        more: what else is to come back, JSON.
        best: the best policy's file.
        finished: whether the training is over: what is only needed to go on is left out.
    """
    part = folder / PART
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    arrays, generators = _environment(model)
    if isinstance(model, OffPolicyAlgorithm) and not finished:
        arrays |= _replay(model)
    # Stable-Baselines3 draws from numpy's global generator
    legacy: Any = np.random.get_state(legacy=False)  # noqa: NPY002
    state = {
        "identity": identity,
        "finished": finished,
        "counters": {name: getattr(model, name) for name in _COUNTERS if hasattr(model, name)},
        "numpy": legacy,
        "actions": model.action_space.np_random.bit_generator.state,
        "episodes": generators,
        "returns": [{k: float(e[k]) for k in ("r", "l", "t")} for e in model.ep_info_buffer or ()],
        "more": more,
    }
    tensors = {"parameters": model.get_parameters(), "torch": torch.get_rng_state()}
    if (entropy := getattr(model, "log_ent_coef", None)) is not None:
        tensors["log_ent_coef"] = entropy.detach()
    # in memory: torch reports a full disk as an error of its own, without the file
    weights = io.BytesIO()
    torch.save(tensors, weights)
    # by name, that of a finished training comes behind the one at the same step
    place = folder / f"{model.num_timesteps:09d}{'-finished' if finished else ''}"
    old = [p for p in folder.iterdir() if p != part]
    try:
        with naming(place):
            (part / "state.json").write_text(json.dumps(plain(state)), encoding="utf-8")
            (part / "weights.pt").write_bytes(weights.getbuffer())
            np.savez(part / "arrays.npz", allow_pickle=False, **arrays)
            shutil.copyfile(best, part / best.name)
            for file in part.iterdir():
                with open(file, "rb+") as handle:
                    os.fsync(handle.fileno())
            os.replace(part, place)
    except OSError:
        shutil.rmtree(part, ignore_errors=True)
        raise
    for other in old:
        shutil.rmtree(other)


def newest(folder: Path) -> Path | None:
    """Return the newest complete checkpoint; None where there is none."""
    if not folder.is_dir():
        return None
    found = sorted(p for p in folder.iterdir() if p.name != PART and p.is_dir())
    return found[-1] if found else None


def read_state(place: Path, identity: Mapping[str, Any]) -> dict[str, Any]:
    """Return the counters and the rest of a checkpoint.

    Raises:
        StictionError: of another training, or one that cannot be read.
    """
    try:
        state: dict[str, Any] = json.loads((place / "state.json").read_text(encoding="utf-8"))
        theirs = state["identity"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise StictionError(f"checkpoint {place}: cannot be read: {error}") from None
    mine = plain(identity)
    if theirs != mine:
        names = [k for k in mine if theirs.get(k) != mine[k]] or ["identity"]
        name = names[0]
        raise StictionError(
            f"checkpoint {place}: of another training: {name} is {theirs.get(name)!r}: expected "
            f"{mine.get(name)!r}: choose another folder, or force (--force)"
        )
    return state


def restore(place: Path, state: Mapping[str, Any], model: BaseAlgorithm) -> None:
    """Bring a fresh model of the same training, and its environments, to where it was saved.

    A finished training has nothing to go on with.

    Raises:
        StictionError: files that cannot be read.
    """
    try:
        tensors = torch.load(place / "weights.pt", weights_only=True)
        with np.load(place / "arrays.npz", allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (OSError, ValueError, RuntimeError, zipfile.BadZipFile) as error:
        raise StictionError(f"checkpoint {place}: cannot be read: {error}") from None
    model.set_parameters(tensors["parameters"], exact_match=True)
    if "log_ent_coef" in tensors:
        model.log_ent_coef.data.copy_(tensors["log_ent_coef"])  # type: ignore[attr-defined]
    for name, value in state["counters"].items():
        setattr(model, name, value)
    model.ep_info_buffer = deque(state["returns"], maxlen=model._stats_window_size)
    model.ep_success_buffer = deque(maxlen=model._stats_window_size)
    if isinstance(model, OffPolicyAlgorithm):
        _restore_replay(model, arrays)
    _restore_environment(model, arrays, state["episodes"])
    # last: nothing above may draw from them
    model.action_space.np_random.bit_generator.state = state["actions"]
    key = np.array(state["numpy"]["state"]["key"], dtype=np.uint32)
    np.random.set_state({**state["numpy"], "state": {**state["numpy"]["state"], "key": key}})  # noqa: NPY002
    torch.set_rng_state(tensors["torch"])


# ---- environments --------------------------------------------------------------------------------


def _wrappers(model: BaseAlgorithm) -> tuple[VecNormalize, VecMonitor, RecordedVecEnv]:
    normal: Any = model.get_vec_normalize_env()
    return normal, normal.venv, normal.venv.venv


def _environment(model: BaseAlgorithm) -> tuple[dict[str, NDArray[Any]], list[dict[str, Any]]]:
    normal, monitor, recorded = _wrappers(model)
    start, actions = recorded.snapshot()
    last: Any = model._last_obs
    arrays = {
        "last_obs": last,
        "episode_starts": np.array(model._last_episode_starts),
        "old_obs": np.array(normal.old_obs),
        "old_reward": np.array(normal.old_reward),
        "returns": normal.returns,
        "monitor_returns": monitor.episode_returns,
        "monitor_lengths": monitor.episode_lengths,
        "lengths": np.array([len(a) for a in actions]),
        "actions_since": np.concatenate(actions),
    }
    for name, moments in (("obs", normal.obs_rms), ("ret", normal.ret_rms)):
        assert isinstance(moments, RunningMeanStd)
        arrays |= {
            f"{name}_mean": np.asarray(moments.mean),
            f"{name}_var": np.asarray(moments.var),
            f"{name}_count": np.asarray(moments.count),
        }
    return arrays, start


def _restore_environment(
    model: BaseAlgorithm, arrays: Mapping[str, NDArray[Any]], start: list[dict[str, Any]]
) -> None:
    normal, monitor, recorded = _wrappers(model)
    ends = np.cumsum(arrays["lengths"])[:-1]
    observation = recorded.restore(start, np.split(arrays["actions_since"], ends))
    normal.old_obs, normal.old_reward = arrays["old_obs"], arrays["old_reward"]
    if not np.array_equal(observation, normal.old_obs):
        raise StictionError(
            "checkpoint: played again, its episodes come out otherwise: the machine, or the "
            "version of a package, is another: expected those it was made with"
        )
    normal.returns = arrays["returns"]
    monitor.episode_returns = arrays["monitor_returns"]
    monitor.episode_lengths = arrays["monitor_lengths"]
    for name, moments in (("obs", normal.obs_rms), ("ret", normal.ret_rms)):
        assert isinstance(moments, RunningMeanStd)
        moments.mean, moments.var = arrays[f"{name}_mean"], arrays[f"{name}_var"]
        moments.count = float(arrays[f"{name}_count"])
    model._last_obs = arrays["last_obs"]
    model._last_original_obs = normal.old_obs
    model._last_episode_starts = arrays["episode_starts"]


# ---- replay buffer -------------------------------------------------------------------------------


def _replay(model: OffPolicyAlgorithm) -> dict[str, NDArray[Any]]:
    buffer: Any = model.replay_buffer
    filled = buffer.buffer_size if buffer.full else buffer.pos
    arrays = {f"replay_{name}": getattr(buffer, name)[:filled] for name in _REPLAY}
    return {**arrays, "replay_at": np.array([buffer.pos, int(buffer.full)])}


def _restore_replay(model: OffPolicyAlgorithm, arrays: Mapping[str, NDArray[Any]]) -> None:
    buffer: Any = model.replay_buffer
    for name in _REPLAY:
        kept = arrays[f"replay_{name}"]
        getattr(buffer, name)[: len(kept)] = kept
    buffer.pos, buffer.full = int(arrays["replay_at"][0]), bool(arrays["replay_at"][1])
