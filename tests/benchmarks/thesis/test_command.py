"""``python -m benchmarks.thesis``: items, their page, and what is refused."""

import json
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from benchmarks.thesis import catalogue, command, studies
from benchmarks.thesis.catalogue import ITEMS, chosen
from benchmarks.thesis.lsm import FrictionCurve
from benchmarks.thesis.nested_models import figures, models
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.measured.thesis_tables import THESIS_TABLES, thesis_table
from tests.benchmarks.thesis import made_up
from tests.command_line import ROOT, Ran, csv_rows

PAGES = {"index.html", "report.md", "provenance.json"}
FIGURES = [
    *("2.3", *(f"4.{k}" for k in range(1, 9)), "A.1", "E.1", "F.1", "F.2"),
    *(f"{appendix}.{joint}" for appendix in "BCD" for joint in range(1, 8)),
]


def below(folder: Path) -> dict[str, bytes]:
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()
    }


@pytest.fixture
def thesis(cli) -> Callable[..., Ran]:
    """Run `python -m benchmarks.thesis` in the working folder."""
    return partial(cli, "reproduce", commands=[command])


@pytest.fixture
def simulated(monkeypatch) -> None:
    """Pretend to simulate: torques, paths, and a friction curve a tenth over its law."""

    def curve(robot: str, *, threads: int = 0) -> FrictionCurve:
        two, speed = np.ones(2), np.array([-0.1, -0.001, 0.001, 0.1])
        levels = {"stiction": 0.7 * two, "coulomb": 0.6 * two}
        levels |= {"stribeck": 0.003 * two, "viscous": 0.1 * two}
        found = FrictionCurve(robot=robot, **levels, speed=speed, torque=np.zeros(4))
        found.torque[:] = 1.1 * found.law(speed)
        return found

    monkeypatch.setattr(studies, "friction_curve", curve)
    monkeypatch.setattr(SingleJointExperiment, "run", made_up.run_torques)
    monkeypatch.setattr(GeneratedTrajectoryExperiment, "run", made_up.run_paths)


# ---- items ---------------------------------------------------------------------------------------


def test_every_printed_table_and_figure_is_an_item_once():
    ids = {kind: sorted(x.id for x in ITEMS if x.kind == kind) for kind in ("table", "figure")}
    assert ids == {"table": sorted(THESIS_TABLES), "figure": sorted(FIGURES)}


def test_an_id_names_both_kinds_in_the_order_of_the_thesis():
    keys = [item.key for item in chosen(["F.1", "4.6", "figure-4.6"])]
    assert keys == ["table-4.6", "figure-4.6", "figure-F.1"]


# ---- what is written -----------------------------------------------------------------------------


def test_a_figure_and_a_table_write_exactly_their_files_and_a_page(thesis, work, simulated):
    ran = thesis("--only", "2.3", "table-4.5", "--json", "--out", "a")
    assert ran.code == 0
    assert set(below(work / "a")) == {*PAGES, "figures/figure_2_3.png", "tables/table_4_5.csv"}
    curve, table = json.loads(ran.out)["items"].values()
    assert curve["compared"] == "10.0 % off its law"
    for name in ("report.md", "index.html"):
        text = (work / "a" / name).read_text("utf-8")
        assert curve["compared"] in text
        assert table["compared"] in text
        assert "Left out" not in text
    links = re.findall(r'(?:src|href)="([^"]{0,80})', text)
    assert len(links) == 5
    for link in links:
        if link.startswith("#"):
            assert f'id="{link[1:]}"' in text
        elif not link.startswith("data:image/png;base64,"):
            assert (work / "a" / link).is_file()
    rows = csv_rows(work / "a" / "tables" / "table_4_5.csv")
    assert [r["tau_sje_Nm"] for r in rows] == [repr(r["tau_sje_Nm"]) for r in thesis_table("4.5")]
    for row in rows:
        gap = float(row["simulated_change_pct"]) - float(row["change_pct"])
        assert float(row["difference_points"]) == pytest.approx(gap)


def test_numbers_of_future_work_are_in_their_sources():
    text = Path(catalogue.__file__).with_name("report.md.j2").read_text("utf-8")
    found = re.findall(r"\*\*([^*]+)\*\* \(`([^`]+)`\)", text)
    assert len(found) == 15
    for value, source in found:
        assert value in (ROOT / source).read_text("utf-8"), (value, source)


@pytest.mark.slow
def test_the_whole_thesis(thesis, work, simulated):
    ran = thesis("--iterations", 2, "--json")
    assert ran.code == 0
    found = below(work / "runs" / "reproduce-thesis")
    assert {item.file for item in ITEMS} <= set(found)
    assert list(json.loads(ran.out)["items"]) == [item.key for item in ITEMS]
    text = found["index.html"].decode()
    assert all(f">{item.name}</h3>" in text for item in ITEMS)
    assert "Left out" in text
    assert "http" not in " ".join(re.findall(r'(?:src|href)="([^"]{0,80})', text))


@pytest.mark.slow
def test_a_few_items_for_real_are_the_same_on_any_number_of_threads(thesis, work):
    argv = ("--only", "2.3", "table-4.5", "B.1", "figure-4.7", "--iterations", 1, "--no-scatter")
    assert thesis(*argv, "--out", "a", "--threads", 1).code == 0
    assert thesis(*argv, "--out", "b", "--threads", 2).code == 0
    one, other = below(work / "a"), below(work / "b")
    assert [name for name in one if one[name] != other[name]] == []


# ---- nested models -------------------------------------------------------------------------------


def test_gap_goes_on_where_it_was_interrupted(thesis, work, monkeypatch):
    kept = models.NestedModels(Path(models.__file__).parent).models
    fitted: list[str] = []

    def fit(self, about, tell, **_):
        if len(fitted) == 4:
            fitted.append("interrupted")
            raise KeyboardInterrupt
        fitted.append(about[0])
        return kept[about[0]]

    monkeypatch.setattr(models.NestedModels, "_fit", fit)
    monkeypatch.setattr(
        models.NestedModels,
        "_fit_arm",
        lambda self, tell: [self._save(kept[k]) for k in ("arm", "arm + drift")],
    )
    for name in ("models", "joint"):
        monkeypatch.setattr(figures, name, lambda *a: a[-1].write_bytes(b"\x89PNG"))
    first = thesis("gap", "--out", "a")
    assert first.code == 1
    assert "run the same command again" in first.err
    ran = thesis("gap", "--out", "a", "--threads", 1)
    assert ran.code == 0
    done = [x for x in fitted if x != "interrupted"]
    assert done == [k for k in kept if kept[k].found and not k.startswith("arm")]
    pictures = {"ladder.png", "iiwa.png", *(f"joint_{j}.png" for j in range(1, 8))}
    files = {*pictures, "gap.md", "report.html", "ladder.jsonl", "provenance.json"}
    assert {p.name for p in (work / "a").iterdir()} == files
    assert "stiction as a band" in ran.out
    # other seeds are another run
    assert thesis("gap", "--out", "a", "--seed", 1).code == 2


# ---- input ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        (["--only", "4.12"], "unknown table or figure '4.12': expected one of 2.3, 4.1"),
        (["gap", "--only", "2.3"], "--only 2.3: expected without a target (gap)"),
        (["dance"], "'dance'"),
    ],
)
def test_bad_input(thesis, work, argv, says):
    ran = thesis(*argv)
    assert ran.code == 2
    assert len(ran.lines) == 1
    assert says in ran.lines[0]
    assert ran.out == ""
    assert list(work.iterdir()) == []
