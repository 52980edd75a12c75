"""Would it be found? Verdicts, what cannot be shown, files, and going on after an interruption."""

import json
from dataclasses import replace

import numpy as np
import pytest

from stiction_envs.gap.causes import cause_named, register, unregister
from stiction_envs.gap.causes.log.torque_offset import TorqueOffset
from stiction_envs.gap.diagnosis import diagnose_logs, model_of
from stiction_envs.hidden.hidden_logs import make_case
from stiction_envs.hidden.rehearsal.jobs import NOTHING, CauseJob, judge
from stiction_envs.hidden.rehearsal.rehearse import plan, rehearse
from stiction_envs.hidden.rehearsal.torque_logs import hideable
from stiction_envs.hidden.servo_effects import EFFECTS as SERVO_EFFECTS
from stiction_envs.hidden.torque_effects import EFFECTS, FRICTION, ROTOR, Draw
from stiction_envs.hidden.worlds import World
from tests.command_line import csv_rows
from tests.gap.small_logs import dry, found, hidden, only

FEW = ("coulomb_friction", "gravity_compensation_missing")


@pytest.fixture(scope="module")
def planned(two):
    """A log of 10 s with dry friction, in which two causes are to be hidden."""
    return plan(hidden(two, dry, seconds=10.0), two, causes=FEW)


@pytest.fixture(scope="module")
def rehearsed(planned):
    return planned.run()


def rows_of(result, cause: str) -> dict:
    return {r.joint: r for r in result.rows if r.cause == cause}


def test_a_large_cause_is_found_and_nothing_else(rehearsed):
    assert rehearsed.named_without == ()
    (share,) = rows_of(rehearsed, "gravity_compensation_missing").values()
    assert 1e-4 < share.smallest_found < 0.2
    assert (share.joint, share.unit, share.instead) == (0, "1", "")
    dry_rows = rows_of(rehearsed, "coulomb_friction")
    assert sorted(dry_rows) == [1, 2]
    assert all(0.001 < r.smallest_found < 0.1 for r in dry_rows.values())
    assert all(r.smallest_found in r.tried for r in rehearsed.rows)
    (line,) = (x for x in str(rehearsed).split("\n") if x.startswith("coulomb_friction"))
    assert line.split()[-2:] == [dry_rows[1].cell, dry_rows[2].cell]
    assert "With nothing hidden it names no cause." in rehearsed.summary


def test_a_joint_that_rests_shows_no_friction(two):
    """Gravity holds it all the time; friction, and what needs motion, is out of sight."""
    shown = rehearse(only(hidden(two, seconds=10.0), 1), two, causes=["viscous_friction"])
    rest, moving = (rows_of(shown, "viscous_friction")[j] for j in (1, 2))
    assert rest.instead.startswith("not visible in this motion: it changes no torque of joint 1")
    assert rest.tried == ()
    assert rest.what_to_record
    assert moving.smallest_found
    assert (rest.cell, moving.smallest_found > 0) == ("-", True)
    assert "to see viscous_friction, record constant speed" in str(shown)


def test_an_earlier_model_is_what_is_judged(two):
    """The arm's dry friction is known then, and is not named again."""
    log = hidden(two, dry)
    planned = plan(log, two, nominal=model_of(found(two, log)), causes=["stribeck_friction"])
    np.testing.assert_allclose(planned.subject.friction, 0.5, atol=0.03)
    assert np.all(planned.subject.unknown_friction < 0.02)
    again = planned.run()
    assert again.named_without == ()
    assert again.found == len(again.rows)


def test_the_files_hold_all_of_it(rehearsed, tmp_path):
    folder = rehearsed.save(tmp_path / "out")
    rows = csv_rows(folder / "rehearsal.csv")
    assert [(r["cause"], int(r["joint"])) for r in rows] == [
        (r.cause, r.joint) for r in rehearsed.rows
    ]
    for read, row in zip(rows, rehearsed.rows, strict=True):
        assert float(read["smallest_found"]) == pytest.approx(row.smallest_found, rel=1e-3)
        assert len(read["tried"].split()) == len(row.tried)
    made = json.loads((folder / "provenance.json").read_text("utf-8"))
    assert made["command"] == "diagnose"
    assert made["arguments"]["rehearse"] is True
    json.dumps(rehearsed.to_json(), allow_nan=False)


@pytest.mark.slow
def test_processes_change_nothing(planned, rehearsed):
    assert planned.run(threads=2).to_json() == rehearsed.to_json()


