"""``stiction reproduce`` without a target: items, pages, folders, resuming."""

import csv
import json
import re
import tomllib
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.cli.progress import Progress
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.parameters import friction_text
from stiction_envs.gap.tables.cells import FITTED
from stiction_envs.measured import thesis_table
from stiction_envs.thesis import ensemble
from stiction_envs.thesis.catalogue import ITEMS
from stiction_envs.thesis.friction_curve import FrictionCurve
from stiction_envs.thesis.items import TEMPLATES
from stiction_envs.thesis.whole_page import wishes
from tests.cli.test_reproduce import pretend
from tests.thesis.made_up_ensemble import made_up
from tests.thesis.test_gte import as_printed
from tuning import studies

PAGES = {"index.html", "report.md", "provenance.json"}
ROOT = Path(__file__).parents[2]


def below(folder: Path) -> dict[str, bytes]:
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()
    }


@pytest.fixture
def curve(monkeypatch) -> None:
    """Pretend to simulate the friction curve: a tenth over the law."""

    def made_up(robot: str, *, nthread: int = 0) -> FrictionCurve:
        two, speed = np.ones(2), np.array([-0.1, -0.001, 0.001, 0.1])
        found = FrictionCurve(
            robot=robot,
            joint=1,
            stiction=0.7 * two,
            coulomb=0.6 * two,
            stribeck=0.003 * two,
            viscous=0.1 * two,
            speed=speed,
            torque=np.zeros(4),
        )
        found.torque[:] = 1.1 * found.law(speed)
        return found

    monkeypatch.setattr(studies, "friction_curve", made_up)


@pytest.fixture
def simulated(monkeypatch) -> list[object]:
    """Pretend to simulate torques and paths; return what was asked for."""
    asked: list[object] = []

    def run(self, jobs, *, iterations=None, progress=None, simulations=0):
        for job in jobs:
            asked.append(job)
            if progress is not None:
                progress(1.0)
            yield pretend(job, self.sticking.arm.name, iterations or 1)

    def follow(self, cases, *, iterations=None, progress=None):
        asked.extend(cases)
        return as_printed(self, cases, iterations=iterations)

    monkeypatch.setattr(ensemble, "run_set_up", made_up)
    monkeypatch.setattr(studies, "shipped_lag", lambda *_, **__: {"diagonal": 0.5, "mass": 0.8})
    monkeypatch.setattr(SingleJointExperiment, "run", run)
    monkeypatch.setattr(GeneratedTrajectoryExperiment, "run", follow)
    return asked


# ---- what is written -----------------------------------------------------------------------------


def test_a_cheap_item_writes_exactly_its_files(cli, work, curve):
    ran = cli("reproduce", "--only", "2.3", "--json")
    assert ran.code == 0
    out = work / "runs" / "reproduce-2_3"
    assert set(below(out)) == {*PAGES, "figures/figure_2_3.png"}
    found = json.loads(ran.out)
    assert list(found["items"]) == ["figure-2.3"]
    assert found["items"]["figure-2.3"]["file"] == "figures/figure_2_3.png"
    sentence = found["items"]["figure-2.3"]["sentence"]
    assert "up to 10.0 % off its law" in sentence
    for page in ("report.md", "index.html"):
        text = (out / page).read_text("utf-8")
        assert sentence in text
        assert "Table 4" not in text.split("Future work, and")[0]
    shown = cli("reproduce", "--only", "figure-2.3", "--out", "runs/reproduce-2_3").out
    assert shown.startswith("figure 2.3   10.0 % off its law")
    assert shown.rstrip().endswith("open index.html")


