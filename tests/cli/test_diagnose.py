"""``stiction diagnose``: files, schema, exit codes, same bytes twice, its own result judged."""

import json
import re
import tomllib

import mujoco
import numpy as np
import pytest

from stiction_envs.friction.parameters import load_friction
from stiction_envs.gap.causes import CAUSES
from stiction_envs.gap.signals.rigid_body import gravity_torque
from stiction_envs.hidden.examples import log_csv
from stiction_envs.robots import load_arm
from tests.gap.small_logs import dry, hidden, sticky, write_csv

PARAMETERS = {c.name: {p.name for p in c.parameters} for c in CAUSES}
VERDICTS = {"explained", "partly explained", "no discrepancy", "cannot tell"}
FILES = {
    *("diagnosis.json", "report.md", "report.html", "model.xml", "model.toml"),
    *("provenance.json", "plots", "series.csv"),
}


def check_schema(found: dict, n: int) -> None:
    """``diagnosis.json`` has the documented keys; more keys are allowed."""
    assert isinstance(found["robot"], str)
    assert found["verdict"] in VERDICTS
    for key in ("nominal", "extended"):
        assert found[key]["held_out"] is True
        assert len(found[key]["rms_nm"]) == n
        assert all(x >= 0 for x in found[key]["rms_nm"])
    assert len(found["noise_floor_nm"]) == n
    assert isinstance(found["gain_percent"], float)
    assert set(found["shares_percent"]) == {"named", "links", "set_up", "left"}
    assert sum(found["shares_percent"].values()) == pytest.approx(100)
    for cause in found.get("not_shown", []):
        assert set(cause["parameters"]) <= PARAMETERS[cause["name"]]
        assert all(low < high for low, high in (x["ci95"] for x in cause["parameters"].values()))
    gains = [c["gain_percent"] for c in found["causes"]]
    assert gains == sorted(gains, reverse=True)
    for cause in found["causes"]:
        assert cause["name"] in PARAMETERS
        assert all(1 <= j <= n for j in cause["joints"])
        assert cause["evidence"]
        assert "\n" not in cause["evidence"]
        assert cause["nats"] > 0
        rivals = {x["name"]: x["nats"] for x in cause["rivals"]}
        assert list(rivals.values()) == sorted(rivals.values())
        assert cause["confused_with"] == [x for x in rivals if rivals[x] < 3][:3]
        assert set(rivals) <= set(PARAMETERS) - {cause["name"]}
        shown = {k: v for k, v in cause["parameters"].items() if k != "by_joint"}
        assert shown
        for key, p in shown.items():
            assert key in PARAMETERS[cause["name"]]
            assert isinstance(p["on_bound"], bool)
            values, intervals = p["value"], p["ci95"]
            if not isinstance(values, list):
                values, intervals = [values], [intervals]
            assert len(values) == len(intervals)
            for low, high in intervals:
                assert low <= high


@pytest.fixture
def log(two, inputs):
    """A log of the small arm with dry and viscous friction in both joints."""
    path = inputs / "log.csv"
    write_csv(path, hidden(load_arm(two), sticky))
    return path


@pytest.fixture
def ran(cli, two, log):
    """The command on that log, its files in ``a``."""
    done = cli("diagnose", log, "--robot", two, "--out", "a", "--json")
    assert done.code == 0, done.err
    return json.loads(done.out)


def test_writes_what_the_contract_says(ran, work, two, log, cli):
    there = {p.name for p in (work / "a").iterdir()}
    assert there == FILES
    found = json.loads((work / "a/diagnosis.json").read_text("utf-8"))
    check_schema(found, 2)
    assert {c["name"] for c in found["causes"]} >= {"coulomb_friction", "viscous_friction"}
    assert found["verdict"] == "explained"
    assert found["gain_percent"] > 80
    assert ran["causes"] == found["causes"]
    by = {c["name"]: c["parameters"] for c in found["causes"]}
    assert by["coulomb_friction"]["coulomb_nm"]["value"] == pytest.approx(0.5, abs=0.03)
    assert by["viscous_friction"]["viscous_nms"]["value"] == pytest.approx(0.4, abs=0.05)
    assert found["forward"]["windows"] >= 2

    model = mujoco.MjModel.from_xml_path(str(work / "a/model.xml"))
    assert model.nu == 2
    f = load_friction(work / "a/model.toml", 2)
    np.testing.assert_allclose(f.stiction * f.coulomb_ratio, 0.5, atol=0.03)
    assert tomllib.loads((work / "a/model.toml").read_text("utf-8"))["arm"]["robot"] == "two"

    page = (work / "a/report.html").read_text("utf-8")
    links = re.findall(r'(?:src|href)="([^"]+)"', page)
    pictures = list((work / "a/plots").iterdir())
    assert len(links) == len(pictures)
    assert all(x.startswith("data:image/png;base64,") for x in links)
    assert len(page) < 120_000 * len(pictures)  # with them it must still go into a mail
    text = (work / "a/report.md").read_text("utf-8")
    for heading in ("## 1. ", "## Error of each joint", "## Forward validation", "## Provenance"):
        assert heading in text
    for cause in found["causes"]:
        assert (work / f"a/plots/cause_{cause['name']}.png").is_file()

    # its folder is not written over
    assert cli("diagnose", log, "--robot", two, "--out", "a").code == 2
    assert cli("diagnose", log, "--robot", "panda", "--nominal", "a/model.toml").code == 2


