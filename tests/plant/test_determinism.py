"""The plant gives the same bits for any batch, any position in it, any threads, any blocks."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from stiction_envs.friction.parameters import QUANTITIES, FrictionParameters
from stiction_envs.plant import Plant
from tests.plant.test_plant import panda

DT = 1e-3
MANY, K = 64, 130


def mixed(asymmetric: bool) -> tuple[np.ndarray, FrictionParameters, np.ndarray]:
    """Poses, friction and torques of 64 simulations, no two alike."""
    rng = np.random.default_rng(5)
    low, high = panda().arm.limits.position.T
    q = rng.uniform(low + 0.5, high - 0.5, (MANY, 7))
    p = panda().parameters.tile(MANY)
    scale = rng.uniform(0.5, 1.5, (MANY, 7, 1))
    ratio = rng.uniform(0.8, 1.25, (MANY, 7, 1)) if asymmetric else 1.0
    p = p.replace(
        stiction=p.stiction * scale * np.concatenate([scale**0, scale**0 * ratio], axis=2),
        bristle_stiffness=p.bristle_stiffness * rng.uniform(0.5, 1.2, (MANY, 7)),
        rotor_inertia=p.rotor_inertia * rng.uniform(0.9, 1.5, (MANY, 7)),
        ripple_phase=rng.uniform(0, 6, (MANY, 7)),
        warm_up_friction=rng.uniform(0, 1, (MANY, 7)),
        warm_up_time=rng.uniform(0.05, 1, (MANY, 7)),
        offset=rng.uniform(-0.2, 0.2, (MANY, 7)),
    )
    t = np.arange(K)[None, :, None] * DT
    amplitude, hz = rng.uniform(0, 2, (MANY, 1, 7)), rng.uniform(10, 90, (MANY, 1, 7))
    return q, p, 8 * t + amplitude * np.sin(2 * np.pi * hz * t)


def some(p: FrictionParameters, rows: object) -> FrictionParameters:
    """Return the friction of some simulations."""
    return FrictionParameters(**{k: getattr(p, k)[rows] for k in QUANTITIES})


def started(q: np.ndarray, p: FrictionParameters, threads: int) -> Plant:
    """Return simulations in poses (N, 7) [rad] with a friction each."""
    plant = Plant(panda(), len(q), parameters=p, threads=threads)
    plant.reset(np.arange(len(q)), q)
    plant.set_friction(np.arange(len(q)), p)
    return plant


def angles(rows: list[int], threads: int, blocks: list[int], asymmetric: bool) -> np.ndarray:
    """Run the simulations ``rows`` of `mixed` as a batch of their own, in blocks of steps."""
    q, p, torque = mixed(asymmetric)
    plant = started(q[rows], some(p, rows), threads)
    cuts = np.cumsum([0, *blocks])
    parts = [plant.run(torque[rows][:, a:b]) for a, b in pairwise(cuts)]
    return np.concatenate(parts, axis=1)


@cache
def reference(asymmetric: bool) -> np.ndarray:
    out = angles(list(range(MANY)), 1, [K], asymmetric)
    assert np.ptp(out, axis=1).max(axis=1).min() > 1e-3  # every simulation moves
    return out


@pytest.mark.parametrize("asymmetric", [False, True], ids=["symmetric", "asymmetric"])
@pytest.mark.parametrize(
    ("rows", "threads", "blocks"),
    [([63], 1, [K]), ([9, 3, 40, 41, 8, 2, 60], 2, [K]), ([4, 50, 7], 2, [7, 1, 1, 98, 23])],
    ids=["one", "seven", "blocks"],
)
def test_same_bits_in_any_batch_and_blocks(rows, threads, blocks, asymmetric):
    """Batch size, position in the batch, threads and blocks change nothing, bit for bit."""
    out = angles(rows, threads, blocks, asymmetric)
    assert out.tobytes() == reference(asymmetric)[rows].tobytes()


def test_subset_leaves_the_others_alone():
    """Simulations with clocks of their own: run in any order they end the same."""
    q, p, torque = mixed(asymmetric=False)
    rows = np.arange(4)
    plant = started(q[rows], some(p, rows), 2)
    out = {i: [] for i in range(4)}

    def go(ids: list[int], a: int, b: int) -> None:
        for i, part in zip(ids, plant.run(torque[ids, a:b], np.array(ids)), strict=True):
            out[i].append(part)

    before = plant.position
    go([1, 3], 0, 33)
    np.testing.assert_array_equal(plant.position[[0, 2]], before[[0, 2]])
    go([0], 0, 33)
    go([0, 1, 3], 33, 70)  # clocks agree again
    go([2], 0, 5)
    go([3], 70, K)
    go([0, 1], 70, K)
    go([2], 5, K)
    for i in range(4):
        assert np.concatenate(out[i]).tobytes() == reference(False)[i].tobytes()


def test_reset_forgets_everything():
    """After a reset a simulation that has run is a new one."""
    q, p, torque = mixed(asymmetric=True)
    plant = started(q[[5, 6]], some(p, [0, 1]), 1)
    plant.run(torque[[5, 6]])
    plant.reset(np.arange(2), q[:2])
    plant.set_friction(np.arange(2), some(p, [0, 1]))
    assert plant.run(torque[:2]).tobytes() == reference(True)[:2].tobytes()
