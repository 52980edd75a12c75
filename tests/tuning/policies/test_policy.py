"""A policy's numbers: what it does, and files that strangers made."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.errors import StictionError
from tests.tuning.policies.small import made_up
from tuning.policies.policy import Policy


def test_one_layer_is_worked_out_by_hand():
    """y = clip(W z + b), z = clip((x − µ)/√(σ² + ε)), action = low + (y + 1)/2 · (high − low)."""
    policy = made_up(output="clip")
    x = np.array([0.3, -1.0, 2.0], dtype=np.float32)
    z = np.clip((x - policy.mean) / np.sqrt(policy.variance + 1e-8), -10, 10)
    hidden = np.tanh(policy.weights[0] @ z + policy.biases[0])
    y = np.clip(policy.weights[1] @ hidden + policy.biases[1], -1, 1)
    expected = policy.low + (y + 1) / 2 * (policy.high - policy.low)
    action, state = policy.predict(x)
    assert state is None
    assert action == pytest.approx(expected, rel=1e-6)


def test_a_row_of_a_batch_is_the_policy_alone_bit_for_bit():
    policy = made_up(names=tuple(f"o{k}" for k in range(60)), hidden=128)
    x = np.random.default_rng(1).normal(size=(67, 60)).astype(np.float32)
    batch, _ = policy.predict(x)
    assert np.array_equal(batch, np.array([policy.predict(row)[0] for row in x]))
    assert np.array_equal(batch[5:9], policy.predict(x[5:9])[0])


def test_the_lowest_action_is_exactly_no_dither():
    policy = made_up(output="clip")
    policy.biases[1][:] = -1e3
    action, _ = policy.predict(np.zeros(3))
    assert np.array_equal(action, policy.low)


def test_what_was_saved_is_loaded(tmp_path):
    policy = made_up()
    policy.save(tmp_path / "policy.zip")
    again = Policy.load(tmp_path / "policy.zip")
    x = np.random.default_rng(1).normal(size=(5, 3))
    assert np.array_equal(again.predict(x)[0], policy.predict(x)[0])
    assert again.card == policy.card
    policy.save(tmp_path / "again.zip")
    assert (tmp_path / "again.zip").read_bytes() == (tmp_path / "policy.zip").read_bytes()


def test_loading_and_playing_need_neither_torch_nor_stable_baselines(tmp_path):
    made_up().save(tmp_path / "policy.zip")
    code = (
        "import sys; sys.modules['torch'] = sys.modules['stable_baselines3'] = None\n"
        "from tuning.policies.policy import Policy\n"
        f"print(Policy.load({str(tmp_path / 'policy.zip')!r}).predict([0.0, 1.0, 2.0])[0].shape)\n"
    )
    root = Path(__file__).parents[3]
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root
    )
    assert ran.stdout == "(2,)\n"


@pytest.mark.parametrize("shape", [(2, 4), (1, 1, 3)])
def test_an_observation_of_another_shape(shape):
    with pytest.raises(StictionError, match=r"expected \(3,\) or \(M, 3\)"):
        made_up().predict(np.zeros(shape))


# ---- where it belongs ----------------------------------------------------------------------------

MINE = {
    "robot": "panda",
    "environment": "GTE-v0",
    "observation_names": ("a", "b", "c"),
    "interval": 0.1,
}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"robot": "iiwa7"}, "GTE environment of panda: expected one for the GTE environment of i"),
        ({"environment": "SJE-v0"}, "expected one for the SJE environment of panda"),
        ({"environment": "GTE-v1"}, "policy for GTE-v0: expected one for GTE-v1"),
        ({"observation_names": ("a", "b")}, "with c"),
        ({"observation_names": ("a", "b", "c", "d")}, "without d"),
        ({"observation_names": ("a", "c", "b")}, "in another order"),
        ({"interval": 0.2}, "control interval of 0.1 s: expected 0.2 s"),
    ],
)
def test_a_policy_for_something_else(change, words):
    made_up().check(**MINE)
    with pytest.raises(StictionError) as error:
        made_up().check(**{**MINE, **change})
    assert words in str(error.value)


# ---- files of strangers --------------------------------------------------------------------------


def repacked(tmp_path: Path, change) -> Path:
    """Return a good policy's file after ``change`` of its entries."""
    made_up().save(tmp_path / "good.zip")
    with zipfile.ZipFile(tmp_path / "good.zip") as file:
        entries = {name: file.read(name) for name in file.namelist()}
    change(entries)
    path = tmp_path / "policy.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in entries.items():
            file.writestr(name, data)
    return path


def array(value, **options) -> bytes:
    out = io.BytesIO()
    np.save(out, value, **options)
    return out.getvalue()


