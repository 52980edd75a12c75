"""``stiction diagnose``: files, schema, exit codes, same bytes twice, its own result judged."""

import html.parser
import json
import tomllib

import mujoco
import numpy as np
import pytest

from stiction_envs.friction.parameters import load_friction
from stiction_envs.gap.causes import CAUSES
from stiction_envs.gap.signals.rigid_body import gravity_torque
from stiction_envs.robots import load_arm
from tests.gap.small_logs import hidden, sliding, write_csv

PARAMETERS = {c.name: {p.name for p in c.parameters} for c in CAUSES}
VERDICTS = {"explained", "partly explained", "no discrepancy", "cannot tell"}
FILES = {
    *("diagnosis.json", "report.md", "report.html", "model.xml", "model.toml"),
    *("provenance.json", "plots"),
}


def check_schema(found: dict, n: int) -> None:
    """``diagnosis.json`` is that of the contract; more keys are allowed."""
    assert isinstance(found["robot"], str)
    assert found["verdict"] in VERDICTS
    for key in ("nominal", "extended"):
        assert found[key]["held_out"] is True
        assert len(found[key]["rms_nm"]) == n
        assert all(x >= 0 for x in found[key]["rms_nm"])
    assert len(found["noise_floor_nm"]) == n
    assert isinstance(found["gain_percent"], float)
    gains = [c["gain_percent"] for c in found["causes"]]
    assert gains == sorted(gains, reverse=True)
    for cause in found["causes"]:
        assert cause["name"] in PARAMETERS
        assert all(1 <= j <= n for j in cause["joints"])
        assert cause["evidence"]
        assert "\n" not in cause["evidence"]
        assert set(cause["confused_with"]) <= set(PARAMETERS) - {cause["name"]}
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


def sticky(q, dq, ddq):
    return 0.5 * sliding(q) + 0.4 * dq


@pytest.fixture
def log(two, inputs):
    """A log of the small arm with dry and viscous friction in both joints."""
    path = inputs / "log.csv"
    write_csv(path, hidden(load_arm(two), sticky))
    return path


@pytest.fixture
def ran(cli, two, log):
    """The command on that log, its files in ``a``."""
    done = cli("diagnose", log, "--robot", two, "--out", "a", "--json", "--method", "lsm")
    assert done.code == 0, done.err
    return json.loads(done.out)


class Links(html.parser.HTMLParser):
    def __init__(self):
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.found += [v for k, v in attrs if k in ("src", "href") and v]


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
    assert len(found["lsm"]["lines"]) == 4
    assert found["forward"]["windows"] >= 2

    model = mujoco.MjModel.from_xml_path(str(work / "a/model.xml"))
    assert model.nu == 2
    f = load_friction(work / "a/model.toml", 2)
    np.testing.assert_allclose(f.stiction * f.coulomb_ratio, 0.5, atol=0.03)
    assert tomllib.loads((work / "a/model.toml").read_text("utf-8"))["arm"]["robot"] == "two"

    page = (work / "a/report.html").read_text("utf-8")
    links = Links()
    links.feed(page)
    pictures = list((work / "a/plots").iterdir())
    assert len(links.found) == len(pictures)
    assert all(x.startswith("data:image/png;base64,") for x in links.found)
    assert len(page) < 120_000 * len(pictures)  # with them it must still go into a mail
    text = (work / "a/report.md").read_text("utf-8")
    for heading in ("## Causes", "## Held-out residual", "## Forward validation", "## Provenance"):
        assert heading in text
    for cause in found["causes"]:
        assert (work / f"a/plots/cause_{cause['name']}.png").is_file()

    # the same run gives the same bytes
    again = cli("diagnose", log, "--robot", two, "--out", "b", "--method", "lsm")
    assert again.code == 0
    for path in (work / "a").rglob("*"):
        if path.is_file():
            other = work / "b" / path.relative_to(work / "a")
            assert path.read_bytes() == other.read_bytes(), path.name

    # judged on its own result, nothing is left
    own = cli("diagnose", log, "--robot", two, "--nominal", "a/model.toml", "--out", "c", "--json")
    assert own.code == 0, own.err
    judged = json.loads(own.out)
    check_schema(judged, 2)
    assert judged["verdict"] == "no discrepancy"
    assert judged["causes"] == []
    np.testing.assert_allclose(judged["nominal"]["rms_nm"], found["extended"]["rms_nm"], rtol=0.05)
    # and what that wrote still holds the friction
    again = load_friction(work / "c/model.toml", 2)
    np.testing.assert_allclose(again.stiction, f.stiction)

    # its folder is not written over
    assert cli("diagnose", log, "--robot", two, "--out", "a").code == 2
    assert cli("diagnose", log, "--robot", "panda", "--nominal", "a/model.toml").code == 2


