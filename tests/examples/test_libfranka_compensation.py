"""The C++ example's friction compensation: Python's torques, from the same files."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.control.compensation import KINDS, Compensation
from stiction_envs.control.compensation_files import write_treatment
from stiction_envs.control.laws import law_torque
from stiction_envs.friction.parameters import load_friction
from stiction_envs.measured import AmplitudeRow
from stiction_envs.robots import load_arm
from tests.examples.test_libfranka_dither import (
    COMPILER,
    EXAMPLE,
    HERE,
    STRICT,
    run_main,
)
from tests.examples.test_libfranka_dither import built as built  # the fixture

pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C++ compiler: g++ or clang++")
DITHER = [AmplitudeRow(7, 15.0, 0.8009660772725983), AmplitudeRow(1, 30.0, 1.5, "triangle")]
NAMES = load_arm("panda").joint_names
UNITS = np.array([0.1, 0.1, 0.003, 20.0, 3.0, 0.003])
"""Of a joint's wanted and measured speed, error, gravity, torque and momentum."""


@pytest.fixture(scope="module")
def program(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("built") / "compensations"
    source = HERE / "compensations.cpp"
    subprocess.run([COMPILER, *STRICT, f"-I{EXAMPLE}", source, "-o", out], check=True)
    return out


def friction_of(kind: str) -> Compensation:
    c = Compensation.from_friction(kind, load_friction("panda", 7), 0.9)
    numbers = {"load": (0.04,) * 7} if kind == "push" else {}
    numbers |= {"damping": (1.7,) * 7, "injection": (0.7,) * 7} if "lugre" in kind else {}
    gain = (*c.gain[:3], 0.0, *c.gain[4:])
    return Compensation(**{**vars(c), "gain": gain, **numbers})


@pytest.mark.parametrize(("kind", "end"), [*((k, "csv") for k in KINDS), ("push", "yaml")])
def test_torques_are_those_of_python(program: Path, tmp_path: Path, kind: str, end: str) -> None:
    """Two seconds of everything a joint may see, observers with their memory."""
    c = friction_of(kind)
    write_treatment(tmp_path, DITHER, c, NAMES)
    path = tmp_path / ("final.yaml" if end == "yaml" else "compensation.csv")
    rng = np.random.default_rng(0)
    slow = np.cumsum(rng.normal(size=(2000, 7, 6)), axis=0) / 20
    seen = UNITS * (slow + 0.1 * rng.normal(size=slow.shape))
    seen[:50] = 0.0
    text = "\n".join(" ".join(map(repr, map(float, row.ravel()))) for row in seen)
    ran = subprocess.run([program, path], input=text, capture_output=True, text=True, check=True)
    got = np.fromstring(ran.stdout, sep=" ").reshape(-1, 7)
    packed, state, law = c.packed(), np.zeros((7, 1)), KINDS.index(kind)
    expected = np.zeros((2000, 7))
    for k in range(2000):
        for j in range(7):
            if c.gain[j] > 0:
                expected[k, j] = law_torque(law, packed[j], seen[k, j], state[j], 1e-3)
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12)
    assert not got[:, 3].any()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("joint,gain_nm\n1,1\n", "expected a column kind"),
        ("joint,kind,gain_nm\n1,pull,1\n", "unknown kind 'pull'"),
        ("joint,kind,gain_nm,speed_rad_s\n1,feedforward,-1,1\n", "gain_nm: expected >= 0"),
        ("joint,kind,gain_nm\n1,feedforward,1\n", "expected a column speed_rad_s"),
        ("joint,kind,gain_nm,rate_1_s,share\n1,momentum_observer,1,1,2\n", "share: expected <= 1"),
    ],
)
def test_bad_files_are_refused(program: Path, tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "c.csv"
    path.write_text(text)
    ran = subprocess.run([program, path], input="0", capture_output=True, text=True)
    assert (ran.returncode, ran.stdout) == (1, "")
    assert says in ran.stderr


def test_main_compensates_softly_within_limits(built: Path, tmp_path: Path) -> None:
    """A tenth of a push at an arm that creeps off, faded in and out, at the robot's rate."""
    c = Compensation(kind="push", gain=(1.0,) * 7, speed=(0.05,), error=(1e-4,), load=(0.0,))
    write_treatment(tmp_path, DITHER[:0], c, NAMES)
    ran, told = run_main(built, "fr3", tmp_path / "final.yaml", 4, DRIFT=0.01)
    assert ran.returncode == 0, ran.stderr
    t, tau = told[:, 0] / 1000, told[:, 1:]
    off = -0.01 * t
    fade = 0.5 - 0.5 * np.cos(np.pi * np.clip(np.minimum(t, 4 - t), 0, 1))
    push = 0.1 * fade * np.tanh(off / 1e-4)
    k = t > 0.01
    np.testing.assert_allclose(tau[k, 2] - 600 * off[k], push[k], atol=0.02)
    assert np.abs(np.diff(tau, axis=0)).max() <= 1 + 1e-9


@pytest.mark.parametrize("name", ["final.yaml", "final.csv"])
def test_main_refuses_gains_beyond_its_limit(built: Path, tmp_path: Path, name: str) -> None:
    c = Compensation(kind="push", gain=(1.0,) * 6 + (1.3,))
    write_treatment(tmp_path, (), c, NAMES)
    ran, told = run_main(built, "fr3", tmp_path / name, 4)
    assert (ran.returncode, len(told)) == (1, 0)
    assert "joint 7: more than 1.2" in ran.stderr


def test_main_stops_on_an_error(built: Path, tmp_path: Path) -> None:
    write_treatment(tmp_path, DITHER[:0], friction_of("momentum_observer").times(0.3), NAMES)
    for robot, says in (({"DRIFT": 0.2}, "drifts"), ({"SPEED": 0.6}, "too fast")):
        ran, told = run_main(built, "fr3", tmp_path / "final.yaml", 4, **robot)
        assert ran.returncode == 1
        assert says in ran.stderr
        assert len(told) < 1100
