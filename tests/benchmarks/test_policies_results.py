"""What counts as beating, and one yardstick for all agents of the policy benchmark."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import _policies_rows
from benchmarks._policies_pictures import LOOKS
from benchmarks._policies_plan import (
    TRAINED,
    Cell,
    Plan,
    Training,
    environment,
    episodes_in_all,
    tables,
    trainings,
    trainings_in_all,
    unlearned,
)
from benchmarks._policies_results import Against, Results
from benchmarks._policies_rows import Rows, compensate
from benchmarks._policies_statistics import Estimate
from benchmarks._policies_training import DONE, Folder, code_today, folder
from benchmarks._search_rows import KEPT, table_of
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
    assert trainings_in_all(plan) == len(trainings(plan, "td3")) == 25


def finished(work: Path, code: str, training: Training, rate: float | None = 500.0) -> Folder:
    """Return the folder of a training that is over."""
    one = folder(work, Plan(), training)
    one.path.mkdir(parents=True)
    text = json.dumps({"code": code, "steps_per_second": rate})
    (one.path / DONE).write_text(text, "utf-8")
    return one


def results(work: Path, **found: Any) -> Results:
    """Return results of which only these are there."""
    nothing: dict[str, Any] = {"there": (), "folders": (), "best": None, "in_all": ()}
    nothing["rows"] = Rows(work / "rows", Plan())
    return Results(plan=Plan(), **{**nothing, **found})


def test_trainings_of_earlier_code_are_counted(tmp_path: Path):
    codes = code_today(), "earlier", "another"
    some = zip(codes, trainings(Plan(), None), strict=False)
    folders = [finished(tmp_path, code, training) for code, training in some]
    assert results(tmp_path, folders=folders).by_earlier_code == 2
    assert results(tmp_path, folders=folders[:1]).by_earlier_code == 0


def test_time_is_not_known_before_one_training_of_each_kind_is_finished(tmp_path: Path):
    kinds = [t for t in trainings(Plan(), None) if t.run == 0]
    assert len({(t.experiment, t.algorithm) for t in kinds}) == len(kinds) == 4
    folders = [finished(tmp_path, "any", t, 100.0 * (k + 1)) for k, t in enumerate(kinds)]
    idle = replace(kinds[0], run=1)  # its last process had nothing to do
    folders.append(finished(tmp_path, "any", idle, None))
    assert results(tmp_path, folders=folders[1:], best="sac").training_hours is None
    assert results(tmp_path, folders=folders).training_hours is None  # of the iiwa: which?
    found = results(tmp_path, folders=folders, best="sac")
    rates = {(t.experiment, t.algorithm): 100.0 * (k + 1) for k, t in enumerate(kinds)}
    assert found.rates == rates
    # five runs of each on the Panda, and of SAC on the iiwa, two at a time
    seconds = 5 * Plan().steps * (sum(1 / x for x in rates.values()) + 1 / rates["gte", "sac"])
    assert found.training_hours == pytest.approx(seconds / 2 / 3600)


def test_rows_are_kept_with_the_time_they_took_until_code_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    options = {"joint": 7, "load": "load", "direction": "+"}
    cell = Cell(robot="panda", experiment="sje", task="ramps", friction=1.0, options=(options,))
    rows, [none, *_] = Rows(tmp_path, Plan(runs=2)), unlearned("panda", "sje")
    assert not rows.there(cell, none)
    rows.measure(cell, none)
    assert rows.there(cell, none)
    before, took = rows.read(cell, none), rows.seconds(cell, none)
    assert len(before) == 2
    assert took > 0
    rows.measure(cell, none)  # they are there
    assert rows.seconds(cell, none) == took

    found = results(tmp_path, rows=rows, there=[(cell, none)])
    assert found.measuring_hours == pytest.approx(took / 2 * episodes_in_all(Plan()) / 3600)
    assert results(tmp_path).measuring_hours is None

    monkeypatch.setattr(_policies_rows, "code_today", lambda: "another")
    assert not rows.there(cell, none)


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
