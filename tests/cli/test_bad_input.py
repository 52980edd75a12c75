"""Bad input: exit code 2, one line that names the matter, nothing written."""

import shlex
import shutil
from dataclasses import replace

import pytest

from stiction_envs.hidden.examples import log_csv
from stiction_envs.robots import load_arm
from tests.cli.short_commands import BASE_TWO
from tests.experiments.test_conformance import lugre
from tests.gap.small_logs import hidden, write_csv
from tests.robots.arms import TWO, chain

HEADER = "joint,frequency_hz,amplitude_nm\n"
BASE = "robot,joint,load,direction,tau_base_Nm\n"
LIMIT = load_arm("panda").limits.torque[6]

FILES = {
    # amplitude tables
    "good.csv": f"{HEADER}7,15,0.1\n",
    "strong.csv": f"{HEADER}7,15,{LIMIT + 0.1}\n",
    "fast.csv": f"{HEADER}7,1001,0.1\n",
    # other tables
    "base_robot.csv": f"{BASE}ur5,1,load,+,0.5\n",
    "base_two.csv": BASE_TWO,
    "empty.csv": "",
    "sje.csv": (
        "robot,joint,load,direction,frequency_hz,amplitude_nm,tau_nm,std_nm,iterations,reduction\n"
        "two,1,load,+,0,0,0.5,0.01,4,0\n"
    ),
    "bounds_slow.toml": "[all]\nfrequency_hz = [5, 80]\n",
    # arms and their friction
    "ten.xml": chain(10),
    "two.xml": TWO,
    "slide.xml": chain(3, kind="slide"),
    "lugre.xml": lugre("2000 12 0.5 0.6 0.003"),
    "friction.toml": "[stiction]\nvalue = [1.0]\n",
    "no.toml": "[stiction",
    "senses.toml": "[sensing]\nangle_noise = -1e-5\n",
}
ROBOTS = "iiwa14, iiwa7, panda"
TRIANGLE = "--trajectory triangle --stiffness 200 20 0"
DITHER = "--dither {good.csv}"
BAD = {
    # beginning of a command line: its end: what is said
    "": {"": "COMMAND", "dance": "'dance'"},
    "sje": {
        "": "ROBOT",
        "ur5": ROBOTS,
        "{two.xml} --joint 3": "1, 2",
        "{two.xml} --sensing robot": "has no table [sensing], only iiwa14, iiwa7, panda",
        "{slide.xml}": "slide",
        "nowhere.xml": "nowhere.xml: no such file",
    },
    "sje panda": {
        "--joint 0": "whole numbers from 1",
        "--joint 8": "1, 2, 3, 4, 5, 6, 7",
        "--load heavy": "no_load",
        "--speed 3": "--speed",
        "--drive position": "[servo]",
        "--iter 3": "--iter",
        "--payload -1 0 0 0": "from 0 kg",
        "--payload 1": "4 arguments",
        "--friction {no.toml}": "not a TOML file",
        "--sensing {senses.toml}": "angle_noise is -1e-05: expected `float` >= 0",
        "--sensing {friction.toml}": "expected a table [sensing]",
        "--out {good.csv}": "is a file",
        "--out {good.csv}/x": "not a folder",
    },
    "sje panda --dither": {
        "{strong.csv}": "torque limit of joint 7",
        "{fast.csv}": "at most 1000 Hz",
        "{good.csv} --joint 1 2": "tested are 1, 2",
    },
    "gte": {
        f"ur5 {TRIANGLE}": ROBOTS,
        "panda --stiffness 200 20 0": "--trajectory",
        "panda --trajectory triangle": "--stiffness",
    },
    "gte panda --stiffness 200 20 0 --trajectory": {
        "nowhere.csv": "nowhere.csv",
    },
    "gte panda --trajectory triangle --stiffness": {
        "200 -20 0": "from 0",
    },
    f"gte panda {TRIANGLE}": {
        "--compensation pull": "'pull': expected one of feedforward, push, lugre_observer",
        "--compensation {good.csv}": "gain_nm",
        "--compensation {good.csv} --compensation-table {good.csv}": "not with --compensation FILE",
        "--compensation-table {good.csv}": "needs --compensation",
        "--start 0 0 3 -2 0 1.5 0": "joint 3: 3 rad",
        "--tool 0 0 inf": "finite",
        "--sensing human": "sensing human: expected ideal, robot, or an existing TOML",
    },
    "calibrate": {
        "ur5 {good.csv}": ROBOTS,
        "{two.xml} {base_two.csv} --out friction": ".toml",
        "{two.xml} {base_two.csv} --out {no.toml}": "or force",
    },
    "calibrate panda": {
        "{base_robot.csv}": "ur5",
        "{good.csv}": "missing column",
        "nowhere.csv": "nowhere.csv",
    },
    "view panda": {
        "--joint 8": "unknown joint 8: expected one of 1, 2",
        "--joint 0": "whole numbers from 1",
        "--dither nowhere.csv": "nowhere.csv",
        "--friction nowhere.toml": "nowhere.toml",
    },
    "tune": {"ur5": ROBOTS},
    "tune panda": {
        "--table nowhere.csv": "nowhere.csv",
        "--frequencies 15 1001": "at most 1000 Hz",
        "--frequencies 15 15": "once",
        "--ask": "--ask: not with --protocol thesis",
        "--scales -1": "above 0",
        "--sampler tpe": "--sampler: not with --protocol thesis",
        "--protocol mine": "thesis",
    },
    "tune panda --protocol search": {
        "--ask 0": "whole numbers from 1",
        "--ask --sampler gp": "--sampler: not with --ask or --tell",
        "--ask --sensing robot": "--sensing: not with --ask or --tell",
        "--ask --force": "--force: not with --ask or --tell",
        "--ask --pareto": "--pareto: not with --ask or --tell",
        "--ask --storage sqlite:///x.db": "--storage: not with --ask or --tell",
        "--ask --storage mysql://me:secret@x": "storage",
        "--tell nothing.csv": "expected a readable CSV file",
        "--tell {good.csv}": "missing column 'robot'",
        "--sampler luck": "'luck'",
        "--scales 1": "--scales: not with --protocol search",
        "--bounds nowhere.toml": "nowhere.toml",
        "--objective gte --bounds {bounds_slow.toml}": "15 Hz",
        "--storage postgresql+psycopg://me:secret@127.0.0.1:1/none": (
            "storage postgresql+psycopg://me:***@127.0.0.1:1/none"
        ),
    },
    "export": {
        "ur5": ROBOTS,
        "{ten.xml}": "1 to 9",
        "panda --tilt inf 0": "finite",
        "panda --friction {friction.toml}": "source",
        "panda --from nowhere": "model.toml nor friction.toml",
        "panda --from . --friction a.toml": "one",
        "panda --friction stribeck": "expected one of dcmotor, frictionloss, or a path to a .toml",
        "panda --friction dcmotor --friction frictionloss": "one kind and one .toml at most",
        "panda --engine bullet": "expected one of mujoco, warp, mjx, newton",
        "panda --engine mjx --friction dcmotor": "engine has no dcmotor",
    },
    "conformance": {
        "{lugre.xml} --stiction -1": "finite numbers from 0",
        "{lugre.xml} --engine bullet": "expected one of mujoco, warp, mjx, newton",
    },
    "excite": {
        "ur5": ROBOTS,
        "panda --harmonics 1": "whole numbers from 2",
    },
    "identify": {
        "missing.csv --robot panda": "missing.csv: no such file",
        ". --robot panda": "or a folder of ROS 2, lerobot or SAGE",
        "{log.csv} --robot panda": "log.csv: columns for 2 joints",
        "{log.csv} --robot ur5": ROBOTS,
        "{log.csv} --robot {two.xml} --cutoff 0": "above 0",
        "--robot panda": "LOG",
    },
    "diagnose": {
        "--robot {two.xml}": "error: no log given: expected one or more logs, or poses",
        "{log.csv}": "--robot",
        "{empty.csv} --robot {two.xml}": "empty.csv",
        "nowhere.csv --robot {two.xml}": "no such file",
        "{log.csv} --robot robbie": "unknown robot 'robbie'",
        "{log.csv} --robot panda": "log.csv",
    },
    "diagnose {log.csv} --robot {two.xml}": {
        "--nominal soft": "rigid, shipped",
        "--nominal gone.toml": "gone.toml",
        "--torque both": "motor",
        "--cutoff -3": "above 0",
        "--out {empty.csv}": "empty.csv",
        "{log.csv}": "log.csv",
        "--rehearse-causes payload": "error: --rehearse-causes: expected --rehearse too",
    },
    "diagnose {log.csv} --robot {two.xml} --check": {
        "gone.csv": "gone.csv: no such file",
        "{log.csv}": "it is diagnosed too",
        "{still.csv}": "expected one or more that move in both",
        "{sje.csv}": "sje.csv is a torque table: expected joint logs",
    },
    "diagnose {sje.csv} --robot {two.xml} --check": {
        "{log.csv}": "is a torque table: expected joint logs",
    },
    "diagnose --robot {two.xml} --rehearse": {
        "": "no log given",
        "{base_two.csv}": "is a torque table: expected joint logs",
        "{log.csv} --check {log.csv}": "--check: cannot be used with --rehearse",
        "{log.csv} --poses {log.csv}": "--poses: cannot be used with --rehearse",
        "{log.csv} --rehearse-causes rust": "cause 'rust': expected one of coulomb_friction",
        "{log.csv} --cutoff nan": "expected",
    },
    "diagnose --robot {two.xml} --rehearse {servo.csv}": {
        "--rehearse-causes viscous_friction": "expected one of servo_stiffness, damping",
        "--cutoff 5": "cutoff: expected joint logs",
        "--torque link": "torque: expected joint logs",
        "--nominal shipped": "servo logs expect rigid",
    },
    "check": {
        "": "FILE",
        ".": ".: a directory: expected a torque table or a joint log, or a folder of ROS 2",
        "{good.csv} --robot robbie": "unknown robot 'robbie'",
        "{good.csv} --out {good.csv}": "is a file",
    },
}
CASES = [(f"{a} {b}".strip(), says) for a, ends in BAD.items() for b, says in ends.items()]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Folder with `FILES` and logs of the small arm."""
    folder = tmp_path_factory.mktemp("files")
    for name, content in FILES.items():
        (folder / name).write_text(content)
    log = hidden(load_arm(folder / "two.xml"), seconds=3.0)
    write_csv(folder / "log.csv", log)
    write_csv(folder / "still.csv", replace(log, q=0.01 * log.q))
    (folder / "servo.csv").write_text(log_csv(log.t, q_cmd=log.q, q=0.9 * log.q))
    return folder


@pytest.mark.parametrize(("line", "says"), CASES, ids=[line for line, _ in CASES])
def test_bad_input(refused, inputs, files, line, says):
    shutil.copytree(files, inputs, dirs_exist_ok=True)
    assert says in refused(*shlex.split(line))


@pytest.mark.parametrize("command", ["sje", "export", "tune"])
def test_output_folder_of_another_run(refused, work, command):
    (work / "out").mkdir()
    (work / "out" / "notes.txt").write_text("mine")
    assert "or force" in refused(command, "panda", "--out", "out")
