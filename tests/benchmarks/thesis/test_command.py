"""``python -m benchmarks.thesis``: items, pages, folders, going on."""

import csv
import json
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from benchmarks.thesis import studies
from benchmarks.thesis.catalogue import ITEMS, wishes
from benchmarks.thesis.command import inputs_of
from benchmarks.thesis.lsm import FrictionCurve
from benchmarks.thesis.nested_models import figures, models, page, phase
from benchmarks.thesis.nested_models.cells import FITTED
from stiction_envs.cli.progress import Progress
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.parameters import friction_text
from stiction_envs.measured import thesis_table
from tests.benchmarks.thesis import made_up

PAGES = {"index.html", "report.md", "provenance.json"}
ROOT = Path(__file__).parents[3]


def below(folder: Path) -> dict[str, bytes]:
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()
    }


@pytest.fixture
def curve(monkeypatch) -> None:
    """Pretend to simulate the friction curve: a tenth over the law."""

    def simulate(robot: str, *, threads: int = 0) -> FrictionCurve:
        two, speed = np.ones(2), np.array([-0.1, -0.001, 0.001, 0.1])
        found = FrictionCurve(
            robot=robot,
            stiction=0.7 * two,
            coulomb=0.6 * two,
            stribeck=0.003 * two,
            viscous=0.1 * two,
            speed=speed,
            torque=np.zeros(4),
        )
        found.torque[:] = 1.1 * found.law(speed)
        return found

    monkeypatch.setattr(studies, "friction_curve", simulate)


@pytest.fixture
def simulated(monkeypatch) -> list[object]:
    """Pretend to simulate torques and paths; return what was asked for."""
    asked: list[object] = []

    def run(self, jobs, **options):
        for m in made_up.run_torques(self, jobs, **options):
            asked.append(m.job)
            yield m

    def follow(self, cases, **options):
        asked.extend(cases)
        return made_up.run_paths(self, cases, **options)

    monkeypatch.setattr(SingleJointExperiment, "run", run)
    monkeypatch.setattr(GeneratedTrajectoryExperiment, "run", follow)
    return asked


# ---- what is written -----------------------------------------------------------------------------


def test_a_cheap_item_writes_exactly_its_files(thesis, work, curve):
    ran = thesis("--only", "2.3", "--json")
    assert ran.code == 0
    out = work / "runs" / "reproduce-2_3"
    assert set(below(out)) == {*PAGES, "figures/figure_2_3.png"}
    (found,) = json.loads(ran.out)["items"].values()
    assert found["file"] == "figures/figure_2_3.png"
    assert "up to 10.0 % off its law" in found["sentence"]
    for name in ("report.md", "index.html"):
        text = (out / name).read_text("utf-8")
        assert found["sentence"] in text
        assert "Table 4" not in text.split("Future work</h2>")[0].split("## Future")[0]
    shown = thesis("--only", "figure-2.3", "--out", "runs/reproduce-2_3").out
    assert shown.startswith("figure 2.3   10.0 % off its law")
    assert shown.rstrip().endswith("open index.html")


