"""The C++ example: torques as Python's, files refused as by Python, and a main program that is safe
against a stand-in of libfranka."""

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.control.compensation import Compensation
from stiction_envs.control.compensation_files import write_treatment
from stiction_envs.control.laws import LAWS
from stiction_envs.dither.dither import Dither
from stiction_envs.experiments.rig import dither_arrays
from stiction_envs.friction.parameters import load_friction
from stiction_envs.measured.tables import AmplitudeRow, write_amplitudes
from stiction_envs.robots import load_arm

HERE = Path(__file__).parent
EXAMPLE = HERE.parents[1] / "examples" / "libfranka_dither"
COMPILER = shutil.which("g++") or shutil.which("clang++") or shutil.which("c++")
STRICT = ["-std=c++17", "-O2", "-Wall", "-Wextra", "-pedantic", "-Werror"]

pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C++ compiler: g++ or clang++")

TABLES = {
    "sine": [AmplitudeRow(7, 15.0, 0.8009660772725983), AmplitudeRow(4, 50.0, 2.0)],
    "square": [AmplitudeRow(j, 50.0 / j, 0.3 * j, "square") for j in range(1, 8)],
    "triangle": [AmplitudeRow(2, 33.3, 1.7, "triangle", 0.25)],
    "chirp": [AmplitudeRow(1, 20.0, 1.0, "chirp"), AmplitudeRow(6, 80.0, 0.5, "chirp", -0.1, 0.2)],
    "gated": [
        AmplitudeRow(1, 15.0, 1.0, "sine", 0.3, 0.05),
        AmplitudeRow(3, 30.0, 2.0, "triangle", -0.2, 1.5),
        AmplitudeRow(5, 80.0, 0.5, "square", 0.0, 0.4),
        AmplitudeRow(6, 0.0, 0.0, "sine", 0.4, 0.1),
    ],
}


def dither_of(rows, count: int) -> Dither:
    """Return the dither of an amplitude table on ``count`` simulations of seven joints."""
    arrays = dither_arrays(rows, 7).items()
    return Dither(**{name: np.tile(values, (count, 1)) for name, values in arrays})


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Path:
    """Folder with the three programs."""
    folder = tmp_path_factory.mktemp("built")
    include = [f"-I{EXAMPLE}", f"-I{HERE / 'stand_in'}"]
    sources = (HERE / "torques.cpp", HERE / "compensations.cpp", EXAMPLE / "main.cpp")
    running = [
        subprocess.Popen([COMPILER, *STRICT, *include, source, "-o", folder / source.stem])
        for source in sources
    ]
    assert not any(compiler.wait() for compiler in running)
    return folder


def table(path: Path, rows: list[AmplitudeRow]) -> Path:
    write_amplitudes(path, rows)
    return path


def torques(program: Path, path: Path, rows: np.ndarray) -> np.ndarray:
    """Return the torques (T, 7) that a program makes of a file and rows of numbers."""
    text = "\n".join(" ".join(map(repr, row)) for row in rows.tolist())
    ran = subprocess.run([program, path], input=text, capture_output=True, text=True, check=True)
    return np.fromstring(ran.stdout, sep=" ").reshape(-1, 7)


def compare(program: Path, path: Path, rows: list[AmplitudeRow]) -> None:
    """Torques of two minutes at the controller's rate, thinned out, and at any time and speed."""
    rng = np.random.default_rng(0)
    t = np.r_[np.arange(0, 120, 0.037), rng.uniform(0, 100, 2000)]
    dq = rng.normal(size=(len(t), 7)) * np.exp(rng.uniform(-5, 0.5, (len(t), 1)))
    got = torques(program, path, np.column_stack([t, dq]))
    expected = dither_of(rows, len(t)).torque(t, dq)
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", TABLES)
def test_torques_are_those_of_python(built: Path, tmp_path: Path, name: str) -> None:
    compare(built / "torques", table(tmp_path / "final.csv", TABLES[name]), TABLES[name])


HEADER = "joint,frequency_hz,amplitude_nm"
GAINS = "joint,kind,gain_nm"


