"""The report's first screen: one table of causes, who takes how much, what was not shown."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.gap.judge.judgement import Estimate, NamedCause, NotShown
from stiction_envs.gap.links import LinkErrors
from stiction_envs.gap.report.page import cause_table, not_shown, rivals
from stiction_envs.gap.report.results import LogDiagnosis, far_links


def estimate(value: float, half: float) -> Estimate:
    return Estimate(value=value, ci95=[value - half, value + half], on_bound=False)


COULOMB = NamedCause(
    name="coulomb_friction",
    joints=(1, 2, 3),
    gain_percent=40.0,
    parameters={2: {"coulomb_nm": estimate(0.5, 0.1)}}
    | {j: {"coulomb_nm": estimate(0.1 * j, 0.05)} for j in (1, 3)},
    nats=120.4,
    rivals=(("viscous_friction", 1.23), ("link_inertia", 33.0)),
    evidence="it sticks",
    confused_with=("viscous_friction",),
)


def test_the_table_has_value_interval_unit_nats_and_the_best_rival() -> None:
    last = cause_table([COULOMB]).splitlines()[2]
    assert last == (
        "| coulomb_friction | joints 1 to 3 | `coulomb_nm` 0.500 [0.400, 0.600] N·m on joint 2, "
        "0.10 to 0.30 on the others | 120 | **viscous_friction** (1.2) |"
    )
    assert rivals(COULOMB) == ["**viscous_friction** (1.2)", "link_inertia (33)"]


@pytest.mark.parametrize(
    ("parameters", "cell"),
    [
        ({"mass_kg": estimate(-0.6, 0.2)}, "`mass_kg` −0.600 [−0.800, −0.400] kg"),
        (
            {"link": Estimate(value=3, ci95=[3, 3], on_bound=False), "mass_kg": estimate(1.0, 0.5)},
            "`mass_kg` 1.00 [0.500, 1.50] kg",
        ),
        (
            {"com_m": Estimate(value=[0.1, 0.2], ci95=[[0, 0.2], [0, 0.4]], on_bound=False)},
            "`com_m` 0.100 [0, 0.200], 0.200 [0, 0.400] m",
        ),
        (
            {"stretches_s": Estimate(value=[[1.0, 2.5]], ci95=[[1.0, 2.5]], on_bound=False)},  # type: ignore[list-item]
            "`stretches_s` 1 to 2.5 s",
        ),
        ({}, "–"),
    ],
)
def test_values_of_every_kind(parameters: dict[str, Estimate], cell: str) -> None:
    cause = replace(COULOMB, joints=(), parameters={0: parameters}, rivals=(), confused_with=())
    assert cause_table([cause]).splitlines()[2].endswith(f"| whole arm | {cell} | 120 | none |")


def test_what_was_not_shown_has_its_numbers() -> None:
    entries = [
        NotShown(name="payload", joints=(), parameters={"mass_kg": (-5.998, 6.002)}),
        NotShown(
            name="external_spring",
            joints=(2, 4),
            parameters={"stiffness_nm_per_rad": (-3.0, 33.0), "rest_rad": (0.9, 1.1)},
        ),
    ]
    assert not_shown(entries) == [
        "payload, whole arm: `mass_kg` 0.0 ± 6.0 kg",
        "external_spring, joints 2 and 4: `stiffness_nm_per_rad` 15 ± 18 N·m/rad, "
        "`rest_rad` 1.00 ± 0.10 rad",
    ]


def links(*masses: float) -> LinkErrors:
    """Return links of 1 kg that are this much heavier, where CAD is off by 0.1 kg."""
    n = len(masses)
    changes, bodies = np.zeros((n, 10)), np.zeros((n, 10))
    changes[:, 0], bodies[:, 0] = masses, 1.0
    some = np.diag([0.01, *[1e-4] * 9])
    prior = np.kron(np.eye(n), some)
    return LinkErrors(scale=1.0, changes=changes, covariance=prior, links=bodies, prior=prior)


def test_links_beyond_three_deviations_are_no_tolerance(torques: LogDiagnosis) -> None:
    assert far_links(links(0.1, 0.25)) == ""
    assert "link 2 is off by 94 prior standard deviations" in far_links(links(0.1, 9.4))
    percent = {"named": 60.0, "links": 30.0, "set_up": 0.0, "left": 10.0}
    for mass, says, not_said in (
        (0.2, "what CAD is usually off by", "No tolerance"),
        (9.4, "No tolerance: link 2", "CAD"),
    ):
        d = replace(torques.diagnosis, links=links(0.0, mass), shares_percent=percent)
        result = replace(torques, diagnosis=d)
        result.__dict__["forward"] = "not here"
        text = f"{result.headline} {result.details()['about_links']}"
        assert says in text
        assert not_said not in text
        shares = "the named causes 60 %, errors of links 30 %, the set-up 0 %; 10 % is left"
        assert shares in text
        assert "The named causes and errors of links explain" in text


def test_everything_of_the_first_screen_comes_before_the_sections(
    tmp_path: Path, torques: LogDiagnosis
) -> None:
    (cause,) = torques.causes
    cause = replace(cause, nats=50.0, rivals=COULOMB.rivals, confused_with=("viscous_friction",))
    body = NotShown(name="payload", joints=(), parameters={"mass_kg": (-6.0, 6.0)})
    d = replace(torques.diagnosis, causes=(cause,), not_shown=(body,))
    replace(torques, diagnosis=d).write(tmp_path)
    text = (tmp_path / "report.md").read_text("utf-8")
    first, section = text.split("## 1. coulomb_friction, joints 1 and 2")
    for words in ("**Explained.**", "plots/summary.png", "| 50 |", "payload, whole arm: `mass_kg`"):
        assert words in first
    assert "[nats]: **viscous_friction** (1.2), link_inertia (33)." in section
    assert "from viscous_friction: constant speed" in section
    assert {p.name for p in (tmp_path / "plots").iterdir()} == {
        *("summary.png", "cause_coulomb_friction.png", "joint_1.png", "joint_2.png")
    }


@pytest.mark.parametrize(
    ("verdict", "says"),
    [
        ("no discrepancy", "agrees with the logs; no cause is significant. The rigid"),
        ("cannot tell", "they cannot tell what it gets wrong. The rigid model is off by 0.49"),
        ("explained", "Errors of links and set-up explain what it gets wrong. The extended model"),
    ],
)
def test_the_verdict_without_causes(torques: LogDiagnosis, verdict: str, says: str) -> None:
    found = replace(torques.diagnosis, causes=(), verdict=verdict)
    assert says in replace(torques, diagnosis=found).summary
