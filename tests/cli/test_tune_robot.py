"""``stiction tune --ask`` and ``--tell``: the way of a user at a robot."""

from __future__ import annotations

import csv
import json

import pytest

from stiction_envs.method_settings import override
from tuning.robot import session
from tuning.settings import tuning_settings

FEW = {"robot.frequencies": 2, "robot.amplitudes": 2, "robot.iterations": 1}
COMMAND = ("--protocol", "search", "--out", "out", "--threads", 1)


@pytest.fixture
def few(monkeypatch):
    """So few candidates that simulating them is quick."""
    changed = override(tuning_settings(), FEW)
    monkeypatch.setattr(session, "tuning_settings", lambda: changed)


@pytest.mark.slow
def test_ask_tell_ask(cli, work, two, few):
    ran = cli("tune", two, *COMMAND, "--ask")
    assert ran.code == 0, ran.err
    table = (work / "out" / "ask.csv").read_text()
    assert table.splitlines()[0] == "joint,frequency_hz,amplitude_nm"
    assert table.strip() in ran.out, "the table is on standard output too"
    rows = list(csv.DictReader((work / "out" / "measure.csv").open()))
    for row in rows:
        row["tau_nm"] = (1 if row["direction"] == "+" else -1) * (
            0.7 if float(row["amplitude_nm"]) else 0.8
        )
    with (work / "told.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    ran = cli("tune", two, *COMMAND, "--tell", "told.csv", "--ask", 2, "--json")
    assert ran.code == 0, ran.err
    found = json.loads(ran.out)
    assert found["told"] == 4
    assert [j["measured_settings"] for j in found["joints"]] == [1, 1]
    again = {(r["joint"], r["frequency_hz"], r["amplitude_nm"]) for r in found["ask"]}
    told = {(int(r["joint"]), float(r["frequency_hz"]), float(r["amplitude_nm"])) for r in rows}
    assert not again & told
    assert "–" not in (work / "out" / "final.csv").read_text()
    before = {p.name: p.read_bytes() for p in (work / "out").iterdir() if p.suffix != ".db"}
    (work / "bad.csv").write_text((work / "told.csv").read_text().replace("0.7", "700"))
    ran = cli("tune", two, *COMMAND, "--tell", "bad.csv")
    assert ran.code == 2
    assert len(ran.lines) == 1
    assert "expected up to" in ran.lines[0]
    after = {p.name: p.read_bytes() for p in (work / "out").iterdir() if p.suffix != ".db"}
    assert after == before