@pytest.mark.parametrize(
    ("text", "options", "says"),
    [
        ("", (), "log.csv"),
        ("t,q1,q2,tau1,tau2\n", (), "log.csv"),
        ("t,q1,tau1\n0,0,0\n1,0,0\n", (), "log.csv"),
        (None, (), "no such file"),
        ("good", ("--robot", "robbie"), "unknown robot 'robbie'"),
        ("good", ("--nominal", "soft"), "rigid, shipped"),
        ("good", ("--nominal", "gone.toml"), "gone.toml"),
        ("good", ("--torque", "both"), "motor"),
        ("good", ("--cutoff", "-3"), "above 0"),
        ("good", ("--payload", "-1", "0", "0", "0"), "payload mass"),
        ("good", ("--robot", "panda"), "log.csv"),
        ("good", ("--out", "taken.txt"), "taken.txt"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(cli, work, two, inputs, text, options, says):
    path = inputs / "log.csv"
    if text == "good":
        write_csv(path, hidden(load_arm(two), seconds=3.0))
    elif text is not None:
        path.write_text(text)
    (work / "taken.txt").write_text("mine")
    robot = () if "--robot" in options else ("--robot", two)
    done = cli("diagnose", path, *robot, *options)
    assert done.code == 2
    assert len(done.lines) == 1
    assert says in done.lines[0]
    assert {p.name for p in work.iterdir()} == {"taken.txt"}


def test_poses_at_rest_without_time(cli, work, two, inputs):
    """Gravity torques with an offset of 0.7 N·m on joint 1, and no log beside them."""
    arm = load_arm(two)
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (120, 2))
    tau = gravity_torque(arm.pinocchio(), q) + [0.7, 0] + 0.02 * rng.normal(size=(120, 2))
    path = inputs / "poses.csv"
    np.savetxt(
        path, np.hstack([q, tau]), fmt="%.6f", delimiter=",", header="q1,q2,tau1,tau2", comments=""
    )
    done = cli("diagnose", "--poses", path, "--robot", two, "--out", "p", "--json")
    assert done.code == 0, done.err
    found = json.loads(done.out)
    check_schema(found, 2)
    assert {p.name for p in (work / "p").iterdir()} == FILES
    by = {c["name"]: c for c in found["causes"]}
    assert by["torque_offset"]["joints"] == [1]
    assert by["torque_offset"]["parameters"]["offset_nm"]["value"] == pytest.approx(0.7, abs=0.05)
    assert "120 poses at rest" in (work / "p/report.md").read_text("utf-8")
    assert "poses.csv" in (work / "p/provenance.json").read_text("utf-8")
    # as a log it lacks a time, and the line says what it may be
    done = cli("diagnose", path, "--robot", two)
    assert done.code == 2
    assert "missing column 't'" in done.lines[0]


def test_no_log_at_all(cli, two, work):
    done = cli("diagnose", "--robot", two)
    assert done.code == 2
    assert done.lines == ["error: no log given: expected one or more logs, or poses"]
    assert list(work.iterdir()) == []


@pytest.mark.slow
def test_several_logs_are_held_out_one_by_one(cli, work, two, inputs):
    """Three logs in one call; the same one twice is refused."""
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
    assert cli("diagnose", paths[0], paths[0], "--robot", two).code == 2


def test_robot_must_be_named(cli, inputs):
    done = cli("diagnose", inputs / "log.csv")
    assert done.code == 2
    assert "--robot" in done.lines[0]
