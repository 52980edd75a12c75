"""Friction parameters: reading, writing, checking, and the numbers that ship."""

import tomllib
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stiction_envs.errors import StictionError
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import (
    QUANTITIES,
    FrictionParameters,
    check_stability,
    dump_friction,
    from_table,
    load_friction,
    scaled,
)
from stiction_envs.measured.thesis_tables import thesis_base
from stiction_envs.plant import Plant
from tests.friction.gyro import friction, gyro, sticking
from tests.refusal import refusal

SHIPPED = ("panda", "iiwa7", "iiwa14", "generic")
JOINTS = {"panda": 7, "iiwa7": 7, "iiwa14": 7, "generic": 9}


def shipped_table(name: str) -> dict:
    text = files("stiction_envs.friction").joinpath(f"{name}.toml").read_text("utf-8")
    return tomllib.loads(text)


def random_parameters(seed: int, n: int = 7) -> FrictionParameters:
    rng = np.random.default_rng(seed)
    values = {}
    for name, quantity in QUANTITIES.items():
        high = min(quantity.high, 1e4)
        low = max(quantity.low, -1e4)
        shape = (n, 2) if quantity.by_direction else (n,)
        values[name] = rng.uniform(low, high, shape)
    values["joint_stiffness"][::2] = np.inf
    values["load_high"][1] = np.inf
    values["stiction"][2] = values["stiction"][2, 0]
    return FrictionParameters(**values)


def test_round_trip_is_exact(tmp_path):
    """Every float comes back with the same bits; direction pairs too."""
    before = random_parameters(0)
    path = tmp_path / "arm.toml"
    text = dump_friction(
        before,
        sources={k: 'assumed: "quoted" \\ back' if k == "offset" else "a test" for k in QUANTITIES},
        meta={"robot": 'an "arm" \\ two'},
        provenance={"method": "none"},
    )
    path.write_text(text, encoding="utf-8")
    after = load_friction(path)
    for name in QUANTITIES:
        assert getattr(after, name).tobytes() == getattr(before, name).tobytes(), name
    table = tomllib.loads(text)
    assert table["meta"]["robot"] == 'an "arm" \\ two'
    assert table["offset"]["source"] == 'assumed: "quoted" \\ back'
    assert table["offset"]["assumed"] is True
    assert "assumed" not in table["stiction"]
    assert all(table[name]["unit"] == quantity.unit for name, quantity in QUANTITIES.items())


def test_scaled_quantities_of_one_arm_and_of_many():
    one = load_friction("panda")
    factor = np.linspace(0.5, 2.0, 7)
    out = scaled(one, {"stiction": factor, "rotor_inertia": 1.5})
    assert np.array_equal(out.stiction, one.stiction * factor[:, None]), "both directions alike"
    assert np.array_equal(out.rotor_inertia, 1.5 * one.rotor_inertia)
    assert np.array_equal(out.viscous, one.viscous)
    each = np.stack([factor, np.ones(7)])
    many = scaled(one.tile(2), {"stiction": each})
    assert np.array_equal(many.stiction[0], out.stiction)
    assert np.array_equal(many.stiction[1], one.stiction)
    says = "friction parameter 'mass': expected one of stiction"
    refusal(lambda: scaled(one, {"mass": 2.0}), says)
    refusal(lambda: scaled(one, {"stiction": -1.0}), "stiction is -")
    says = r"factor of viscous has shape \(2, 7\): expected"
    refusal(lambda: scaled(one, {"viscous": each}), says)


