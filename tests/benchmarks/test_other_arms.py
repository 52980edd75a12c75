"""The page of other people's arms: rows of arms that are not run stay as they are."""

from benchmarks.other_arms import COMMANDS, Came, Case, kept, page, row

SAID = "joint 2 stopped -0.3 rad from its pose: expected (at most) 0.1 rad"
ROWS = {
    "b1-z1": row({c: Came(0, "", 1.0 + k) for k, c in enumerate(COMMANDS)}, 1.4),
    "ur5": row({"export": Came(0, "", 0.5), "tune": Came(1, SAID, 3.0), "identify": None}, 2.5),
    "kinova": row({"sje of the diagnosis": Came(2, "x: y", 1.0)}, 2.0),
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


def test_a_page_is_read_as_it_was_written():
    text = page(ROWS)
    found = kept(text)
    assert page(found) == text
    assert found["ur5"].loop == "2.5"
    assert found["ur5"].cells["tune"] == f"1: {SAID}"
    assert found["ur5"].cells["identify"] == ""
    assert kept("") == {}


def test_every_command_that_reads_another_s_file_says_which(tmp_path):
    case = Case("ur5", tmp_path)
    found = {c: case.reads(c) for c in COMMANDS}
    for command in ("export", "sje", "gte", "tune", "excite"):
        assert found.pop(command) is None
    for command, path in found.items():
        assert path is not None
        assert path in case.argv(command), command
