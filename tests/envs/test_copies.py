"""A copy of an environment in mid-episode goes on with the same bits, beside the original."""

import copy
import pickle

import numpy as np
import pytest
from gymnasium.vector import VectorEnv

from stiction_envs.plant.copies import dumps
from tests.command_line import python
from tests.envs.helpers import GTE, TRIANGLE, divided, mild, same
from tests.envs.test_vector import FIXED


def unpickled(env):
    return pickle.loads(pickle.dumps(env))


def on(env, count: int) -> list:
    """Return what ``count`` steps give; a single environment starts its next episode itself."""
    action, out = mild(env.unwrapped.core, 6, share=0.2), []
    single = not isinstance(env.unwrapped, VectorEnv)
    for _ in range(count):
        out.append(env.step(action if single else np.tile(action, (env.num_envs, 1))))
        if single and (out[-1][2] or out[-1][3]):
            out.append(env.reset())
    return out


@pytest.mark.parametrize(("count", "way"), [(0, copy.deepcopy), (3, unpickled)])
def test_a_copy_goes_on_with_the_same_bits(kind, count, way):
    """Also over the end of an episode and into the next, which is drawn from the generator."""
    env = kind.make_vec(count, **FIXED[kind.name]) if count else kind.make(**FIXED[kind.name])
    env.reset(seed=3)
    on(env, 3)
    other = way(env)
    first = on(other, 40)  # before the original moves: they share no memory
    assert same(on(env, 40), first)
    assert any(np.any(step[2]) for step in first if len(step) == 5), "an episode ended"


@pytest.mark.parametrize(
    "arguments",
    [
        {"sensing": "robot"},
        {"compensation": "push", "randomise": {"friction": 0.2}},
        {"waveform": "square", "payload": (1.0, 0.0, 0.0, 0.1)},
    ],
    ids=str,
)
def test_what_an_arm_remembers_is_copied(arguments):
    """Delayed commands, filters, the observer's state, friction of its own, phases."""
    env = GTE.make_vec(2, **arguments)
    env.reset(seed=1, options=TRIANGLE)
    on(env, 2)
    other = unpickled(env)
    assert same(on(env, 3), on(other, 3))


def test_threads_and_batches_are_copied(kind, monkeypatch):
    env = divided(monkeypatch, kind, 8, 20, threads=2)
    env.reset(seed=1)
    on(env, 2)
    other = unpickled(env)
    assert same(on(env, 3), on(other, 3))


def test_another_process_goes_on_with_the_same_bits(tmp_path):
    """Addresses are of one process: a copy makes its own."""
    env = GTE.make(control_interval_s=0.1)
    env.reset(seed=1, options=TRIANGLE)
    on(env, 2)
    (tmp_path / "env").write_bytes(pickle.dumps(env))
    code = (
        "import pickle; import stiction_envs; from tests.envs.test_copies import on\n"
        "env = pickle.load(open('env', 'rb'))\n"
        "pickle.dump(on(env, 3), open('out', 'wb'))"
    )
    assert python(code, cwd=tmp_path).returncode == 0
    assert same(pickle.loads((tmp_path / "out").read_bytes()), on(env, 3))


def test_arrays_go_on_sharing_their_memory():
    whole = np.arange(24.0).reshape(2, 3, 4)
    turned = np.empty((2, 3, 4), order="F").transpose(1, 0, 2)
    turned[:] = np.arange(24.0).reshape(3, 2, 4)
    fixed = whole[1, ::-1]
    fixed.flags.writeable = False
    views = [whole, whole[:, 1], whole[::-1, :, 2:], fixed, turned, turned[1:, :, ::2]]
    copied = pickle.loads(dumps(views, []))
    assert same(copied, views)
    assert not copied[3].flags.writeable
    for a, b in zip(views, copied, strict=True):
        assert a.strides == b.strides
    copied[0][1, 1, 3] = copied[4][2, 1, 2] = -1.0
    assert copied[1][1, 3] == copied[3][1, 3] == copied[5][1, 1, 1] == -1.0
    assert whole.min() == turned.min() == 0.0
