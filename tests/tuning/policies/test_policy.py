"""A policy's numbers: what it does, and files that strangers made."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from tests.command_line import python
from tests.refusal import refusal
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
    ran = python(code)
    assert ran.stdout == "(2,)\n", ran.stderr


@pytest.mark.parametrize("shape", [(2, 4), (1, 1, 3)])
def test_an_observation_of_another_shape(shape):
    refusal(lambda: made_up().predict(np.zeros(shape)), r"expected \(3,\) or \(M, 3\)")


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
        ({"robot": "iiwa7"}, "GTE-v0 of panda: expected one for GTE-v0 of iiwa7"),
        ({"environment": "GTE-v1"}, "GTE-v0 of panda: expected one for GTE-v1 of panda"),
        ({"observation_names": ("a", "b", "d")}, "other observations (c, d): expected the 3 of GT"),
        ({"observation_names": ("a", "c", "b")}, "other observations (their order)"),
        ({"interval": 0.2}, "control interval of 0.1 s: expected 0.2 s"),
    ],
)
def test_a_policy_for_something_else(change, words):
    made_up().check(**MINE)
    assert words in refusal(lambda: made_up().check(**{**MINE, **change}))


# ---- files of strangers --------------------------------------------------------------------------


def repacked(tmp_path: Path, change) -> Path:
    """Return a good policy's file after ``change`` of its content."""
    made_up().save(tmp_path / "good.zip")
    with zipfile.ZipFile(tmp_path / "good.zip") as file:
        content = json.loads(file.read("policy.json"))
    changed = change(content)
    path = tmp_path / "policy.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        whole = changed if isinstance(changed, bytes) else json.dumps(content).encode()
        file.writestr("policy.json", whole)
    return path


STRANGE = {
    "nan": (lambda c: c.update(mean=[0.0, float("nan"), 1.0]), "malformed"),
    "short": (lambda c: c.update(mean=[0.0, 0.0]), "expected mean and variance of shape (3,)"),
    "layer": (lambda c: c["weights"].__setitem__(1, [[0.0] * 5] * 2), "layer 1 has shape (2, 5)"),
    "ragged": (lambda c: c["weights"].__setitem__(0, [[0.0], [0.0, 1.0]]), "finite numbers"),
    "missing": (lambda c: c.pop("biases"), "missing required field `biases`"),
    "bounds": (lambda c: c.update(high=[0.0, 5.0]), "expected 2 with low < high"),
    "variance": (lambda c: c.update(variance=[-1.0, 1.0, 1.0]), "variance is -1: expected"),
    "no_json": (lambda c: b"{", "Input data was truncated"),
    "deep": (lambda c: b'{"card":{"training":' + b'{"a":' * 10**5, "recursion"),
    "list": (lambda c: b"[]", "Expected `object`, got `array`"),
    "format": (lambda c: c.update(format="stiction-envs policy 3"), "policy 3'"),
    "activation": (lambda c: c["card"].update(activation="exec"), "Invalid enum value 'exec'"),
    "names": (lambda c: c["card"].update(observation_names=[1]), "Expected `str`, got `int`"),
    "clip": (lambda c: c["card"].update(clip=-1.0), "Expected `float` > 0.0"),
    "environment": (lambda c: c["card"].update(environment="GTE"), "matching regex"),
}


@pytest.mark.parametrize("name", STRANGE)
def test_a_strange_file_is_one_clear_line(tmp_path, name):
    change, words = STRANGE[name]
    path = repacked(tmp_path, change)
    line = refusal(lambda: Policy.load(path), "policy.zip: not a policy of `stiction train`")
    assert words in line


def test_a_zip_bomb_is_not_unpacked(tmp_path, monkeypatch):
    path = repacked(tmp_path, lambda _: bytes(2**28))
    assert path.stat().st_size < 2**20
    monkeypatch.setattr(zipfile.ZipFile, "open", lambda *_: pytest.fail("unpacked"))
    refusal(lambda: Policy.load(path), r"bytes unpacked: expected up to 67108864")


def test_a_zip_of_something_else_or_none(tmp_path):
    path = tmp_path / "policy.zip"
    refusal(lambda: Policy.load(path), r"policy\.zip")
    path.write_bytes(b"PK\x03\x04broken")
    refusal(lambda: Policy.load(path), r"policy\.zip")
    words = {"policy.pth": "pickled code and is not opened", "mean.npy": "no policy.json in it"}
    for entry, says in words.items():
        with zipfile.ZipFile(path, "w") as file:
            file.writestr(entry, b"x")
        refusal(lambda: Policy.load(path), says)
