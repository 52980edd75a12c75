"""The page of other people's arms: rows of arms that are not run stay as they are."""

from pathlib import Path

from benchmarks.accuracy.other_arms import COMMANDS, STUDY, Case, keep, kept, page

SAID = "joint 2 stopped -0.3 rad from its pose: expected (at most) 0.1 rad"
DONE = {c: {"code": 0, "said": "", "seconds": 1.0 + k} for k, c in enumerate(COMMANDS)}
ROWS = {
    "b1-z1": {"loop": 1.4, "commands": DONE},
    "ur5": {
        "loop": 2.5,
        "commands": {
            "export": {"code": 0, "said": "", "seconds": 0.5},
            "tune": {"code": 1, "said": SAID, "seconds": 3.0},
            "identify": None,
        },
    },
    "kinova": {
        "loop": 2.0,
        "commands": {"sje of the diagnosis": {"code": 2, "said": "x: y", "seconds": 1.0}},
    },
}


def test_a_page_holds_what_came_of_each_command():
    text = page(ROWS)
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    assert [x.split("|")[1].strip() for x in rows[1:]] == [
        "ur5",
        "kinova",
        "b1-z1 `--chain link00 gripperStator`",
    ]
    assert rows[1].split("|")[2:4] == [" 2.5 ", " 0.5 "]
    assert f"(1) ur5, tune (exit code 1): {SAID}\n" in text
    assert "(2) kinova, sje of the diagnosis (exit code 2): x: y" in text


def test_rows_are_read_as_they_were_written(tmp_path: Path):
    keep(tmp_path / "rows.json", ROWS)
    assert kept(tmp_path / "rows.json") == ROWS
    assert list(kept(tmp_path / "rows.json")) == ["ur5", "kinova", "b1-z1"]
    assert kept(tmp_path / "none.json") == {}


def test_the_kept_rows_make_the_page():
    found = [x for x in page(kept(STUDY.folder / "other_arms.json")).splitlines() if "|" in x]
    text = (STUDY.folder / "other_arms.md").read_text("utf-8")
    assert found == [x for x in text.splitlines() if "|" in x]


def test_every_command_that_reads_another_s_file_says_which(tmp_path: Path):
    case = Case("ur5", tmp_path)
    found = {c: case.reads(c) for c in COMMANDS}
    for command in ("export", "sje", "gte", "tune", "excite"):
        assert found.pop(command) is None
    for command, path in found.items():
        assert path is not None
        assert path in case.argv(command), command