def test_tables_have_the_thesis_columns_first_and_a_difference(cli, work, simulated):
    assert cli("reproduce", "--only", "table-4.5", "table-4.10", "--out", "a").code == 0
    assert set(below(work / "a")) == {
        *PAGES,
        "tables/table_4_5.csv",
        "tables/table_4_10.csv",
        "studies/iiwa7.jsonl",
        "studies/panda.jsonl",
    }
    for number in ("4.5", "4.10"):
        path = work / "a" / "tables" / f"table_{number.replace('.', '_')}.csv"
        with open(path, encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        printed = thesis_table(number)
        assert [r["tau_sje_Nm"] for r in rows] == [repr(r["tau_sje_Nm"]) for r in printed]
        assert {"simulated_tau_Nm", "difference_points"} <= set(rows[0])
        for row in rows:
            gap = float(row["simulated_change_pct"]) - float(row["change_pct"])
            assert float(row["difference_points"]) == pytest.approx(gap)


def test_the_page_needs_nothing_else(cli, work, curve, simulated):
    assert cli("reproduce", "--only", "2.3", "table-4.5", "--out", "a").code == 0
    page = (work / "a" / "index.html").read_text("utf-8")
    links = re.findall(r'(?:src|href)="([^"]{0,80})', page)
    assert len(links) == 5
    for link in links:
        if link.startswith("#"):
            assert f'id="{link[1:]}"' in page
        elif not link.startswith("data:image/png;base64,"):
            assert (work / "a" / link).is_file()
    assert "http" not in " ".join(links)
    assert "<script" not in page
    assert 'name="viewport"' in page
    report = (work / "a" / "report.md").read_text("utf-8")
    for picture in re.findall(r"!\[.*?\]\((.*?)\)", report):
        assert (work / "a" / picture).is_file()


def test_future_work_is_on_every_page(cli, work, curve):
    assert cli("reproduce", "--only", "2.3", "--out", "a").code == 0
    page = (work / "a" / "index.html").read_text("utf-8")
    assert '<a id="future"></a>' in page
    for wish in wishes():
        assert wish["wish"] in page
        for number in wish["numbers"]:
            assert number["value"] in page


def test_numbers_of_future_work_stand_in_their_sources():
    assert len(wishes()) == 6
    for wish in wishes():
        for number in wish["numbers"]:
            text = (ROOT / number["source"]).read_text("utf-8")
            assert number["value"] in text, number
    assert tomllib.loads((TEMPLATES / "future.toml").read_text("utf-8")).keys() == {"wishes"}


def test_what_is_called_fitted_is_what_the_friction_was_fitted_to():
    assert friction_text("panda")["provenance"]["fit"].endswith(f"Tables 4.3 and {FITTED[0]} only")
    assert len(FITTED) == 1


# ---- going on ------------------------------------------------------------------------------------


ONLY = ("reproduce", "--only", "table-4.5", "table-4.11", "--iterations", 2)


def test_interrupted_and_resumed_gives_the_same_bits(cli, work, simulated, monkeypatch):
    assert cli(*ONLY, "--out", "whole").code == 0
    wanted = len(simulated)
    run, follow = SingleJointExperiment.run, GeneratedTrajectoryExperiment.run

    def broken(self, jobs, **options):
        for k, m in enumerate(run(self, jobs, **options)):
            if k == 5:
                raise KeyboardInterrupt
            yield m

    def late(self, cases, **options):
        if len(list((work / "a" / "studies").glob("*.npz"))) == 3:
            raise KeyboardInterrupt
        return follow(self, cases, **options)

    simulated.clear()
    monkeypatch.setattr(SingleJointExperiment, "run", broken)
    monkeypatch.setattr(GeneratedTrajectoryExperiment, "run", late)
    first = cli(*ONLY, "--out", "a")
    assert first.code == 1
    assert first.lines[-1].endswith("what was done is kept; run the same command again to go on")
    monkeypatch.setattr(SingleJointExperiment, "run", run)
    assert cli(*ONLY, "--out", "a").code == 1
    monkeypatch.setattr(GeneratedTrajectoryExperiment, "run", follow)
    assert cli(*ONLY, "--out", "a", "--threads", 1).code == 0
    # one torque was under way when the first was broken off
    assert len(simulated) == wanted + 1
    one, other = below(work / "whole"), below(work / "a")
    assert one.keys() == other.keys()
    assert [name for name in one if one[name] != other[name]] == []
    # finished, and asked for again in other words: nothing is simulated
    again = ("reproduce", "--only", "table-4.11", "table-4.5", "--iterations", 2)
    assert cli(*again, "--out", "a").code == 0
    assert len(simulated) == wanted + 1
    assert cli(*ONLY, "--out", "a", "--seed", 1).code == 2


def test_the_bar_counts_the_whole(cli, work, curve, simulated):
    ran = cli("reproduce", "--only", "2.3", "table-4.5", "--out", "a")
    shares = [int(x) for x in re.findall(r"^ *(\d+) %", ran.err, re.M)]
    assert shares == sorted(shares)
    assert shares[0] == 0
    assert 0 < shares[-1] <= 100
    for stage in ("friction curve", "single joints", "drawing"):
        assert stage in ran.err


def test_the_bar_counts_what_was_done_before(cli, work, simulated, monkeypatch):
    assert cli(*ONLY, "--out", "a").code == 0
    told: list[tuple[str, float]] = []
    monkeypatch.setattr(Progress, "whole", lambda self, stage, share: told.append((stage, share)))
    assert cli(*ONLY, "--out", "a").code == 0
    ends = {stage: share for stage, share in told}
    starts = {stage: share for stage, share in reversed(told)}
    stages = ("single joints", "paths", "set-ups of the paths", "drawing")
    for one, following in pairwise(stages):
        assert ends[one] == pytest.approx(starts[following])
    assert ends["drawing"] == 1.0


# ---- input ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        (["--only", "4.12"], "unknown table or figure '4.12': expected one of tables 4.1 to 4.11"),
        (["--only", "2.3", "G.1"], "'G.1'"),
        (["--only"], "--only"),
        (["gap", "--only", "2.3"], "--only 2.3: expected without a target (gap, tables, gte)"),
        (["--only", "2.3", "--out", "{file}"], "is a file"),
        (["--iterations", 0], "whole numbers from 1"),
    ],
)
def test_bad_input(cli, work, inputs, argv, says):
    (inputs / "file").write_text("mine")
    ran = cli("reproduce", *(str(a).replace("{file}", str(inputs / "file")) for a in argv))
    assert ran.code == 2
    assert len(ran.lines) == 1
    assert says in ran.lines[0]
    assert ran.out == ""
    assert list(work.iterdir()) == []