def test_defaults_and_spreading():
    """A scalar goes to every joint, a per-joint value to both directions."""
    table = {
        "stiction": {"value": [[0.5, 0.7], [1.0, 1.0]], "source": "t"},
        "coulomb_ratio": {"value": 0.8, "source": "t"},
        "stribeck_velocity": {"value": [0.01, 0.02], "source": "t"},
        "viscous": {"value": 0, "assumed": True},
        "bristle_stiffness": {"value": 900, "source": "t"},
        "rotor_inertia": {"value": 0.1, "source": "t"},
    }
    p = from_table(table, "here", 2)
    assert p.stribeck_velocity.tolist() == [[0.01, 0.01], [0.02, 0.02]]
    assert p.bristle_stiffness.tolist() == [900.0, 900.0]
    assert p.stiction[0].tolist() == [0.5, 0.7]
    assert p.asymmetric
    assert not p.elastic.any()
    assert p.warm_up_time.tolist() == [1200.0, 1200.0]
    assert p.bristle_damping_ratio.tolist() == [0.4, 0.4]
    assert p.joint_damping_ratio.tolist() == [0.15, 0.15]
    for name in (
        *("load_coefficient", "ripple_amplitude", "warm_up_friction", "warm_up_viscous"),
        *("offset", "gravity_error"),
    ):
        assert not getattr(p, name).any(), name


def with_entry(name: str, entry: object) -> dict:
    return shipped_table("panda") | {name: entry}


@pytest.mark.parametrize(
    ("table", "says"),
    [
        (with_entry("stictoin", {"value": 1, "source": "t"}), "unknown table .stictoin."),
        (with_entry("stiction", {"value": [1.0] * 7}), "stiction. needs value and source"),
        (with_entry("stiction", {"source": "t"}), "stiction. needs value and source"),
        (with_entry("stiction", [1, 2]), "stiction. needs value and source"),
        (with_entry("stiction", {"value": "a", "source": "t"}), "value is a .*: expected"),
        (with_entry("stiction", {"value": [1, [2]], "source": "t"}), "value is a .*: expected"),
        (with_entry("stiction", {"value": [1.0] * 6, "source": "t"}), r"shape \(6, 1\).*\(7, 2\)"),
        (with_entry("rotor_inertia", {"value": [[1, 1]] * 7, "source": "t"}), r"shape \(7, 2\)"),
        (with_entry("stiction", {"value": 0.0, "source": "t"}), "is 0: expected .* from 1e-06 N·m"),
        (with_entry("stiction", {"value": float("nan"), "source": "t"}), "is nan: expected"),
        (with_entry("coulomb_ratio", {"value": 1.01, "source": "t"}), r"numbers from 0.001 to 1$"),
        (with_entry("ripple_amplitude", {"value": -0.5, "source": "t"}), "amplitude is -0.5"),
        ({k: v for k, v in shipped_table("panda").items() if k != "stiction"}, "stiction. is miss"),
    ],
)  # fmt: skip
def test_bad_tables_say_what_and_where(table, says):
    assert "my.toml" in refusal(lambda: from_table(table, "my.toml", 7), says)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "no such file"),
        (b"[stiction\n", "not a TOML file"),
        (b"[stiction]\nvalue = " + b"9" * 5000, "not a TOML file"),
        (b"\xff\xfe", "not a TOML file"),
    ],
)
def test_bad_files(content, says, tmp_path):
    path = tmp_path / "arm.toml"
    if content is not None:
        path.write_bytes(content)
    assert "arm.toml" in refusal(lambda: load_friction(path), says)


def test_a_bristle_that_would_chatter_is_refused():
    """h σ1 < 2 J, joint by joint; an inertia of zero fails as well."""
    check_stability(np.array([10.0]), np.array([1.0]), 1e-3)
    for damping, inertia in (([10.0, 20.0], [0.01, 0.01]), ([10.0, 1.0], [1.0, 0.0])):
        numbers = np.array(damping), np.array(inertia)
        refusal(lambda x=numbers: check_stability(*x, 1e-3), r"joint 2: h.damping = 0.0")


def test_model_too_stiff_for_its_step_is_refused():
    """σ1 never falls under 3hσ0 by itself, but hσ1/J can reach 2: the build says so."""
    stiff = {"bristle_stiffness": 1e5, "rotor_inertia": 0.01}
    refusal(lambda: sticking(**stiff), r"joint 2: h.damping")
    assert sticking(timestep=1e-4, **stiff).n == 2


