"""Every printed table and every figure with data is an item, and asks for no more than it needs."""

import re

import pytest

from benchmarks.thesis.catalogue import CHAPTERS, ITEMS, LEFT_OUT, chosen
from benchmarks.thesis.items import needs_of
from benchmarks.thesis.studies import STUDIES
from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.protocol import Job
from stiction_envs.measured.thesis_tables import THESIS_TABLES

TABLES = [*(f"4.{k}" for k in range(1, 12)), "A.1"]
FIGURES = [
    *("2.3", *(f"4.{k}" for k in range(1, 9)), "A.1", "E.1", "F.1", "F.2"),
    *(f"{appendix}.{joint}" for appendix in "BCD" for joint in range(1, 8)),
]
NO_DATA = ["1.1", "2.1", "2.2", *(f"3.{k}" for k in range(1, 6))]


def ids(kind: str) -> list[str]:
    return [item.id for item in ITEMS if item.kind == kind]


def test_every_printed_table_and_figure_is_an_item_once():
    assert sorted(ids("table")) == sorted(TABLES) == sorted(THESIS_TABLES)
    assert sorted(ids("figure")) == sorted(FIGURES)
    assert sorted(re.findall(r"\d\.\d", " ".join(LEFT_OUT))) == NO_DATA


def test_items_differ_and_belong_somewhere():
    assert len({item.file for item in ITEMS}) == len({item.key for item in ITEMS}) == len(ITEMS)
    assert all(item.id.split(".")[0] in CHAPTERS for item in ITEMS)
    assert set(needs_of(ITEMS)) == set(STUDIES)


def test_an_id_names_both_kinds():
    assert [item.key for item in chosen(["F.1", "4.6"])] == [
        "table-4.6",
        "figure-4.6",
        "figure-F.1",
    ]
    assert [item.key for item in chosen(["figure-4.6", "figure-4.6"])] == ["figure-4.6"]
    assert chosen([]) == ITEMS


@pytest.mark.parametrize("name", ["4.12", "6", "figure-4.9", "table 4.6", "f.1", ""])
def test_an_unknown_id_is_refused_with_what_is_expected(name):
    with pytest.raises(StictionError) as error:
        chosen(["4.6", name])
    assert repr(name) in str(error.value)
    assert "tables 4.1 to 4.11, A.1; figures 2.3, 4.1 to 4.8, A.1, B.1 to B.7" in str(error.value)


def test_items_need_only_what_they_show():
    assert needs_of(chosen(["2.3"])) == {"curve": ["panda"]}
    (ramps,) = needs_of(chosen(["C.3"])).values()
    assert len(ramps) == 4
    assert {(robot, job.configuration.joint) for robot, job in ramps} == {("panda", 3)}
    (dithered,) = needs_of(chosen(["D.3"])).values()
    assert len(dithered) == 8  # the change is against the base torque
    assert {t for t, _ in needs_of(chosen(["F.1"]))["gte"]} == {"triangle"}
    assert {robot for robot, _ in needs_of(chosen(["table-4.5"]))["sje"]} == {"iiwa7"}
    assert {robot for robot, _ in needs_of(chosen(["table-4.1"]))["lsm"]} == {"iiwa7"}


def test_what_items_share_is_asked_for_once():
    alone = needs_of(chosen(["C.3"]))["sje"]
    together = needs_of(chosen(["4.3", "C.3"]))["sje"]
    assert len(together) == 56
    assert set(alone) < set(together)
    everything = needs_of(ITEMS)
    assert all(len(parts) == len(set(parts)) for parts in everything.values())
    assert sum(isinstance(job, Job) for _, job in everything["sje"]) == len(everything["sje"])
