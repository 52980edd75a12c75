"""Agents without learning: what they do for what they see."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest

from stiction_envs.envs.agents import AGENTS, GatedTable
from stiction_envs.measured.tables import AmplitudeRow
from tests.refusal import refusal

ROWS = (AmplitudeRow(1, 50.0, 0.5), AmplitudeRow(6, 20.0, 0.3, gate_rad_s=0.1))


def seen(env: gym.Env, **values: dict[int, float]) -> np.ndarray:
    """Return an observation of zeros but for some joints (from 1) of a group."""
    names = env.unwrapped.observation_names
    out = np.zeros(len(names), dtype=np.float32)
    for group, joints in values.items():
        for joint, value in joints.items():
            out[names.index(f"{group}_{joint}")] = value
    return out


@pytest.mark.parametrize("agent", AGENTS)
def test_every_agent_stays_in_the_space_alone_and_in_a_batch(kind, agent):
    env = gym.make(kind.iiwa)
    space, made = env.observation_space, AGENTS[agent](env)
    space.seed(0)
    rows = np.stack([space.sample() for _ in range(40)])
    actions, state = made.predict(rows)
    assert actions.dtype == np.float32
    assert actions.shape == (40, 14)
    assert state is None
    assert all(a in env.action_space for a in actions)
    one, _ = AGENTS[agent](env).predict(rows[7])
    assert np.array_equal(one, actions[7])


def test_a_table_without_gates_is_the_table(env, tmp_path):
    rows = [dataclasses.replace(row, gate_rad_s=0.0) for row in ROWS]
    agent = GatedTable(env, rows, speed=np.inf)
    action = agent.predict(seen(env, velocity={1: 1.0, 6: 1.0}))[0]
    assert action[[0, 5]] == pytest.approx([0.5, 0.3])
    assert action[[7, 12]] == pytest.approx([50, 20])
    assert not action[[1, 2, 3, 4, 6]].any()
    file = tmp_path / "table.csv"
    file.write_text("joint,frequency_hz,amplitude_nm\n1,50,0.5\n6,20,0.3\n")
    read = GatedTable(env, file, speed=np.inf)
    assert np.array_equal(read.predict(seen(env))[0], action)


def test_a_gated_table_fades_with_speed(env):
    """exp(−(q̇/v_gate)²) with the table's own gate, or the agent's where it has none."""
    agent = GatedTable(env, ROWS, speed=0.2)
    unit = env.unwrapped.core.speed_unit
    fast = seen(env, velocity={1: 0.2 / unit, 6: -0.2 / unit})
    still, moving = agent.predict(seen(env))[0], agent.predict(fast)[0]
    assert still[[0, 5]] == pytest.approx([0.5, 0.3])
    assert moving[0] == pytest.approx(0.5 * np.exp(-1), rel=1e-5)
    assert moving[5] == pytest.approx(0.3 * np.exp(-4), rel=1e-5)
    assert np.array_equal(moving[7:], still[7:])


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([AmplitudeRow(1, 50.0, 99.0)], "joint 1: 99 N·m: expected 0 to"),
        ([AmplitudeRow(2, 200.0, 0.1)], "joint 2: 200 Hz: expected 5 to 100"),
        ([AmplitudeRow(8, 20.0, 0.1)], "joint 8: expected 1 to 7"),
        ([AmplitudeRow(1, 20.0, 0.1, waveform="square")], "square .*: expected sine"),
    ],
)
def test_wrong_tables(env, rows, words):
    refusal(lambda: GatedTable(env, rows), words)