def test_plant_checks_every_simulation():
    """One chattering simulation among others is found wherever it is, and nothing is written."""
    plant = Plant(sticking(), 3, threads=1)
    before = plant.stiction.copy()
    ratio = np.full((3, 2), 0.1)
    ratio[2, 0] = 50.0
    mixed = friction(stiction=0.9).tile(3).replace(bristle_damping_ratio=ratio)
    refusal(lambda: plant.set_friction(np.arange(3), mixed), r"joint 1: .* twice the inertia")
    elastic = friction(joint_stiffness=1e4).tile(3)
    refusal(lambda: plant.set_friction(np.arange(3), elastic), "elastic")
    plant.run(np.zeros((3, 40, 2)))
    np.testing.assert_array_equal(plant.stiction, before)


@pytest.mark.parametrize("elastic", [False, True])
def test_plant_with_parameters_is_the_model_built_with_them(elastic):
    """Friction given per simulation, its rotor included, is the friction of a model of its own."""
    springs = [{"joint_stiffness": [k, np.inf]} if elastic else {} for k in (8e3, 4e3)]
    other = springs[1] | {
        "rotor_inertia": [0.3, 0.2],
        "bristle_stiffness": 600.0,
        "bristle_damping_ratio": 0.7,
        "stiction": [0.5, 0.7],
        "viscous": [0.3, 0.1],
        "joint_damping_ratio": 0.05,
        "ripple_amplitude": 0.05,
        "ripple_periods": 40.0,
    }
    t = np.arange(1500) * 1e-3
    torque = (0.8 * t + 0.4 * np.sin(2 * np.pi * 20 * t))[None, :, None] * np.array([1.0, -1.0])
    given = Plant(sticking(**springs[0]), 1, parameters=friction(**other), threads=1).run(torque)
    built = Plant(sticking(**other), 1, threads=1).run(torque)
    assert np.abs(built[0, -1]).min() > 0.05
    np.testing.assert_allclose(given, built, rtol=0, atol=1e-9)


@pytest.mark.parametrize("timestep", [0.0, -1e-3, 2e-3, np.nan])
def test_step_must_be_a_millisecond_or_less(timestep):
    refusal(lambda: build(gyro(), friction(), timestep=timestep), "timestep")


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_number_has_a_source(name):
    table = shipped_table(name)
    assert set(table) == set(QUANTITIES) | {"meta", "provenance"}
    for quantity in QUANTITIES:
        entry = table[quantity]
        assert entry["unit"] == QUANTITIES[quantity].unit
        assert entry["source"].strip()
        assumed = entry["source"].startswith("assumed")
        assert entry.get("assumed", False) is assumed, f"{name}: {quantity}"


@pytest.mark.parametrize("name", ["panda", "iiwa7"])
def test_shipped_stiction_lies_under_the_measured_half_width(name):
    """The SJE's half-width is F_s plus the slide to 0.15 rad: F_s is less, but most of it."""
    p, measured = load_friction(name), thesis_base(name).friction
    for k, load in enumerate((p.load_high, p.load_low)):
        share = p.stiction_at(load).mean(axis=1) / measured[:, k]
        assert np.all((share > 0.4) & (share < 1.0)), f"{name}: {share}"


ODD = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from([1e308, -1e308, 1e-308, 5e-324, 0.0, -1.0, float("inf"), 10**400]),
)


@given(name=st.sampled_from(sorted(QUANTITIES)), value=ODD)
def test_what_is_read_is_a_size_that_a_joint_can_have(name, value):
    """Read as it is, with a square that is a number, or refused in a line with file and name."""
    quantity = QUANTITIES[name]
    try:
        found = from_table(with_entry(name, {"value": value, "source": "t"}), "odd.toml", 7)
    except StictionError as error:
        line = str(error)
        assert "\n" not in line
        assert line.startswith("odd.toml: ")
        assert name in line
        good = quantity.low <= value <= quantity.high and abs(value) <= 1e5
        assert not good, "an ordinary number is refused"
        return
    read = getattr(found, name)
    np.testing.assert_array_equal(read, float(value))
    endless = quantity.default == np.inf
    assert np.isfinite(read**2).all() or (endless and value == np.inf)
