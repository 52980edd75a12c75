"""``stiction sje`` from end to end, on one joint and one iteration."""

import json
import math

from stiction_envs.experiments.sje import experiment, protocol
from stiction_envs.measured.tables import read_sje
from tests.servo_arm import servo_arm

QUICK = ["--joint", 7, "--iterations", 1]
ONE = ["--load", "load", "--direction", "+"]
REPORT = ["report.html", "report.md", "torques.png"]


def test_base_only(cli, work):
    ran = cli("sje", "panda", *QUICK, "--out", "a")
    assert ran.code == 0
    assert ran.err == ""
    lines = [" ".join(line.split()) for line in ran.out.splitlines()]
    assert any(line.startswith("7 no-load pose − – −0.6") for line in lines)
    rows = read_sje("a/sje.csv")
    keys = [(7, load, d) for load in ("load", "no_load") for d in "+-"]
    assert [(r.joint, r.load, r.direction) for r in rows] == keys
    assert all(r.is_base and r.reduction == 0 and r.iterations == 1 for r in rows)
    assert all(math.copysign(1, r.tau_nm) == (1 if r.direction == "+" else -1) for r in rows)
    pictures = {"joint7_load.png", "joint7_no_load.png"}
    written = {p.name for p in (work / "a").iterdir()}
    assert written == {"sje.csv", "provenance.json", *pictures, *REPORT}
    assert (work / "a" / "sje.csv").read_text("utf-8").splitlines()[0].split(",") == [
        *("robot", "joint", "load", "direction", "frequency_hz", "amplitude_nm"),
        *("tau_nm", "std_nm", "iterations", "reduction"),
    ]


def test_with_dither(cli, work, dither):
    two = ["--joint", 6, 7, *ONE, "--iterations", 1]
    ran = cli("sje", "panda", *two, "--dither", dither, "--json")
    result = json.loads(ran.out)
    assert ran.code == 0
    rows = read_sje(work / "runs" / "sje-panda" / "sje.csv")
    base = {(r.joint, r.load, r.direction): r.tau_nm for r in rows if r.is_base}
    dithered = [r for r in rows if not r.is_base]
    assert len(base) == 2
    assert {r.joint for r in dithered} == {7}
    for r in dithered:
        assert (r.frequency_hz, r.amplitude_nm) == (15.0, 0.6)
        tau_base = base[7, r.load, r.direction]
        assert r.reduction == 1 - abs(r.tau_nm) / abs(tau_base)
        assert r.reduction > 0.1
    names = {p.stem for p in (work / "runs" / "sje-panda").glob("*.png")}
    assert names == {"joint6_load", "joint7_load", "joint7_load_dither", "torques"}
    assert [r["tau_nm"] for r in result["rows"]] == [r.tau_nm for r in rows]
    assert result["rows"][0]["std_nm"] is None  # NaN is no JSON
    assert result["failed"] is None


def test_stuck_configurations_are_named_and_left_out(cli, work, dither, monkeypatch):
    base = protocol.load_protocol("panda")
    # too little without dither, enough with it
    monkeypatch.setattr(
        experiment, "load_protocol", lambda robot, **_: base.replace(give_up_factor=0.8)
    )
    options = ["--no-scatter", "--dither", dither, "--out", "a", "--json"]
    ran = cli("sje", "panda", *QUICK, *ONE, *options)
    assert ran.code == 1
    assert len(ran.lines) == 1
    assert "left out of" in ran.lines[0]
    result = json.loads(ran.out)
    assert result["stuck"] == [{"joint": 7, "load": "load", "direction": "+"}]
    (row,) = read_sje(work / "a" / "sje.csv")
    assert not row.is_base
    assert math.isnan(row.reduction)
    assert result["rows"][0]["reduction"] is None


def test_a_model_of_servo_logs_is_driven_by_its_servos(cli, work):
    _, model = servo_arm(work)
    options = [*QUICK[2:], *ONE, "--joint", 2, "--friction", model, "--json"]
    ran = cli("sje", "two_links.xml", *options, "--out", "a")
    assert ran.code == 0
    row = json.loads(ran.out)["rows"][0]
    assert math.isclose(row["tau_nm"], 0.3, rel_tol=0.1)
    assert "τ/K [mrad]" in (work / "a" / "report.md").read_text("utf-8")