def card(entries: dict[str, bytes], **changes) -> None:
    found = {**json.loads(entries["policy.json"]), **changes}
    entries["policy.json"] = json.dumps(found).encode()


class Harmful:
    """What a stranger would like to run."""

    def __reduce__(self):
        return (pytest.fail, ("code of the file was run",))


def claims(shape: str) -> bytes:
    """Return an array whose header claims a shape, with nothing behind it."""
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head.encode()


STRANGE = {
    "pickled": (
        lambda e: e.update({"mean.npy": array(np.array([Harmful()], object), allow_pickle=True)}),
        "mean.npy: pickled objects are not opened",
    ),
    "sb3": (lambda e: e.update({"policy.pth": b"x"}), "Stable-Baselines3's zip holds pickled code"),
    "outside": (lambda e: e.update({"../mean.npy": array(np.zeros(3))}), "'../mean.npy' in it"),
    "huge": (lambda e: e.update({"mean.npy": claims("(1000000000000,)")}), "0 bytes do not fit"),
    "integers": (lambda e: e.update({"mean.npy": array(np.arange(3))}), "int64"),
    "nan": (lambda e: e.update({"mean.npy": array(np.array([0, np.nan, 1]))}), "not finite"),
    "short": (lambda e: e.update({"mean.npy": array(np.zeros(2))}), "mean has shape (2,)"),
    "layer": (lambda e: e.update({"weight_1.npy": array(np.zeros((2, 5)))}), "layer 1 has shapes"),
    "missing": (lambda e: e.pop("bias_1.npy"), "bias_1 is missing or too many"),
    "bounds": (lambda e: e.update({"high.npy": array(np.array([0.0, 5.0]))}), "low < high"),
    "variance": (lambda e: e.update({"variance.npy": array(-np.ones(3))}), "variance below 0"),
    "no_card": (lambda e: e.pop("policy.json"), "no policy.json in it"),
    "no_json": (lambda e: e.update({"policy.json": b"{"}), "not JSON"),
    "deep": (lambda e: e.update({"policy.json": b"[" * 10**5}), "not JSON"),
    "list": (lambda e: e.update({"policy.json": b"[]"}), "expected an object"),
    "format": (lambda e: card(e, format="stiction-envs policy 2"), "policy 2': expected"),
    "activation": (lambda e: card(e, activation="exec"), "expected one of tanh, relu"),
    "output": (lambda e: card(e, output=3), "output is 3: expected `str`"),
    "names": (lambda e: card(e, observation_names=[1, 2, 3]), "names is [1, 2, 3]: expected `str`"),
    "clip": (lambda e: card(e, clip=-1.0), "clip is -1.0: expected `float` > 0.0"),
    "interval": (lambda e: card(e, interval=True), "interval is True"),
    "environment": (lambda e: card(e, environment="GTE"), "expected one as GTE-v0"),
    "layers": (lambda e: card(e, layers=10**9), "layers is 1000000000"),
}


@pytest.mark.parametrize("name", STRANGE)
def test_a_strange_file_is_one_clear_line(tmp_path, name):
    change, words = STRANGE[name]
    with pytest.raises(StictionError) as error:
        Policy.load(repacked(tmp_path, change))
    assert words in str(error.value)
    assert "policy.zip" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_zip_bomb_is_not_unpacked(tmp_path, monkeypatch):
    path = repacked(tmp_path, lambda e: e.update({"mean.npy": bytes(2**28)}))
    assert path.stat().st_size < 2**20
    monkeypatch.setattr(zipfile.ZipFile, "open", lambda *_: pytest.fail("unpacked"))
    with pytest.raises(StictionError, match=r"bytes unpacked: expected at most 67108864"):
        Policy.load(path)


def test_many_entries_are_refused(tmp_path):
    path = repacked(tmp_path, lambda e: e.update({f"x{k}.npy": b"" for k in range(100)}))
    with pytest.raises(StictionError, match="entries: expected at most 64"):
        Policy.load(path)


@pytest.mark.parametrize("content", [None, b"PK\x03\x04broken"])
def test_no_zip_at_all(tmp_path, content):
    path = tmp_path / "policy.zip"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(StictionError, match=r"policy\.zip"):
        Policy.load(path)


def test_damaged_bytes_are_noticed(tmp_path):
    made_up().save(tmp_path / "policy.zip")
    data = bytearray((tmp_path / "policy.zip").read_bytes())
    data[len(data) // 2] ^= 0xFF
    (tmp_path / "policy.zip").write_bytes(bytes(data))
    with pytest.raises(StictionError):
        Policy.load(tmp_path / "policy.zip")
