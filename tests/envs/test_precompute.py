"""Shipped and cached base torques, undithered runs and poses equal simulated ones."""

from pathlib import Path

import numpy as np
import pytest

from stiction_envs.experiments.gte.protocol import episode_settings
from stiction_envs.experiments.sje import undithered as sje_base
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import load_protocol
from stiction_envs.friction.parameters import load_friction, scaled
from stiction_envs.precomputed import store
from stiction_envs.reporting.kept_rows import KeptRows
from tests.envs import make_precomputed as precompute
from tests.envs.helpers import QUICK, make
from tests.envs.test_suite import IDS

SHIPPED = store.SHIPPED
OUT_OF_DATE = (
    "what is shipped is not what the code makes: if the change is meant, run "
    "python -m tests.envs.make_precomputed"
)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of a process that knows nothing, and nothing shipped."""
    monkeypatch.setenv("STICTION_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(store, "SHIPPED", tmp_path / "nothing")
    monkeypatch.setattr(store, "_memory", {})
    return tmp_path / "cache"


# ---- shipped -------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["panda", "iiwa7", "iiwa14"])
def test_what_is_shipped_is_what_is_simulated(robot, cache):
    """Bit for bit on one machine; another processor may differ in rounding.

    Only the first and the last random path are tested: paths are independent of each other.
    """
    count = episode_settings().random_paths
    precompute.simulate(robot, (0, count - 1))
    files = list(cache.iterdir())
    assert len(files) == 5
    for path in files:
        simulated = KeptRows(path, store.code_digest()).every
        found = KeptRows(SHIPPED / path.name).every
        assert found, f"{path.name}: {OUT_OF_DATE}"
        if path.name.startswith(("random_paths", "undithered_random")):
            assert len(found) == count, OUT_OF_DATE
            assert len(simulated) == 2
            assert found.keys() >= simulated.keys(), OUT_OF_DATE
        else:
            assert found.keys() == simulated.keys(), OUT_OF_DATE
        for name in simulated:
            one, other = (flat(x[name]) for x in (found, simulated))
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-15, err_msg=OUT_OF_DATE)


def flat(value: object) -> np.ndarray:
    """Return all numbers of nested lists and dicts."""
    values = value.values() if isinstance(value, dict) else [value]
    return np.concatenate([np.ravel(np.array(v, dtype=float)) for v in values])


@pytest.mark.parametrize("name", IDS)
def test_a_first_contact_simulates_no_reference(name, tmp_path, monkeypatch):
    monkeypatch.setenv("STICTION_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(store, "_memory", {})
    env = make(name)
    env.reset(seed=0)
    if "GTE" in name:
        make(name, fixed_options={"trajectory": "random"}).reset(seed=0)
    assert not (tmp_path / "cache").exists(), f"{name}: {OUT_OF_DATE}"


# ---- cached --------------------------------------------------------------------------------------


def test_whatever_a_base_torque_depends_on_is_in_its_key():
    of = SingleJointExperiment
    usual = of("panda")
    nominal, slow = load_friction("panda"), load_protocol("panda").replace(ramp_rate=0.05)
    others = [
        of("iiwa7"),
        of("panda", friction=scaled(nominal, {"stiction": 0.9})),
        of("panda", friction=scaled(nominal, {"load_high": 0.9})),
        of("panda", protocol=slow),
        of("panda", timestep=5e-4),
    ]
    assert len({sje_base.fingerprint(e) for e in [usual, *others]}) == 1 + len(others)
    for same in (of("panda"), of("panda", scatter=False, seed=3, threads=1)):
        assert sje_base.fingerprint(same) == sje_base.fingerprint(usual)


def test_an_episode_is_the_same_bits_whether_looked_up_or_simulated(cache):
    seen = []
    for kept in (0, 2):  # poses, and base torques or undithered runs
        assert len(list(cache.glob("*.jsonl"))) == kept
        store.forget()
        env = make(fixed_options=QUICK)
        out = [env.reset(seed=4)[0].tobytes()]
        rng = np.random.default_rng(4)
        low, high = env.action_space.low, env.action_space.high
        for _ in range(3):
            action = (low + rng.uniform(0, 0.3, low.shape) * (high - low)).astype(np.float32)
            observation, reward, *_ = env.step(action)
            out += [observation.tobytes(), reward]
        seen.append(out)
    assert seen[0] == seen[1]