@pytest.mark.parametrize(
    ("program", "text", "says"),
    [
        ("torques", "", "empty table"),
        ("torques", f"{HEADER},waveform\n7,15,1,random", "waveform is 'random': expected sine, sq"),
        ("torques", f"{HEADER}\n7,fast,1", "line 2: frequency_hz is 'fast'"),
        ("torques", f"{HEADER}\n7,15,-1", "no negative number"),
        ("torques", f"{HEADER}\n0,15,1", "joint: expected 1 to 7"),
        ("torques", f"{HEADER}\n7,15", "line 2: expected one value a column"),
        ("compensations", "joint,gain_nm\n1,1", "expected a column kind"),
        ("compensations", f"{GAINS}\n1,pull,1", "unknown kind 'pull'"),
        ("compensations", f"{GAINS},speed_rad_s\n1,feedforward,-1,1", "gain_nm: expected >= 0"),
        (
            *("compensations", f"{GAINS},rate_1_s,share\n1,momentum_observer,1,1,2"),
            "share: expected <= 1",
        ),
    ],
)
def test_bad_files_are_refused(built: Path, tmp_path: Path, program: str, text, says: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(f"{text}\n" if text else "")
    ran = subprocess.run([built / program, path], input="0", capture_output=True, text=True)
    assert (ran.returncode, ran.stdout) == (1, "")
    assert says in ran.stderr


def test_other_line_ends_and_orders_are_read(built: Path, tmp_path: Path) -> None:
    path = tmp_path / "final.csv"
    path.write_text("\r\namplitude_nm, joint ,gate_rad_s,frequency_hz\r\n 1.5 ,3,,20.0\r\n\r\n")
    compare(built / "torques", path, [AmplitudeRow(3, 20.0, 1.5)])


# ---- the main program ------------------------------------------------------------------------


def run_main(
    built: Path, *argv: object, enter: str = "\n", **robot: float
) -> tuple[subprocess.CompletedProcess[str], np.ndarray]:
    """Run the example; return its output, and the commanded t and torques (T, 8)."""
    ran = subprocess.run(
        [built / "main", *map(str, argv)],
        input=enter,
        capture_output=True,
        text=True,
        env={**os.environ, **{k: str(v) for k, v in robot.items()}},
    )
    rows = [x.split()[1:] for x in ran.stderr.splitlines() if x.startswith("tau")]
    return ran, np.array(rows, float).reshape(-1, 8)


def test_main_shakes_softly_by_the_table(built: Path, tmp_path: Path) -> None:
    """A tenth of the table's dither, faded in and out; a packet may be lost."""
    rows = TABLES["gated"][:2] + TABLES["sine"][:1]
    ran, told = run_main(built, "fr3", table(tmp_path / "final.csv", rows), 4)
    assert ran.returncode == 0, ran.stderr
    t, tau = told[:, 0] / 1000, told[:, 1:]
    assert t[-1] == pytest.approx(4.0, abs=1.1e-3)  # milliseconds are summed up
    fade = 0.5 - 0.5 * np.cos(np.pi * np.clip(np.minimum(t, 4 - t), 0, 1))
    pure = dither_of(rows, len(t)).torque(t, np.zeros((len(t), 7)))
    np.testing.assert_allclose(tau, 0.1 * fade[:, None] * pure, atol=1e-9)
    assert not tau[0].any()
    assert np.abs(tau[-1]).max() < 1e-12


def test_main_keeps_the_rate(built: Path, tmp_path: Path) -> None:
    """A square jumps by twice 0.1 · 8 N·m: the command may change by 1 N·m a millisecond."""
    rows = [AmplitudeRow(2, 10.0, 8.0, "square")]
    ran, told = run_main(built, "fr3", table(tmp_path / "final.csv", rows), 4)
    assert ran.returncode == 0, ran.stderr
    steps = np.abs(np.diff(told[:, 1:], axis=0))
    assert steps.max() == pytest.approx(1.0, abs=1e-9)
    assert np.abs(told[:, 2]).max() == pytest.approx(0.8, rel=1e-6)


@pytest.mark.parametrize(
    ("robot", "says"),
    [({"DRIFT": 0.1}, "the arm drifts: stopped"), ({"SPEED": 0.6}, "too fast: stopped")],
)
def test_main_stops(built: Path, tmp_path: Path, robot: dict[str, float], says: str) -> None:
    ran, told = run_main(built, "fr3", table(tmp_path / "final.csv", TABLES["sine"]), 4, **robot)
    assert ran.returncode == 1
    assert says in ran.stderr
    assert len(told) < 1100


@pytest.mark.parametrize(
    ("rows", "argv", "says"),
    [
        ([AmplitudeRow(7, 15.0, 1.3)], [3], "joint 7: more than 1.2"),
        ([AmplitudeRow(1, 500.0, 1.0)], [3], "less than 500 Hz"),
        (TABLES["sine"], [1000], "more than 2 and at most 60"),
        (TABLES["sine"], [3, 3], "usage"),
    ],
)
def test_main_refuses(built: Path, tmp_path: Path, rows, argv, says: str) -> None:
    ran, told = run_main(built, "fr3", table(tmp_path / "final.csv", rows), *argv)
    assert ran.returncode == 1
    assert says in ran.stderr
    assert not len(told)


def test_main_moves_nothing_unasked(built: Path, tmp_path: Path) -> None:
    path = table(tmp_path / "final.csv", TABLES["sine"])
    for enter in ("", "q\n"):
        ran, told = run_main(built, "fr3", path, enter=enter)
        assert (ran.returncode, len(told)) == (1, 0)
        assert "not confirmed" in ran.stderr
    ran, told = run_main(built, "nowhere", path)
    assert (ran.returncode, ran.stderr) == (1, "robot: no connection\n")
    ran, told = run_main(built, "fr3", tmp_path / "none.csv")
    assert "none.csv: cannot be read" in ran.stderr


# ---- friction compensation ---------------------------------------------------------------------

DITHER = [AmplitudeRow(7, 15.0, 0.8009660772725983), AmplitudeRow(1, 30.0, 1.5, "triangle")]
NAMES = load_arm("panda").joint_names
UNITS = np.array([0.1, 0.1, 0.003, 20.0, 3.0, 0.003])
"""Scales of a joint's wanted and measured speed, error, gravity, torque and momentum."""


def friction_of(kind: str) -> Compensation:
    c = Compensation.from_friction(kind, load_friction("panda", 7), 0.9)
    numbers = {"load": 0.04} if kind == "push" else {}
    numbers |= {"damping": 1.7, "injection": 0.7} if "lugre" in kind else {}
    return c.replace(gain=(*c.gain[:3], 0.0, *c.gain[4:]), **numbers)


@pytest.mark.parametrize(("kind", "end"), [*((k, "csv") for k in LAWS), ("push", "yaml")])
def test_compensations_are_those_of_python(
    built: Path, tmp_path: Path, kind: str, end: str
) -> None:
    """Two seconds of everything a joint may see, observers with their memory."""
    c = friction_of(kind)
    write_treatment(tmp_path, DITHER, c, NAMES)
    path = tmp_path / ("final.yaml" if end == "yaml" else "compensation.csv")
    rng = np.random.default_rng(0)
    slow = np.cumsum(rng.normal(size=(2000, 7, 6)), axis=0) / 20
    seen = UNITS * (slow + 0.1 * rng.normal(size=slow.shape))
    seen[:50] = 0.0
    got = torques(built / "compensations", path, seen.reshape(2000, -1))
    packed, state = c.packed(), np.zeros((7, 1))
    expected = np.zeros((2000, 7))
    for k in range(2000):
        for j in range(7):
            if c.gain[j] > 0:
                expected[k, j] = LAWS[kind].torque(packed[j], seen[k, j], state[j], 1e-3)
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12)
    assert not got[:, 3].any()


