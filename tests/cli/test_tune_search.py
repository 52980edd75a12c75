"""``stiction tune --protocol search`` from the command line to its files."""

import csv
import json

import pytest

from tests.robots.arms import chain


@pytest.mark.slow  # ramps of an arm that nobody calibrated
def test_search_writes_what_the_contract_says_and_goes_on(cli, work):
    (work / "two.xml").write_text(chain(2))
    argv = ["tune", "two.xml", "--protocol", "search", "--sampler", "random", "--evaluations", 3]
    argv += ["--out", "found", "--seed", 4, "--json"]
    ran = cli(*argv)
    assert ran.code == 0
    result = json.loads(ran.out)
    assert result["command"] == "tune"
    assert [r["joint"] for r in result["final"]] == [1, 2]
    names = ("trials.csv", "final.csv", "verification.csv", "comparison.csv", "report.md")
    before = {name: (work / "found" / name).read_bytes() for name in names}
    with (work / "found" / "trials.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 6
    assert cli(*argv).code == 0  # it goes on where it was: at its end
    assert before == {name: (work / "found" / name).read_bytes() for name in names}
    ran = cli("sje", "two.xml", "--dither", "found/final.yaml", "--iterations", 1, "--out", "ros")
    assert ran.code == 0
    ran = cli("sje", "two.xml", "--dither", "found/final.csv", "--iterations", 1, "--out", "csv")
    assert (work / "ros/sje.csv").read_bytes() == (work / "csv/sje.csv").read_bytes()
    assert ran.code == 0
