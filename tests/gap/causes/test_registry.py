"""Causes by name: what is registered is known, what is not is refused in one line."""

import pytest

from stiction_envs.errors import StictionError
from stiction_envs.gap import causes
from stiction_envs.gap.causes import CAUSES, Cause, cause_named, register, registered, unregister
from stiction_envs.gap.causes.log.torque_offset import TorqueOffset
from stiction_envs.gap.causes.registry import IN_LOGS, IN_SERVO, IN_TABLES
from stiction_envs.gap.diagnosis import diagnose_logs
from stiction_envs.gap.servo.causes import TorqueLimit
from stiction_envs.gap.tables import causes as table_causes
from tests.gap.small_logs import hidden, panda
from tests.refusal import refusal


class Other(TorqueOffset):
    """The same under another name."""

    name = "other_offset"


def test_a_registered_cause_is_known_until_it_is_removed() -> None:
    other = register(Other())
    try:
        assert cause_named("other_offset") is other
        assert registered() == (*CAUSES, other)
    finally:
        unregister("other_offset")
    assert registered() == CAUSES
    with pytest.raises(StictionError, match=r"unknown cause 'other_offset': expected one of coul"):
        cause_named("other_offset")


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("name", CAUSES[0].name, "not taken"),
        ("name", "Other offset", "small letters"),
        ("name", "", "no name"),
        ("what_to_record", "", "no what_to_record"),
        ("parameters", (), "no parameters"),
    ],
)
def test_an_incomplete_cause_is_not_registered(field: str, value: object, says: str) -> None:
    broken = type("Broken", (Other,), {field: value})
    refusal(lambda: register(broken()), says)
    assert registered() == CAUSES


def test_a_cause_that_no_data_show_is_not_registered() -> None:
    unseen = type("Unseen", (Cause,), {"name": "unseen"})
    refusal(lambda: register(unseen()), "cause Unseen: expected columns, in_tables or servo")


def test_a_cause_of_logs_and_of_tables_is_one() -> None:
    both = {c.name for c in CAUSES} & {c.name for c in table_causes.registered()}
    assert both == {"torque_offset", "direction_asymmetry"}
    for name in both:
        assert table_causes.cause_named(name) is cause_named(name)
    for kind, name in ((causes, "low_pass"), (table_causes, "payload")):
        refusal(lambda kind=kind, name=name: kind.cause_named(name), f"unknown cause '{name}'")


@pytest.mark.parametrize("member", [IN_LOGS, IN_TABLES, IN_SERVO])
def test_each_kind_of_data_has_causes_of_its_own(member: str) -> None:
    of_kind = registered(member)
    refusal(lambda: register(of_kind[0]), "expected a name that is not taken")
    refusal(lambda: unregister("friction"), r"unknown cause 'friction': expected one of \w+")
    names = {c.name for c in of_kind}
    own = {IN_LOGS: "viscous_friction", IN_TABLES: "low_pass", IN_SERVO: TorqueLimit.name}
    assert names & {*own.values()} == {own[member]}
    assert ("coulomb_friction" in names) == (member != IN_TABLES)


def test_a_cause_that_is_not_registered_is_refused_at_once() -> None:
    with pytest.raises(StictionError, match="unknown cause 'other_offset'"):
        diagnose_logs([hidden(panda(), seconds=5.0)], "panda", causes=[*CAUSES, Other()])
