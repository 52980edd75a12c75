"""`excite` and `identify` with an arm whose file states all that MuJoCo lets a joint have.

MuJoCo's own inverse dynamics of the file, as the user wrote it, are the truth.
"""

from dataclasses import fields, replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from stiction_envs.gap.signals.dataset import assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.identification.excitation import Excitation, excite
from stiction_envs.identification.excitation_search import ExcitationProblem
from stiction_envs.identification.identify import Identification, identify
from stiction_envs.identification.settings import excitation_settings
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm, load_arm
from stiction_envs.robots.regressor import inertial_parameters
from stiction_envs.robots.stated import StatedJoints

ROTORS = np.array([0.25, 0.2 + 5.0**2 * 0.004, 0.05])  # [kg·m²]; joint b's motor has a gear
DAMPING = np.array([1.5, 0.8, 0.4])  # [N·m·s/rad]
DRY = np.array([2.0, 1.5, 0.6])  # [N·m]
SPRINGS, REST = np.array([0.0, 30.0, 6.0]), np.array([0.0, 0.4, -0.3])  # [N·m/rad], [rad]
RATE, NOISE = 200.0, 0.02  # [Hz], [N·m]
QUICK = replace(excitation_settings(), iterations=30, starts=1, randoms=6)

FILE = """<mujoco model="stated"><compiler angle="radian" autolimits="true"/>
<worldbody><body name="one" pos="0 0 0.3" gravcomp="0.6">
<joint name="a" axis="0 0 1" range="-2.5 2.5" armature="{rotor}" damping="1.5" frictionloss="2"/>
<geom type="capsule" fromto="0 0 0 0 0.06 0.1" size="0.05" mass="3"/>
<body name="two" pos="0 0 0.15">
<joint name="b" axis="0 1 0" range="-2 2" armature="0.2" damping="0.8" frictionloss="1.5"
 stiffness="30" springref="0.4"/>
<geom type="capsule" fromto="0 0 0 0.3 0.03 0" size="0.04" mass="2"/>
<body name="three" pos="0.3 0 0">
<joint name="c" axis="0 1 0" range="-2 2" armature="0.05" damping="0.4" frictionloss="0.6"
 stiffness="6" springref="-0.3"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0.04" size="0.03" mass="{tip}"/>
<body name="hand" pos="0.2 0 0" gravcomp="1"><geom size="0.04" pos="0.03 0.02 0" mass="0.5"/>
<site name="flange"/></body></body></body></body></worldbody>
<actuator><motor joint="a" ctrlrange="-60 60"/><motor joint="c" ctrlrange="-25 25"/>
<motor joint="b" gear="5" ctrlrange="-12 12" armature="0.004"/></actuator></mujoco>"""


def file_of(folder: Path, name: str, tip: float = 1.0, rotor: float = 0.25) -> Path:
    """Write the file, with a mass of the last link [kg] and a rotor of the first joint [kg·m²]."""
    path = folder / name
    path.write_text(FILE.format(tip=tip, rotor=rotor), "utf-8")
    return path


def inverse(path: Path, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Return (T, n) torque that a file's motors need, by MuJoCo, dry friction included [N·m]."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    model.opt.timestep, model.dof_solref[:] = 1e-4, (2e-4, 1)  # dry friction at once
    data, out = mujoco.MjData(model), np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], dq[k], ddq[k]
        mujoco.mj_inverse(model, data)
        out[k] = data.qfrc_inverse
    return out


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("stated")


@pytest.fixture(scope="module")
def true(folder: Path) -> Path:
    return file_of(folder, "true.xml")


@pytest.fixture(scope="module")
def motion(true: Path) -> Excitation:
    return excite(true, QUICK, seed=0)


@pytest.fixture(scope="module")
def log(true: Path, motion: Excitation) -> JointLog:
    t = motion.times(RATE)
    q, dq, ddq = motion.state(t)
    rng = np.random.default_rng(0)
    tau = inverse(true, q, dq, ddq) + NOISE * rng.normal(size=q.shape)
    return JointLog(source="made.csv", t=t, q=q + 1e-5 * rng.normal(size=q.shape), dq=None, tau=tau)


@pytest.fixture(scope="module")
def found(folder: Path, log: JointLog) -> Identification:
    """From a nominal file with a lighter tip and half of a rotor."""
    return identify([log], file_of(folder, "nominal.xml", tip=0.7, rotor=0.12))


