"""What counts as beating, and one yardstick for all agents of the policy benchmark."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.harness import Row, Rows
from benchmarks.learning import policies, policies_page, policies_run
from benchmarks.learning.policies_pictures import LOOKS
from benchmarks.learning.policies_plan import (
    SMALL,
    TRAINED,
    Cell,
    Contestant,
    Plan,
    Training,
    cells,
    environment,
    tables,
    trainings,
    unlearned,
)
from benchmarks.learning.policies_results import Against, Results
from benchmarks.learning.policies_run import (
    Episodes,
    Trained,
    best_algorithm,
    code_today,
    compensate,
    train_all,
)
from benchmarks.learning.policies_statistics import Estimate
from benchmarks.learning.search_rows import KEPT, table_of
from stiction_envs.envs.agents import GatedTable, NoDither
from stiction_envs.envs.evaluation import evaluate
from stiction_envs.measured import AmplitudeRow
from tuning.policies.evaluation import read_agent, within_bounds


def against(errors: float, vibration: float, sure: bool = True) -> Against:
    improvement = Estimate(0.9, 0.6 if sure else 0.4, 1.0)
    ratio = {key: Estimate(errors, errors, errors) for key in ("position", "orientation")}
    ratio |= {key: Estimate(vibration, vibration, vibration) for key in ("moving", "at_rest")}
    both = {key: improvement for key in ("position", "orientation")}
    return Against(ours="a", theirs="b", ratio=ratio, improvement=both)


def test_who_is_better_without_doubt_and_as_calm_beats():
    assert against(0.8, 1.0).beats
    assert not against(0.8, 1.01).beats
    assert not against(0.8, 1.0, sure=False).beats


def test_the_aim_asks_for_less_error_and_no_more_vibration():
    assert against(0.6, 1.0).meets_aim
    assert not against(0.62, 1.0).meets_aim  # 40 % of the orientation
    assert not against(0.6, 1.01).meets_aim


def test_the_iiwa_waits_for_the_best_algorithm():
    plan = Plan()
    assert {t.robot for t in trainings(plan, None)} == {"panda"}
    assert {t.algorithm for t in trainings(plan, "td3") if t.robot == "iiwa7"} == {"td3"}
    assert len(trainings(plan, "td3")) == 25


def test_trainings_of_earlier_code_are_counted(tmp_path: Path):
    wanted = trainings(Plan(), None)
    found = [
        Trained(t, tmp_path, code, None, np.zeros((2, 1)))
        for t, code in zip(wanted, (code_today(), "earlier", "another"), strict=False)
    ]
    episodes = Episodes(tmp_path, Plan())
    results = Results(episodes=episodes, plan=Plan(), there=(), trained=found, best="sac")
    assert results.by_earlier_code == 2
    assert results.rates == {}


def test_the_best_algorithm_is_known_when_all_of_the_panda_are_trained(tmp_path: Path):
    wanted = trainings(SMALL, None)
    best = {"ppo": -0.9, "td3": -0.5, "sac": -0.8}
    trained = {
        t: Trained(t, tmp_path, "", 100.0, np.array([[0.0, 1.0], [-1.0, best[t.algorithm]]]))
        for t in wanted
    }
    assert best_algorithm(trained, wanted) == "td3"
    assert best_algorithm({t: trained[t] for t in wanted[1:]}, wanted) is None


def test_a_training_is_kept_whatever_code_made_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    asked = []

    def train_one(job: tuple[Training, int, Path]) -> dict[str, Any]:
        asked.append(job[0].name)
        return {"code": "any", "steps_per_second": None, "curve": [[0.0], [-1.0]]}

    def fill(self: Rows, jobs: dict, measure: Any, **_: Any) -> dict:
        return one_process(self, jobs, measure)

    one_process = Rows.fill
    monkeypatch.setattr(Rows, "fill", fill)
    monkeypatch.setattr(policies_run, "train_one", train_one)
    wanted = trainings(SMALL, None)[:2]
    for _ in range(2):
        found = train_all(tmp_path, SMALL, wanted, 1.0)
        assert [x.code for x in found.values()] == ["any", "any"]
    assert asked == [t.name for t in wanted]


def test_episodes_are_kept_until_what_they_depend_on_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    options = {"joint": 7, "load": "load", "direction": "+"}
    cell = Cell(robot="panda", experiment="sje", task="ramps", friction=1.0, options=(options,))
    episodes, [none, *_] = Episodes(tmp_path, Plan(runs=2)), unlearned("panda", "sje")
    assert episodes.measure([(cell, none)], 0.0) == 1
    assert episodes.measure([(cell, none)], 10.0) == 0
    took = episodes.seconds(cell, none)
    assert len(episodes.read(cell, none)) == 2
    assert took > 0
    again = Episodes(tmp_path, Plan(runs=2))
    assert again.measure([(cell, none)], 0.0) == 0
    assert again.measure([(replace(cell, friction=0.8), none)], 0.0) == 1
    assert again.measure([(cell, replace(none, made_of="another"))], 0.0) == 1
    assert again.seconds(cell, none) == took
    monkeypatch.setattr(policies_run, "code_digest", lambda *_: "another")
    assert Episodes(tmp_path, Plan(runs=2)).measure([(cell, none)], 0.0) == 1


def test_tables_are_cut_to_the_amplitudes_of_the_environment():
    env = environment("panda", "gte").make(1)
    top = env.single_action_space.high
    much, little = AmplitudeRow(1, 20.0, 2.0 * top[0]), AmplitudeRow(3, 30.0, 0.5 * top[2])
    cut = within_bounds(env, (much, little))
    assert cut == (AmplitudeRow(1, 20.0, float(top[0])), little)


def test_tables_play_what_is_in_them_on_every_arm():
    over = 0  # amplitudes that had to be cut, without which this would say little
    for robot in Plan().robots:
        for experiment in ("gte", "sje"):
            env = environment(robot, experiment).make(1)
            n, top = env.core.n, env.single_action_space.high
            at_rest = np.zeros((1, len(env.observation_names)))
            played = {one.name: one.make(env) for one in unlearned(robot, experiment)}
            for name, table in tables(robot, experiment).items():
                [action], _ = played[name].predict(at_rest)
                for row in table:
                    j = row.joint - 1
                    expected = min(row.amplitude_nm, top[j])
                    assert action[j] == pytest.approx(expected, rel=1e-6), (robot, name)
                    assert action[n + j] == pytest.approx(row.frequency_hz), (robot, name)
                    over += row.amplitude_nm > top[j]
            for name in {"none", "feedforward", "push", "rule"} & set(played):
                [action], _ = played[name].predict(at_rest)  # without torque there is nothing to do
                assert not action[:n].any(), name
    assert over


def test_gated_is_what_the_command_plays_and_the_table_that_the_search_kept():
    task = environment("panda", "gte")
    env = task.make(1)
    [ours] = [one.make(env) for one in unlearned("panda", "gte") if one.name == "gated"]
    command = read_agent("gated", task, env)
    kept = GatedTable(env, within_bounds(env, table_of(KEPT / "panda_gte_gated_1600.csv")))
    for name in ("amplitude", "frequency", "gate"):
        mine = getattr(ours, name)
        assert (mine == getattr(command, name)).all()
        assert (mine == getattr(kept, name)).all()
    assert "gated" not in [one.name for one in unlearned("iiwa7", "gte")]


@pytest.mark.slow
def test_compensation_does_what_the_argument_does_with_the_undithered_runs_of_others():
    ask = [3], {"trajectory": "triangle", "stiffness": (200, 20, 0)}
    plain = environment("panda", "gte").make(1)
    [none] = evaluate(plain, NoDither(plain), *ask)
    compensate(plain, plain.core.experiment.compensation("push"))
    [ours] = evaluate(plain, NoDither(plain), *ask)
    argument = environment("panda", "gte", compensation="push").make(1)
    [theirs] = evaluate(argument, NoDither(argument), *ask)
    for name in ("position_left_m", "orientation_left_rad", "vibration_at_rest_mm", "duration_s"):
        assert ours[name] == theirs[name] != none[name]
    name = "undithered_position_left_m"
    assert ours[name] == none[name] != theirs[name]


def test_every_agent_has_a_look():
    names = {a.name for r in Plan().robots for e in ("gte", "sje") for a in unlearned(r, e)}
    assert names | set(TRAINED.values()) <= set(LOOKS)


class MadeUp(Episodes):
    """Episodes that nobody simulated."""

    def read(self, cell: Cell, one: Contestant) -> list[Row]:
        rng = np.random.default_rng(sum(map(ord, f"{one.name}{cell.task}{cell.friction}")))
        count = len(self.runs(one)) * len(cell.options)
        names = ("position_left_m", "orientation_left_rad", "position_resting_m", "tracking_error")
        names += ("orientation_resting_rad", "vibration_moving_mm", "vibration_at_rest_mm")
        names += ("power", "torque_rate", "return", "tau_sje_nm", "oscillation_mrad")
        ones = ("position_left_m", "orientation_left_rad", "position_resting_m", "vibration_mm")
        plain = {f"undithered_{name}": 1.0 for name in (*ones, "orientation_resting_rad")}
        plain |= {"tau_base_nm": 1.0, "terminated": True}
        return [{**plain, **{name: rng.uniform(0.5, 1) for name in names}} for _ in range(count)]

    def seconds(self, cell: Cell, one: Contestant) -> float:
        return 1.0


@pytest.mark.slow
def test_the_page_holds_every_cell_and_agent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    plan = Plan(runs=2, paths=2, frictions=(1.0, 1.2))
    curve = np.array([[0.0, 1.0, 2.0], [-1.0, -0.9, -0.8]])
    trained = [Trained(t, tmp_path, "any", 100.0, curve) for t in trainings(plan, "td3")]
    there = [(c, a) for c in cells(plan) for a in unlearned(c.robot, c.experiment)]
    there += [
        (c, Contestant(name=TRAINED[t.algorithm], make=str, made_of="", run=t.run))
        for c in cells(plan)
        for t in (x.training for x in trained)
        if (t.robot, t.experiment) == (c.robot, c.experiment)
    ]
    monkeypatch.setattr(policies_page, "draw_behaviour", lambda *_: ("TD3", 0.01))
    episodes = MadeUp(tmp_path, plan)
    results = Results(episodes=episodes, plan=plan, there=there, trained=trained, best="td3")
    values = policies_page.page(results, tmp_path)
    options = policies.STUDY.parser().parse_args(["--out", str(tmp_path)])
    text = policies.STUDY.write_page(options, **values)
    for cell, one in there:
        assert f"## {'Panda' if cell.robot == 'panda' else 'Iiwa'}, {cell.task}" in text
        assert f"| {one.name}" in text
    assert {p.name for p in tmp_path.glob("*.png")} == {
        "policies_curves.png",
        "policies_pareto.png",
    }
