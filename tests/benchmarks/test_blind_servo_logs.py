"""The study of causes hidden in servo logs."""

from typing import Any

import pytest

from benchmarks.servo.blind_servo_logs import STUDY, drawn, page, robot_file, score, search
from stiction_envs.gap.servo.servo_diagnosis import diagnose_servo
from stiction_envs.hidden.servo_logs import hide
from stiction_envs.robots import load_arm


def row(hidden: Any, named: Any) -> Any:
    """Return a row as `search` makes it."""
    return {
        "robot": "so101",
        "hidden": hidden,
        "named": named,
        "nominal_rad": [0.02, 0.01],
        "extended_rad": [0.001, 0.002],
        "seconds": 3.0,
    }


def test_named_on_its_joint_on_another_and_false() -> None:
    assert score(row([["delay", 2]], [["delay", 2]])) == (1, 1, 0)
    assert score(row([["delay", 2]], [["delay", 3]])) == (1, 0, 1)
    assert score(row([["delay", 2]], [["damping", 2]])) == (0, 0, 1)
    # dry friction belongs to what refines it, on the same joint only
    both = [["coulomb_friction", 1], ["stribeck_friction", 1]]
    assert score(row([["stribeck_friction", 1]], both)) == (1, 1, 0)
    assert score(row([["stribeck_friction", 2]], both)) == (1, 0, 2)


def test_the_page_counts(tmp_path: Any) -> None:
    rows = {"1": row([["delay", 2]], [["delay", 2], ["damping", 1]]), "4": row([], [])}
    options = STUDY.parser().parse_args(["--out", str(tmp_path)])
    text = STUDY.write_page(options, planned=3, **page(rows))
    assert "Of 1 causes hidden in 2 logs of positions, 1 are named, 1 of them on" in text
    assert "1 of 2 named ones are false" in text
    assert "nothing is named in 1 of 1 logs" in text
    assert "| 1 | so101 | delay 2 | delay 2, damping 1 | 20.0 | 2.0 |" in text


def test_every_fourth_log_hides_nothing() -> None:
    causes = [drawn(k)[1] for k in range(40)]
    assert [not c for c in causes] == [k % 4 == 0 for k in range(40)]
    assert {len(c) for c in causes} == {0, 1, 2, 3}


@pytest.mark.slow
def test_links_a_little_off_are_no_payload() -> None:
    """A body of 14 g would take off error, and spares no cause."""
    assert drawn(3012)[1] == ()
    assert search(3012)["named"] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "hidden", "seed", "found"),
    [
        # without its dry friction a wider dead zone explains nearly as much, and the other way
        # round: each takes off little, together most of 36 mrad
        ("xarm7", ("coulomb_friction", "dead_zone", "servo_stiffness"), 3015, {1}),
        # an offset changes the gravity of the neighbour, which needs no second offset
        ("so100", ("delay", "torque_limit", "encoder_offset"), 5023, {3}),
    ],
)
def test_causes_that_stand_in_for_each_other_are_named_once(robot, hidden, seed, found) -> None:
    arm = load_arm(robot_file(robot))
    case = hide(arm, hidden, seed=seed)
    truth = {name for name, joint in case.hidden if {joint} == found}
    d = diagnose_servo([case.log], arm, case.servo)
    (joint,) = found
    assert {j for c in d.causes if c.name in truth for j in c.joints} == found
    assert d.extended_rms[joint - 1] < 0.2 * d.nominal_rms[joint - 1]