def test_links_rotors_and_friction_are_found(found: Identification, true: Path):
    """True base parameters lie inside four standard errors; friction within a few per cent."""
    links = inertial_parameters(load_arm(true).pinocchio()).ravel()
    right = found.base.values(np.concatenate([links, ROTORS, DRY, DAMPING, np.zeros(3)]))
    assert (np.abs(found.values - right) < 4 * found.errors).all()
    np.testing.assert_allclose(found.coulomb, DRY, rtol=0.03)
    np.testing.assert_allclose(found.viscous, DAMPING, rtol=0.03)
    assert found.rotor is not None
    np.testing.assert_allclose(found.rotor, ROTORS, rtol=0.1)
    np.testing.assert_allclose(found.phi[2, 1], links[21], rtol=0.02)  # first moment of the tip
    assert (found.rms["consistent"] < 0.1).all()


def test_the_written_model_predicts_another_motion(
    found: Identification, true: Path, folder: Path, tmp_path: Path
):
    """The written file's torques by MuJoCo, with its springs and gravity compensation."""
    found.write(tmp_path)
    other = excite(true, QUICK, seed=9).state(np.arange(0, 10, 0.05))
    right = inverse(true, *other)
    left = inverse(tmp_path / "model.xml", *other) - right
    nominal = inverse(folder / "nominal.xml", *other) - right
    rms, before = (np.sqrt(np.mean(np.square(x), axis=0)) for x in (left, nominal))
    assert (rms < 0.1 * before).all()
    arm, stated = found.arm(), load_arm(tmp_path / "model.xml").stated
    for name in ("armature", "damping", "stiction", "stiffness", "springref"):
        np.testing.assert_allclose(getattr(stated, name), getattr(arm.stated, name), rtol=1e-9)


def test_behind_the_gear_the_model_keeps_the_rotors_of_the_file(log: JointLog, true: Path):
    found = identify([log], true, torque="link")
    assert found.rotor is None
    np.testing.assert_array_equal(found.arm().stated.armature, ROTORS)


def test_a_motion_keeps_the_torque_limits_with_all_that_the_file_states(
    true: Path, motion: Excitation
):
    state, limit = motion.state(motion.times(RATE)), np.array([60.0, 5 * 12.0, 25.0])
    tau, dq = inverse(true, *state), state[1]
    assert (np.abs(tau) <= limit).all()
    margin = (1 - QUICK.torque_part) * limit
    assert (DRY + DAMPING * np.abs(dq) < margin).all()  # the margin holds the friction
    moving = np.where(np.abs(dq) > 0.01, tau - DRY * np.sign(dq) - DAMPING * dq, 0.0)
    part = np.abs(moving).max(axis=0) / (QUICK.torque_part * limit)
    assert (part <= 1).all()
    assert motion.used["torque"] == pytest.approx(part.max(), rel=0.02)
    note = next(x for x in motion.notes if x.startswith("true: taken from the file: "))
    assert "left out: dry friction 2 1.5 0.6 N·m, damping" in note


def changed(arm: Arm, name: str) -> Arm:
    """Return an arm with another number of those that its file states."""
    if name == "gravcomp":
        return replace(arm, stated=replace(arm.stated, gravcomp={"hand": 0.5}))
    more = getattr(arm.stated, name) + np.array([0.0, 20.0, 0.0])
    return replace(arm, stated=replace(arm.stated, **{name: more}))


NUMBERS = [f.name for f in fields(StatedJoints) if f.name not in ("held", "changed", "left")]
MOST = ("coulomb", "stribeck", "bristle")
"""Further numbers of dry friction, which is named by its level at rest."""
SAID = {"stiction": "dry friction", "damping": "damping"}
"""Numbers that are left out: friction is fitted, and has the margin of the torque limits."""


def said(name: str, notes: tuple[str, ...]) -> bool:
    """Return whether notes say that a number of the file is left out."""
    left = next(x for x in notes if "taken from the file: " in x).partition("left out: ")[2]
    return SAID.get(name, "-") in left


@pytest.mark.parametrize("name", [x for x in NUMBERS if x not in MOST])
def test_excite_uses_every_stated_number_or_says_so(name: str, true: Path, motion: Excitation):
    arm, some = load_arm(true), motion.state(np.arange(0, 10, 0.5))
    one, two = (ExcitationProblem(x, QUICK) for x in (arm, changed(arm, name)))
    used = np.abs(one.torque(some) - two.torque(some)).max() > 1e-3
    assert used != said(name, motion.notes)


@pytest.mark.parametrize("name", [x for x in NUMBERS if x not in MOST])
def test_identify_uses_every_stated_number_or_says_so(
    name: str, true: Path, log: JointLog, found: Identification
):
    arm = load_arm(true)
    short = prepare([replace(log, **{k: getattr(log, k)[:800] for k in ("t", "q", "tau")})])
    one, two = (assemble(x, short, torque="motor") for x in (arm, changed(arm, name)))
    used = np.abs(one.nominal - two.nominal).max() > 1e-3
    assert used != said(name, found.notes)
