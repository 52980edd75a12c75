"""A table cause of somebody else's: one class and one call, and it works everywhere."""

import re

import pytest

from stiction_envs.gap.causes import register, unregister
from stiction_envs.gap.report.results import TableResult
from stiction_envs.gap.tables.causes import SimulatedCause, registered
from stiction_envs.gap.tables.data import SimulatedQuantity, WholeArm
from stiction_envs.gap.tables.table_diagnosis import diagnose_tables
from stiction_envs.measured.logs.sources import LogSources
from stiction_envs.robots import load_arm
from tests.gap.tables.hidden_tables import Truth, nominal, protocol, tables


class HeavierGear(SimulatedCause):
    """The same as a rotor's inertia, under a name of its own."""

    name, absolute = "heavier_gear", "gear_kgm2"
    quantity = SimulatedQuantity(fields=("rotor_inertia",), low=0.5, high=4.0)
    tell_apart = {"rotor_inertia": "the gear on a balance"}  # noqa: RUF012


@pytest.fixture
def outside():
    cause = register(HeavierGear())
    yield cause
    unregister(cause.name)


@pytest.mark.slow
def test_a_registered_cause_is_found_reported_and_put_into_the_model(outside, tmp_path):
    arm, truth = load_arm("panda"), Truth(joint=7, rotor_inertia=2.0)
    whole = WholeArm(arm, nominal(), protocol=protocol())
    assert outside in registered()
    d = diagnose_tables(tables([7], truth, seed=1), whole, causes=[outside])
    (found,) = d.causes
    assert (found.name, found.joints) == ("heavier_gear", (7,))
    assert found.parameters[7]["factor"].value == pytest.approx(2.0, abs=0.1)
    assert "times the rotor inertia" in found.evidence
    result = TableResult(
        diagnosis=d,
        arm=arm,
        friction=nominal(),
        nominal_name="shipped",
        sources=LogSources({}, {}, {}),
        provenance={"git_commit": "", "versions": {}, "inputs": {}},
    )
    rotor = found.parameters[7]["gear_kgm2"].value
    assert result.extension.friction.rotor_inertia[6] == pytest.approx(rotor)
    result.write(tmp_path)
    report = (tmp_path / "report.md").read_text("utf-8")
    assert "heavier_gear, joint 7" in report
    assert re.search(r"`gear_kgm2` \| .*\] kg·m² \|", report)
    assert (tmp_path / "plots" / "summary.png").is_file()