def test_tables_have_the_thesis_columns_first_and_a_difference(thesis, work, simulated):
    assert thesis("--only", "table-4.5", "table-4.10", "--out", "a").code == 0
    assert set(below(work / "a")) == {
        *PAGES,
        *("tables/table_4_5.csv", "tables/table_4_10.csv"),
        *("studies/iiwa7.jsonl", "studies/panda.jsonl"),
    }
    for number in ("4.5", "4.10"):
        path = work / "a" / "tables" / f"table_{number.replace('.', '_')}.csv"
        with open(path, encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        printed = thesis_table(number)
        assert [r["tau_sje_Nm"] for r in rows] == [repr(r["tau_sje_Nm"]) for r in printed]
        for row in rows:
            gap = float(row["simulated_change_pct"]) - float(row["change_pct"])
            assert float(row["difference_points"]) == pytest.approx(gap)


def test_the_page_needs_nothing_else(thesis, work, curve, simulated):
    assert thesis("--only", "2.3", "table-4.5", "--out", "a").code == 0
    text = (work / "a" / "index.html").read_text("utf-8")
    links = re.findall(r'(?:src|href)="([^"]{0,80})', text)
    assert len(links) == 5
    for link in links:
        if link.startswith("#"):
            assert f'id="{link[1:]}"' in text
        elif not link.startswith("data:image/png;base64,"):
            assert (work / "a" / link).is_file()
    assert "http" not in " ".join(links)
    assert "<script" not in text
    for wish in wishes():
        assert wish["wish"] in text
        for number in wish["numbers"]:
            assert number["value"] in text


def test_numbers_of_future_work_are_in_their_sources():
    assert len(wishes()) == 6
    for wish in wishes():
        for number in wish["numbers"]:
            assert number["value"] in (ROOT / number["source"]).read_text("utf-8"), number


def test_what_is_called_fitted_is_what_the_friction_was_fitted_to():
    assert friction_text("panda")["provenance"]["fit"].endswith(f"Tables 4.3 and {FITTED[0]} only")
    assert len(FITTED) == 1


def test_inputs_are_there():
    assert all(path.is_file() for path in inputs_of().values())


# ---- going on ------------------------------------------------------------------------------------


ONLY = ("--only", "table-4.5", "table-4.11", "--iterations", 2)


def test_interrupted_and_resumed_gives_the_same_bits(thesis, work, simulated, monkeypatch):
    assert thesis(*ONLY, "--out", "whole").code == 0
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
    first = thesis(*ONLY, "--out", "a")
    assert first.code == 1
    assert first.lines[-1].endswith("what was done is kept; run the same command again to go on")
    monkeypatch.setattr(SingleJointExperiment, "run", run)
    assert thesis(*ONLY, "--out", "a").code == 1
    monkeypatch.setattr(GeneratedTrajectoryExperiment, "run", follow)
    assert thesis(*ONLY, "--out", "a", "--threads", 1).code == 0
    # one torque was under way when the first was broken off
    assert len(simulated) == wanted + 1
    assert below(work / "whole") == below(work / "a")
    # finished, and asked for again in other words: nothing is simulated
    again = ("--only", "table-4.11", "table-4.5", "--iterations", 2)
    assert thesis(*again, "--out", "a").code == 0
    assert len(simulated) == wanted + 1
    assert thesis(*ONLY, "--out", "a", "--seed", 1).code == 2


def test_the_bar_counts_the_whole(thesis, work, curve, simulated):
    ran = thesis("--only", "2.3", "table-4.5", "--out", "a")
    shares = [int(x) for x in re.findall(r"^ *(\d+) %", ran.err, re.M)]
    assert shares == sorted(shares)
    assert shares[0] == 0
    assert 0 < shares[-1] <= 100
    for stage in ("friction curve", "single joints", "drawing"):
        assert stage in ran.err


def test_the_bar_counts_what_was_done_before(thesis, work, simulated, monkeypatch):
    assert thesis(*ONLY, "--out", "a").code == 0
    told: list[tuple[str, float]] = []
    monkeypatch.setattr(Progress, "whole", lambda self, stage, share: told.append((stage, share)))
    assert thesis(*ONLY, "--out", "a").code == 0
    ends, starts = dict(told), dict(reversed(told))
    for one, following in pairwise(("single joints", "paths", "drawing")):
        assert ends[one] == pytest.approx(starts[following])
    assert ends["drawing"] == 1.0


# ---- nested models -------------------------------------------------------------------------------


@pytest.fixture
def fitted(monkeypatch) -> list[str]:
    """Pretend to fit: models are the kept ones; return those that were saved anew."""
    saved: list[str] = []
    found = models.NestedModels(Path(models.__file__).parent).models

    def fit(self, progress=None):
        for key, model in found.items():
            if key not in self.models:
                progress(model.name, 1, 1)
                self._save(model)
                saved.append(key)
            yield model

    monkeypatch.setattr(models.NestedModels, "fit", fit)
    monkeypatch.setattr(phase, "study_phase", lambda **_: made_up.phase_study())
    for name in ("models", "joint", "iiwa"):
        monkeypatch.setattr(figures, name, lambda *a: a[-1].write_bytes(b"\x89PNG"))
    return saved


def test_gap(thesis, work, fitted):
    ran = thesis("gap", "--seeds", 2, "--out", "a")
    assert ran.code == 0
    files = {*page.PICTURES, "gap.md", "report.html", "ladder.json", "provenance.json"}
    assert {p.name for p in (work / "a").iterdir()} == files
    assert "stiction as a band" in ran.out
    assert "target mean: " in ran.out
    assert ran.out.rstrip().endswith("written to a")
    found = json.loads((work / "a" / "provenance.json").read_text())
    assert found["finished"]
    assert "gap.md" in found["files"]
    assert {"dither_fit", "panda_friction", "table_4_6"} <= set(found["inputs"])


def test_interrupted_fits_go_on(thesis, work, fitted, monkeypatch):
    whole = models.NestedModels.fit

    def break_off(self, progress=None):
        for k, model in enumerate(whole(self, progress)):
            if k == 4:
                raise KeyboardInterrupt
            yield model

    monkeypatch.setattr(models.NestedModels, "fit", break_off)
    ran = thesis("gap", "--out", "a")
    assert ran.code == 1
    assert "run the same command again" in ran.err
    done = list(fitted)
    monkeypatch.setattr(models.NestedModels, "fit", whole)
    assert thesis("gap", "--out", "a", "--threads", 1).code == 0
    assert fitted == [*done, *(k for k in models.NestedModels(work / "a").models if k not in done)]
    # other seeds are another run
    assert thesis("gap", "--out", "a", "--seeds", 1).code == 2


# ---- input ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        (["--only", "4.12"], "unknown table or figure '4.12': expected one of tables 4.1 to 4.11"),
        (["--only", "2.3", "G.1"], "'G.1'"),
        (["--only"], "--only"),
        (["gap", "--only", "2.3"], "--only 2.3: expected without a target (gap)"),
        (["--only", "2.3", "--out", "{file}"], "is a file"),
        (["gap", "--out", "{file}/x"], "not a folder"),
        (["dance"], "'dance'"),
        (["--seeds", "many"], "'many'"),
        (["--iterations", 0], "whole numbers from 1"),
        (["--threads", -1], "whole numbers from 0"),
        (["gap", "--speed"], "--speed"),
    ],
)
def test_bad_input(thesis, work, tmp_path, argv, says):
    (tmp_path / "file").write_text("mine")
    ran = thesis(*(str(a).replace("{file}", str(tmp_path / "file")) for a in argv))
    assert ran.code == 2
    assert len(ran.lines) == 1
    assert says in ran.lines[0]
    assert ran.out == ""
    assert list(work.iterdir()) == []