VISCOUS, STRIBECK, DRY = "viscous_friction", "stribeck_friction", "coulomb_friction"
LINKS, TIP, GAP = "link_parameters", "payload", "torque_offset"
OTHER_LINK, DRY_1 = f"{LINKS} of joint 2", f"{DRY} of joint 1"
ONE, SLOW, TOOL = (CauseJob(hideable(cause_named(x)), (0, 1)) for x in (VISCOUS, STRIBECK, TIP))
LINK = CauseJob(hideable(cause_named(LINKS)), (0,))
LATE = CauseJob(SERVO_EFFECTS["delay"], (0, 1))
PARTS = ["armature", "damping", "delay"]


@pytest.mark.parametrize(
    ("job", "row", "named", "found", "false", "why"),
    [
        (ONE, 1, [[VISCOUS, [1, 2], []]], "found", "", ""),
        (ONE, 2, [[VISCOUS, [1], []]], "missed", "", "nothing is named"),
        (ONE, 1, [[VISCOUS, [1], [GAP]]], "confused", "", f"these data cannot tell it from {GAP}"),
        (ONE, 1, [[VISCOUS, [1], []], [GAP, [2], []]], "found", "", ""),
        (ONE, 1, [[VISCOUS, [1], []], [TIP, [1, 2], []]], "missed", TIP, f"named, but {TIP} too"),
        (ONE, 1, [[GAP, [1], []]], "missed", GAP, f"named {GAP} instead"),
        (SLOW, 1, [[STRIBECK, [1], []], [DRY, [1], []]], "found", "", ""),
        (LINK, 1, [[LINKS, [1, 2], []]], "missed", OTHER_LINK, f"named, but {OTHER_LINK} too"),
        (TOOL, 0, [[TIP, [2], []]], "found", "", ""),
        (TOOL, 0, [[TIP, [2], []], [DRY, [1], []]], "missed", DRY_1, f"named, but {DRY_1} too"),
        # a lag of servos counts as named for its parts
        (LATE, 1, [["servo_lag", [2], PARTS]], "missed", "", "nothing is named"),
        (
            *(LATE, 1, [["servo_lag", [1], PARTS]], "confused", ""),
            "these data cannot tell it from armature and damping",
        ),
    ],
)
def test_a_run_is_judged(job, row, named, found, false, why):
    run = {"sizes": {}, "named": named, "minor": []}
    assert judge(job, row, run) == (found, [false] if false else [], why)


def test_what_has_no_law_is_said_to_have_none(two):
    class Wave(TorqueOffset):
        name = "wave"
        is_linear = False

    register(Wave())
    try:
        found = rehearse(hidden(two, seconds=8.0), two, causes=["wave"])
    finally:
        unregister("wave")
    assert list(found.runs) == [NOTHING]
    assert {r.instead for r in found.rows} == {
        "not visible in this motion: no law is known by which to hide it"
    }
    assert found.found == 0


def size_of(name: str, joint: int, known: bool, value: float) -> float:
    """The size of `make_case` at which an effect's first parameter has a value."""

    def at(size: float) -> float:
        world = World()
        if known:
            world.coulomb, world.viscous, world.rotor = 0.9 * FRICTION, 0.6 * FRICTION, ROTOR
        draw = Draw(joint=joint - 1, sign=1.0, size=size, rng=np.random.default_rng(0))
        drawn = EFFECTS[name].draw(world, draw)
        values = EFFECTS[name].hide(world, joint - 1, drawn, None)
        return abs(float(next(iter(values.values()))))

    return float(np.log(value / at(0.0)) / np.log(at(1.0) / at(0.0)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "joint", "motion", "known", "promised"),
    [
        ("payload", 5, "fast", False, "smallest_named"),  # this motion cannot tell it from a link
        ("viscous_friction", 3, "fourier", False, "smallest_found"),
        ("presliding_hysteresis", 4, "reversals", True, "smallest_found"),
    ],
)
def test_the_promised_size_is_found_in_a_simulated_robot(name, joint, motion, known, promised):
    """Rehearsed in the log of an arm without it; then simulated by MuJoCo, controller and all."""
    bare = make_case(3, (), motion=motion, known=known)
    planned = plan(bare.logs, bare.robot, nominal=bare.nominal, causes=[name])
    # of a cause that is hidden joint by joint, this joint's runs alone: each has its own noise
    jobs = tuple(j for j in planned.jobs if j.key == NOTHING or joint - 1 in j.joints)
    promise = replace(planned, jobs=jobs).run()
    (row,) = (r for r in promise.rows if r.joint in (0, joint))
    assert promise.named_without == ()
    assert getattr(row, promised) is not None, row
    size = size_of(name, joint, known, getattr(row, promised))
    true = make_case(3, (name,), motion=motion, known=known, joint=joint, size=size)
    found = diagnose_logs(true.logs, true.robot, nominal=true.nominal)
    named = {c.name: c for c in found.causes}
    assert list(named) == [name]
    assert row.joint == 0 or named[name].joints == (joint,)
