"""``stiction conformance``: files and exit codes; the test itself is `tests/experiments`'s."""

import csv
import json

import pytest

from tests.experiments.test_conformance import lugre, stock


def test_a_model_that_sticks_and_one_that_creeps(cli, work, inputs):
    good, bad = inputs / "good.xml", inputs / "bad.xml"
    good.write_text(lugre("2000 12 0.5 0.6 0.003"))
    bad.write_text(stock())
    ran = cli("conformance", good)
    assert ran.code == 0
    assert "1 of 1 joints stick" in ran.out
    assert ran.out.endswith("written to runs/conformance-good: conformance.csv\n")
    with open(work / "runs/conformance-good/conformance.csv", encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert (row["holds"], row["goes"], row["stiction_nm"]) == ("yes", "yes", "0.6")

    ran = cli("conformance", bad, "--json", "--out", "bad")
    assert ran.code == 1
    (row,) = json.loads(ran.out)["rows"]
    assert not row["holds"]
    assert ran.lines == ["error: does not stick as it should: j"]
    found = json.loads((work / "bad" / "provenance.json").read_text())
    assert found["files"] == ["conformance.csv"]
    assert "robot" in found["inputs"]


@pytest.mark.slow
def test_what_export_writes_is_what_it_takes(cli, two, work):
    assert cli("export", two, "--out", "model").code == 0
    assert cli("conformance", "model/model.xml", "--out", "a").code == 0


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        (["atlas"], "no such file, and no robot of that name"),
        ([""], "no such file, and no robot of that name"),
        (["{good}", "--stiction", "-1"], "finite numbers from 0"),
        (["{good}", "--stiction", 1, 2], "1 hinges"),
        (["{broken}"], "not a readable MJCF or URDF"),
    ],
)
def test_bad_input(cli, work, inputs, argv, says):
    (inputs / "good.xml").write_text(lugre("2000 12 0.5 0.6 0.003"))
    (inputs / "broken.xml").write_text("<mujoco><nonsense/></mujoco>")
    names = {k: inputs / f"{k}.xml" for k in ("good", "broken")}
    ran = cli("conformance", *(str(a).format(**names) for a in argv))
    assert ran.code == 2
    assert len(ran.lines) == 1
    assert says in ran.lines[0]
    assert list(work.iterdir()) == []