@pytest.mark.slow
def test_its_model_explains_its_log(ran, work, two, log, cli):
    own = cli("diagnose", log, "--robot", two, "--nominal", "a/model.toml", "--out", "c", "--json")
    assert own.code == 0, own.err
    judged = json.loads(own.out)
    check_schema(judged, 2)
    assert judged["verdict"] == "no discrepancy"
    assert judged["causes"] == []
    np.testing.assert_allclose(judged["nominal"]["rms_nm"], ran["extended"]["rms_nm"], rtol=0.05)
    # and what that wrote still holds the friction
    again = load_friction(work / "c/model.toml", 2)
    np.testing.assert_allclose(again.stiction, load_friction(work / "a/model.toml", 2).stiction)


def test_poses_at_rest_without_time(cli, work, two, inputs):
    """Gravity torques with an offset of 7 N·m on joint 1, and no log beside them."""
    arm = load_arm(two)
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (120, 2))
    tau = gravity_torque(arm.pinocchio(), q) + [7.0, 0] + 0.02 * rng.normal(size=(120, 2))
    path = inputs / "poses.csv"
    rows = log_csv(np.zeros(120), q=q, tau=tau).splitlines()
    path.write_text("\n".join(row.partition(",")[2] for row in rows))  # without time
    done = cli("diagnose", "--poses", path, "--robot", two, "--out", "p", "--json")
    assert done.code == 0, done.err
    found = json.loads(done.out)
    check_schema(found, 2)
    assert {p.name for p in (work / "p").iterdir()} == FILES
    by = {c["name"]: c for c in found["causes"]}
    assert by["torque_offset"]["joints"] == [1]
    assert by["torque_offset"]["parameters"]["offset_nm"]["value"] == pytest.approx(7.0, abs=0.05)
    assert "120 poses at rest" in (work / "p/report.md").read_text("utf-8")
    assert "poses.csv" in (work / "p/provenance.json").read_text("utf-8")


@pytest.mark.slow
def test_several_logs_are_held_out_one_by_one(cli, work, two, inputs):
    arm = load_arm(two)
    paths = [inputs / f"log{k}.csv" for k in range(3)]
    for k, path in enumerate(paths):
        write_csv(path, hidden(arm, sticky, seed=k + 1))
    done = cli("diagnose", *paths, "--robot", two, "--out", "s", "--json")
    assert done.code == 0, done.err
    found = json.loads(done.out)
    check_schema(found, 2)
    assert {c["name"] for c in found["causes"]} >= {"coulomb_friction", "viscous_friction"}
    text = (work / "s/report.md").read_text("utf-8")
    assert all(f"`{path.name}`: 3000 rows" in text for path in paths)


# ---- logs that took no part (--check) ------------------------------------------------------------

KEYS = {
    *("nominal_rms_nm", "extended_rms_nm", "verdict", "worse_joints", "not_transferring"),
    "cutoff_hz",
}


def sprung(q, dq, ddq):
    """Friction, and a cable on joint 1 that another day is not there."""
    return dry(q, dq, ddq) + np.array([3.0, 0.0]) * q


@pytest.fixture
def other(two, inputs):
    write_csv(inputs / "other.csv", hidden(load_arm(two), dry, seed=7))
    return inputs / "other.csv"


@pytest.mark.slow
def test_a_log_that_took_no_part_is_in_every_file(cli, work, two, inputs, other):
    log = inputs / "log.csv"
    write_csv(log, hidden(load_arm(two), sprung))
    done = cli("diagnose", log, "--robot", two, "--check", other, "--out", "a", "--json")
    assert done.code == 0, done.err
    found = json.loads((work / "a/diagnosis.json").read_text("utf-8"))
    check = found["check"]
    assert set(check) == KEYS
    assert check["verdict"] == "does not hold"
    assert check["worse_joints"] == [1]
    assert check["not_transferring"] == ["external_spring"]
    assert len(check["nominal_rms_nm"]) == len(check["extended_rms_nm"]) == 2
    assert check["extended_rms_nm"][0] > check["nominal_rms_nm"][0]
    answer = json.loads(done.out)
    assert answer["check"] == check
    assert "does not hold on joint 1" in answer["summary"]
    text = (work / "a/report.md").read_text("utf-8")
    for words in ("does not hold on joint 1", "Not transferring: external_spring"):
        assert words in text
    assert "`other.csv` (check): 3000 rows" in text
    assert "check, extended [N·m]" in (work / "a/report.html").read_text("utf-8")
    told = json.loads((work / "a/provenance.json").read_text("utf-8"))
    assert set(told["inputs"]) >= {"log1", "check1"}
    assert "check1 | `other.csv`" in text
    # the diagnosis is that without it
    done = cli("diagnose", log, "--robot", two, "--out", "b")
    assert done.code == 0
    alone = json.loads((work / "b/diagnosis.json").read_text("utf-8"))
    assert "check" not in alone
    assert {**alone, "check": check} == found
    assert (work / "a/model.xml").read_bytes() == (work / "b/model.xml").read_bytes()
