"""Tests of `accuracy.soak`: a round is clean and the same again, and each check can fail."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from benchmarks.accuracy import soak
from benchmarks.accuracy import soak_draws as draws
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.plant import Plant

SHORT = {"rest": 1, "dither": 1, "shaken": 1, "let go": 2, "stops": 2}


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four simulations through few blocks: 1400 steps a round, without conformance."""
    for module in (soak, draws):
        monkeypatch.setattr(module, "NSIM", 4)
    monkeypatch.setattr(soak, "PHASES", SHORT)
    monkeypatch.setattr(soak, "ROUND", 4 * soak.BLOCK * sum(SHORT.values()))
    monkeypatch.setattr(soak, "CONFORMANCE_EVERY", 10**9)


def drawn(number: int = 1) -> tuple[Plant, FrictionParameters, np.random.Generator]:
    rng = np.random.default_rng([0, number])
    model = draws.draw_model(rng, draws.draw_arm(rng))
    friction = draws.draw_friction(rng, model)
    return Plant(model, draws.NSIM, parameters=friction, threads=1), friction, rng


def kinds(checks: soak.Checks) -> set[str]:
    return {what for what, _ in checks.violations}


def test_rounds_are_clean_and_the_same_again(short: None) -> None:
    rows = [soak.one_round(3, k) for k in range(1, 4)]
    assert [r["violations"] for r in rows] == [[], [], []]
    assert [r["steps"] for r in rows] == [soak.ROUND] * 3
    again = soak.one_round(3, 2)
    assert again["largest"] == rows[1]["largest"]
    assert 0 < again["largest"]["bristle"] <= 1


def test_drawn_arms_have_2_to_9_joints_and_inertias_that_can_exist() -> None:
    found = set()
    for k in range(40):
        model = mujoco.MjModel.from_xml_string(draws.random_mjcf(np.random.default_rng(k)))
        inertia = np.sort(model.body_inertia[1:], axis=1)
        assert np.all(inertia[:, 2] <= inertia[:, :2].sum(axis=1) * (1 + 1e-9))
        found.add(model.nv)
    assert found == set(range(2, 10))


def test_a_state_that_is_not_finite_is_noted(short: None) -> None:
    plant, friction, _ = drawn()
    checks = soak.Checks(plant, friction)
    plant.state[1][2, 0] = np.nan
    assert not checks.state("dither")
    assert [(v["what"], v["sim"]) for v in checks.violations.values()] == [("not finite", 2)]


def test_speeds_and_bristles_over_their_bounds_are_noted(short: None) -> None:
    plant, friction, _ = drawn()
    checks = soak.Checks(plant, friction)
    assert checks.state("rest")
    assert not checks.violations
    plant.state[1][1] = 1e6
    z = plant.batch.bind("act")
    z[3] = 1.1 * friction.stiction.max() / friction.bristle_stiffness.min()
    checks.state("stops")
    assert {(v["what"], v["sim"]) for v in checks.violations.values()} == {
        ("speed", 1),
        ("bristle", 3),
    }


def test_energy_that_nothing_gave_is_noted(short: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """A plant whose speeds grow by a tenth in every block gains energy while nothing drives."""
    plant, friction, rng = drawn()
    run = Plant.run

    def fed(self: Plant, torque: np.ndarray) -> np.ndarray:
        out = run(self, torque)
        if not torque.any():
            self.state[1][:] = 1.5 * self.state[1] + 0.5
        return out

    monkeypatch.setattr(Plant, "run", fed)
    assert "energy rise" in kinds(soak.soak(plant, friction, rng))


def test_an_arm_that_slides_at_rest_is_noted(short: None, monkeypatch: pytest.MonkeyPatch) -> None:
    plant, friction, rng = drawn()
    run, calls = Plant.run, list[int]()

    def sinking(self: Plant, torque: np.ndarray) -> np.ndarray:
        calls.append(1)
        return run(
            self, torque + (torque.shape[2] * friction.stiction.max() if len(calls) == 1 else 0)
        )

    monkeypatch.setattr(Plant, "run", sinking)
    assert "motion at rest" in kinds(soak.soak(plant, friction, rng))


def test_an_arm_that_creeps_at_rest_is_noted(short: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """By little, as MuJoCo's default `frictionloss` does: far within the presliding distance."""
    monkeypatch.setattr(soak, "PHASES", {**SHORT, "rest": soak.WATCHED + 2})
    plant, friction, rng = drawn()
    least = float((plant.stiction / friction.bristle_stiffness).min())
    run, calls = Plant.run, list[int]()

    def creeping(self: Plant, torque: np.ndarray) -> np.ndarray:
        calls.append(1)
        out = run(self, torque)
        if len(calls) <= soak.WATCHED + 2:
            self.state[0][:, self.sticking.motor[0]] += 0.01 * least
        return out

    monkeypatch.setattr(Plant, "run", creeping)
    found = kinds(soak.soak(plant, friction, rng))
    assert "creep" in found
    assert "motion at rest" not in found


def test_energy_is_that_of_a_known_state(short: None) -> None:
    plant, friction, _ = drawn()
    checks = soak.Checks(plant, friction)
    before, _ = checks.energy()
    plant.batch.bind("act")[:] = 1e-4
    after, _ = checks.energy()
    np.testing.assert_allclose(after - before, friction.bristle_stiffness.sum(axis=1) * 0.5e-8)
    plant.state[1][:, plant.sticking.motor[0]] = 2.0
    moving, free = checks.energy()
    least = friction.rotor_inertia[:, 0] * 2.0  # J q̇² / 2, the link's comes on top
    assert np.all(moving - after > least)
    assert free.all()
    plant.state[0][0, plant.sticking.motor[0]] = 100.0
    assert checks.energy()[1].tolist() == [False, True, True, True]


def test_a_round_that_breaks_is_a_row_and_exit_code_1(
    short: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*arguments: object) -> None:
        raise ValueError("made")

    monkeypatch.setattr(soak, "draw_friction", broken)
    argv = ["--work", str(tmp_path), "--out", str(tmp_path), "--steps", str(2 * soak.ROUND)]
    assert soak.main(argv) == 1
    rows = [json.loads(x)["row"] for x in (tmp_path / "soak.jsonl").read_text().splitlines()]
    assert [r["violations"][0]["what"] for r in rows] == ["ValueError: made"] * 2
    assert "ValueError: made" in (tmp_path / "soak.md").read_text()


def test_an_interrupted_soak_goes_on(
    short: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    argv = ["--work", str(tmp_path), "--out", str(tmp_path), "--seed", "3"]
    argv += ["--steps", str(3 * soak.ROUND)]
    one_round, asked = soak.one_round, []

    def stopping(seed: int, number: int) -> dict:
        asked.append(number)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return one_round(seed, number)

    monkeypatch.setattr(soak, "one_round", stopping)
    assert soak.main(argv) == 130
    assert soak.main(argv) == 0
    assert asked == [0, 1, 1, 2]
    assert soak.main(argv) == 0
    assert asked == [0, 1, 1, 2]
    assert "gave no violation" in (tmp_path / "soak.md").read_text("utf-8")