def test_output_folder_of_another_run(thesis, work, curve):
    (work / "out").mkdir()
    (work / "out" / "notes.txt").write_text("mine")
    ran = thesis("--only", "2.3", "--out", "out")
    assert ran.code == 2
    assert "or force" in ran.lines[0]
    assert [p.name for p in (work / "out").iterdir()] == ["notes.txt"]
    assert thesis("--only", "2.3", "--out", "out", "--force").code == 0
    assert (work / "out" / "notes.txt").exists()


def test_help(thesis):
    ran = thesis("--help")
    assert ran.code == 0
    assert "example:\n  python -m benchmarks.thesis " in ran.out
    for option in ("--out", "--force", "--json", "--seed", "--seeds", "--iterations", "--only"):
        assert option in ran.out


# ---- all of it -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_whole_thesis(thesis, work, simulated):
    ran = thesis("--iterations", 2, "--json")
    assert ran.code == 0
    found = below(work / "runs" / "reproduce-thesis")
    assert {item.file for item in ITEMS} <= set(found)
    assert set(found) >= PAGES
    assert list(json.loads(ran.out)["items"]) == [item.key for item in ITEMS]
    text = found["index.html"].decode()
    for item in ITEMS:
        assert f">{item.name}</h3>" in text
    assert "Left out" in text
    assert "http" not in " ".join(re.findall(r'(?:src|href)="([^"]{0,80})', text))


@pytest.mark.slow
def test_a_few_items_for_real(thesis, work):
    argv = ("--only", "2.3", "table-4.5", "B.1", "figure-4.7", "--iterations", 1, "--no-scatter")
    assert thesis(*argv, "--out", "a", "--threads", 1).code == 0
    assert thesis(*argv, "--out", "b", "--threads", 2).code == 0
    one, other = below(work / "a"), below(work / "b")
    assert [name for name in one if one[name] != other[name]] == []
