"""The complete state of a training on disk, for an exact restart; a folder is complete or absent.

    checkpoint/000020480/state.json    counters, random generators, the curve so far
                         arrays.npz    episodes, normalisation, replay buffer
                         weights.pt    networks and optimisers
                         policy.zip    the best policy so far

Neither part is pickled code: tensors are read with ``weights_only``, arrays without pickle. The
folder is written under another name and renamed when it is complete; then older ones are removed.
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
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from stiction_envs.errors import StictionError
from stiction_envs.reporting.atomic import naming
from stiction_envs.reporting.json_text import JsonRecord, plain

SB3 = Any
"""Its objects: they have more than the types that it declares."""
Arrays = dict[str, NDArray[Any]]
PART = "next"
"""Name of a checkpoint that is being written."""
_REPLAY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
_MOMENTS = ("mean", "var", "count")
_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_current_progress_remaining")


def save(
    folder: Path,
    model: BaseAlgorithm,
    identity: Mapping[str, object],
    more: Mapping[str, object],
    best: Path,
    *,
    finished: bool = False,
) -> None:
    """Write a checkpoint between two rollouts; it replaces older ones.

    Args:
        folder: folder of the checkpoints.
        model: the model with its environments.
        identity: definition of the training.
        more: other state to store, JSON.
        best: the best policy's file.
        finished: whether the training is finished: what only a restart needs is left out.
    """
    part = folder / PART
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    arrays, generators = _environment(model)
    if isinstance(model, OffPolicyAlgorithm) and not finished:
        arrays |= _replay(model)
    # Stable-Baselines3 draws from numpy's global generator
    legacy = np.random.get_state(legacy=False)  # noqa: NPY002
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
    # sorted by name, that of a finished training comes after the one at the same step
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
    """Return the newest complete checkpoint; None if there is none."""
    if not folder.is_dir():
        return None
    found = sorted(p for p in folder.iterdir() if p.name != PART and p.is_dir())
    return found[-1] if found else None


def read_state(place: Path, identity: Mapping[str, object]) -> JsonRecord:
    """Return the counters and the other state of a checkpoint.

    Raises:
        StictionError: it belongs to another training, or cannot be read.
    """
    try:
        state: JsonRecord = json.loads((place / "state.json").read_text(encoding="utf-8"))
        theirs = state["identity"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise StictionError(f"checkpoint {place}: cannot be read: {error}") from None
    mine = plain(identity)
    if theirs != mine:
        names = [k for k in mine if theirs.get(k) != mine[k]] or ["identity"]
        name = names[0]
        raise StictionError(
            f"checkpoint {place}: of another training: {name} is {theirs.get(name)!r}: expected "
            f"{mine.get(name)!r}: choose another folder, or force"
        )
    return state


def restore(place: Path, state: JsonRecord, model: BaseAlgorithm) -> None:
    """Restore a new model of the same training, and its environments, to the saved state.

    A finished training cannot be continued.

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
    # last: nothing above may draw random numbers
    model.action_space.np_random.bit_generator.state = state["actions"]
    key = np.array(state["numpy"]["state"]["key"], dtype=np.uint32)
    np.random.set_state({**state["numpy"], "state": {**state["numpy"]["state"], "key": key}})  # noqa: NPY002
    torch.set_rng_state(tensors["torch"])


# ---- environments and replay buffer --------------------------------------------------------------


def _arrays_of(model: BaseAlgorithm) -> dict[str, tuple[object, str]]:
    """Return where each array is kept: an object and the name of its attribute."""
    normal: SB3 = model.get_vec_normalize_env()
    monitor = normal.venv
    return {
        "last_obs": (model, "_last_obs"),
        "episode_starts": (model, "_last_episode_starts"),
        "old_obs": (normal, "old_obs"),
        "old_reward": (normal, "old_reward"),
        "returns": (normal, "returns"),
        "monitor_returns": (monitor, "episode_returns"),
        "monitor_lengths": (monitor, "episode_lengths"),
        **{f"obs_{name}": (normal.obs_rms, name) for name in _MOMENTS},
        **{f"ret_{name}": (normal.ret_rms, name) for name in _MOMENTS},
    }


def _environment(model: BaseAlgorithm) -> tuple[Arrays, list[dict[str, object]]]:
    """Return all arrays of a model's environments, and the random generators of their episodes."""
    normal: SB3 = model.get_vec_normalize_env()
    start, actions = normal.venv.venv.snapshot()
    arrays = {name: np.array(getattr(*place)) for name, place in _arrays_of(model).items()}
    arrays["lengths"] = np.array([len(a) for a in actions])
    arrays["actions_since"] = np.concatenate(actions)
    return arrays, start


def _restore_environment(
    model: BaseAlgorithm, arrays: Arrays, start: list[dict[str, object]]
) -> None:
    normal: SB3 = model.get_vec_normalize_env()
    ends = np.cumsum(arrays["lengths"])[:-1]
    observation = normal.venv.venv.restore(start, np.split(arrays["actions_since"], ends))
    if not np.array_equal(observation, arrays["old_obs"]):
        raise StictionError(
            "checkpoint: played again, its episodes come out otherwise: the machine, or the "
            "version of a package, is another: expected those it was made with"
        )
    for name, (owner, attribute) in _arrays_of(model).items():
        value = arrays[name]
        setattr(owner, attribute, value if value.ndim else float(value))
    model._last_original_obs = normal.old_obs


def _replay(model: OffPolicyAlgorithm) -> Arrays:
    buffer: SB3 = model.replay_buffer
    filled = buffer.buffer_size if buffer.full else buffer.pos
    arrays = {f"replay_{name}": getattr(buffer, name)[:filled] for name in _REPLAY}
    return {**arrays, "replay_at": np.array([buffer.pos, int(buffer.full)])}


def _restore_replay(model: OffPolicyAlgorithm, arrays: Arrays) -> None:
    buffer: SB3 = model.replay_buffer
    for name in _REPLAY:
        kept = arrays[f"replay_{name}"]
        getattr(buffer, name)[: len(kept)] = kept
    buffer.pos, buffer.full = int(arrays["replay_at"][0]), bool(arrays["replay_at"][1])