def test_output_folder_of_another_run(cli, work, curve):
    (work / "out").mkdir()
    (work / "out" / "notes.txt").write_text("mine")
    ran = cli("reproduce", "--only", "2.3", "--out", "out")
    assert ran.code == 2
    assert "--force" in ran.lines[0]
    assert [p.name for p in (work / "out").iterdir()] == ["notes.txt"]
    assert cli("reproduce", "--only", "2.3", "--out", "out", "--force").code == 0
    assert (work / "out" / "notes.txt").exists()


# ---- all of it -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_whole_thesis(cli, work, simulated):
    ran = cli("reproduce", "--iterations", 2, "--json")
    assert ran.code == 0
    out = work / "runs" / "reproduce-thesis"
    found = below(out)
    assert {item.file for item in ITEMS} <= set(found)
    assert set(found) >= PAGES
    assert list(json.loads(ran.out)["items"]) == [item.key for item in ITEMS]
    page = found["index.html"].decode()
    for item in ITEMS:
        assert f">{item.name}</h3>" in page
    assert "Left out" in page
    assert "http" not in " ".join(re.findall(r'(?:src|href)="([^"]{0,80})', page))


@pytest.mark.slow
def test_a_few_items_for_real(cli, work):
    argv = ("reproduce", "--only", "2.3", "table-4.5", "B.1", "--iterations", 1, "--no-scatter")
    assert cli(*argv, "--out", "a", "--threads", 1).code == 0
    assert cli(*argv, "--out", "b", "--threads", 2).code == 0
    one, other = below(work / "a"), below(work / "b")
    assert [name for name in one if one[name] != other[name]] == []
