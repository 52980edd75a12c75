"""``stiction tune`` on an arm of two joints: the protocol, the search, and with a robot."""

import json

import pytest

from tests.command_line import csv_rows
from tests.robots.arms import chain
from tests.tuning.robot.made_up import fill
from tuning import names
from tuning.protocol import tune as tuner

SEARCH = ["--protocol", "search"]
ROBOT = [*SEARCH, "--out", "out", "--threads", 1]
TUNE = ["--iterations", 1, "--no-scatter", "--frequencies", 15, "--scales", 1.0]


def finished(folder) -> tuner.Tuning:
    """Return a result of the protocol without running it."""
    summary = {"robot": "two", "final": [], "mean_reduction_percent": None}
    return tuner.Tuning(summary=summary, final=(), folder=folder.path, provenance={})


def test_a_password_of_a_storage_is_not_recorded(cli, work, two, monkeypatch):
    monkeypatch.setattr("tuning.study.tuning_run.Record", lambda *_, **__: None)
    monkeypatch.setattr(tuner, "run_protocol", lambda one, *_: finished(one.run.folder))
    storage = "postgresql://tuner:s3cret@host/x"
    assert cli("tune", two, *TUNE, "--out", "t", "--storage", storage).code == 0
    tuner.tune(work / two, out=work / "u", storage=storage)
    for name in "tu":
        found = (work / name / "provenance.json").read_text()
        assert "postgresql+psycopg://tuner:***@host/x" in found
        assert "s3cret" not in found


def test_tune_warns_of_aliases_once(cli, monkeypatch):
    monkeypatch.setattr(tuner, "run_protocol", lambda one, *_: finished(one.run.folder))
    ran = cli("tune", "iiwa7", "--frequencies", 150, "--out", "t")
    assert ran.code == 0
    (line,) = ran.lines
    assert line.startswith("warning: ")
    assert "aliases to 50 Hz" in line


@pytest.mark.slow  # ramps of an arm that nobody calibrated
@pytest.mark.usefixtures("few_settings")
def test_search_writes_what_the_contract_says_and_goes_on(cli, work):
    (work / "two.xml").write_text(chain(2))
    argv = ["tune", "two.xml", *SEARCH, "--sampler", "random", "--evaluations", 3]
    argv += ["--out", "found", "--seed", 4, "--json"]
    ran = cli(*argv)
    assert ran.code == 0
    result = json.loads(ran.out)
    assert result["command"] == "tune"
    assert [r["joint"] for r in result["final"]] == [1, 2]
    files = ("trials.csv", "final.csv", "verification.csv", "comparison.csv", "report.md")
    before = {name: (work / "found" / name).read_bytes() for name in files}
    assert len(csv_rows(work / "found" / "trials.csv")) == 6
    assert cli(*argv).code == 0  # it goes on where it was: at its end
    assert before == {name: (work / "found" / name).read_bytes() for name in files}
    for kind in ("yaml", "csv"):
        table = f"found/final.{kind}"
        assert cli("sje", "two.xml", "--dither", table, "--iterations", 1, "--out", kind).code == 0
    assert (work / "yaml/sje.csv").read_bytes() == (work / "csv/sje.csv").read_bytes()


@pytest.mark.slow
@pytest.mark.usefixtures("few_settings")
def test_several_treatments_are_handed_over(cli, work, monkeypatch):
    """From its search to a run, by ``final.csv`` and by ``final.yaml``, to the bit."""
    (work / "two.xml").write_text(chain(2))
    monkeypatch.setattr("tuning.search.stages.best", lambda trials: trials[0])
    monkeypatch.setattr("tuning.search.stages.score", lambda trial: -1.0)
    argv = ["tune", "two.xml", *SEARCH, "--treatment", "observer", "--evaluations", 1]
    ran = cli(*argv, "--out", "found", "--threads", 1)
    assert ran.code == 0, ran.err
    kinds = [p.parent.name for p in sorted((work / "found").glob("*/final.csv"))]
    assert kinds == sorted(names.TREATMENTS["observer"])
    path = ["--trajectory", "triangle", "--stiffness", 200, 20, 0, "--iterations", 1]
    for kind in kinds:
        rows = []
        for name in ("final.csv", "final.yaml"):
            out, gains = work / f"{kind}-{name}", f"found/{kind}/{name}"
            ran = cli("gte", "two.xml", *path, "--compensation", gains, "--out", out)
            assert ran.code == 0, ran.err
            rows.append((out / "runs.csv").read_bytes())
        assert rows[0] == rows[1]
        assert rows[0].count(b"\n") == 3, "a header, without it, with it"
    gains = "found/lugre_observer/final.csv"
    wrong = cli("gte", "two.xml", *path, "--dither", gains, "--out", "no")
    assert (wrong.code, len(wrong.lines)) == (2, 1)
    assert "frequency_hz" in wrong.lines[0]


@pytest.mark.slow
@pytest.mark.usefixtures("few_settings")
def test_ask_tell_ask(cli, work, two):
    ran = cli("tune", two, *ROBOT, "--ask")
    assert ran.code == 0, ran.err
    table = (work / "out" / "ask.csv").read_text()
    assert table.splitlines()[0] == "joint,frequency_hz,amplitude_nm"
    assert table.strip() in ran.out, "the table is on standard output too"
    rows = csv_rows(fill(work / "out"))
    ran = cli("tune", two, *ROBOT, "--tell", "told.csv", "--ask", 2, "--json")
    assert ran.code == 0, ran.err
    found = json.loads(ran.out)
    assert found["told"] == 4
    assert [j["measured_settings"] for j in found["joints"]] == [1, 1]
    again = {(r["joint"], r["frequency_hz"], r["amplitude_nm"]) for r in found["ask"]}
    told = {(int(r["joint"]), float(r["frequency_hz"]), float(r["amplitude_nm"])) for r in rows}
    assert not again & told
    assert "–" not in (work / "out" / "final.csv").read_text()

    def contents():
        return {p.name: p.read_bytes() for p in (work / "out").iterdir() if p.suffix != ".jsonl"}

    before = contents()
    (work / "bad.csv").write_text((work / "told.csv").read_text().replace("0.7", "700"))
    ran = cli("tune", two, *ROBOT, "--tell", "bad.csv")
    assert (ran.code, len(ran.lines)) == (2, 1)
    assert "expected up to" in ran.lines[0]
    assert contents() == before