def test_main_compensates_softly_within_limits(built: Path, tmp_path: Path) -> None:
    """A tenth of a push at an arm that creeps off, faded in and out, at the robot's rate.

    Springs pull it back, dampers brake.
    """
    c = Compensation(kind="push", gain=(1.0,) * 7, speed=(0.05,), error=(1e-4,), load=(0.0,))
    write_treatment(tmp_path, DITHER[:0], c, NAMES)
    ran, told = run_main(built, "fr3", tmp_path / "final.yaml", 4, DRIFT=0.01, SPEED=0.01)
    assert ran.returncode == 0, ran.stderr
    t, tau = told[:, 0] / 1000, told[:, 1:]
    off = -0.01 * t
    fade = 0.5 - 0.5 * np.cos(np.pi * np.clip(np.minimum(t, 4 - t), 0, 1))
    push = 0.1 * fade * np.tanh(off / 1e-4)
    k = t > 0.01
    np.testing.assert_allclose(tau[k, 2] - 600 * off[k], push[k], atol=0.02)
    assert tau[-1, 4] == pytest.approx(-30 * 0.01)
    assert np.abs(np.diff(tau, axis=0)).max() <= 1 + 1e-9


@pytest.mark.parametrize("name", ["final.yaml", "final.csv"])
def test_main_refuses_gains_beyond_its_limit(built: Path, tmp_path: Path, name: str) -> None:
    c = Compensation(kind="push", gain=(1.0,) * 6 + (1.3,))
    write_treatment(tmp_path, (), c, NAMES)
    ran, told = run_main(built, "fr3", tmp_path / name, 4)
    assert (ran.returncode, len(told)) == (1, 0)
    assert "joint 7: more than 1.2" in ran.stderr
