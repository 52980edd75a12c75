"""final.yaml: the numbers of final.csv to the bit, in the layout that ROS 2 loads."""

from dataclasses import asdict

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stiction_envs.measured.tables import AmplitudeRow, read_amplitudes, write_final
from stiction_envs.robots import load_arm
from tests.measured.logs.bad_logs import put
from tests.refusal import refusal

NAMES = load_arm("panda").joint_names
ROWS = [
    AmplitudeRow(7, 15.0, 0.8009660772725983),
    AmplitudeRow(2, 1 / 3, 1e-7, "square", -0.1, 0.05),
    AmplitudeRow(4, 0.0, 0.0),
]
POSITIVE = st.floats(min_value=5e-324, max_value=1e300)


def parameters(folder):
    tree = yaml.safe_load((folder / "final.yaml").read_text())
    assert list(tree) == ["/**"]
    assert list(tree["/**"]) == ["ros__parameters"]
    return tree["/**"]["ros__parameters"]["dither"]


def test_the_layout(tmp_path):
    """A map a joint, in the order of the table; what ROS 2 takes for a double is one."""
    write_final(tmp_path, ROWS, NAMES)
    dither = parameters(tmp_path)
    assert list(dither) == ["joints", "joint7", "joint2", "joint4"]
    assert dither.pop("joints") == ["joint7", "joint2", "joint4"]
    assert dither["joint7"] == asdict(ROWS[0])
    for of in dither.values():
        assert {k: type(v) for k, v in of.items()} == {
            "joint": int,
            "frequency_hz": float,
            "amplitude_nm": float,
            "waveform": str,
            "offset_nm": float,
            "gate_rad_s": float,
        }
    assert not list(tmp_path.glob(".*"))


@settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    rows=st.lists(
        st.builds(
            AmplitudeRow,
            joint=st.integers(1, 7),
            frequency_hz=POSITIVE,
            amplitude_nm=POSITIVE,
            waveform=st.sampled_from(["sine", "square", "triangle", "chirp", "random"]),
            offset_nm=st.floats(-1e300, 1e300),
            gate_rad_s=st.just(0.0) | POSITIVE,
        ),
        min_size=1,
        unique_by=lambda r: r.joint,
    )
)
def test_csv_and_yaml_say_the_same_to_the_bit(tmp_path, rows):
    write_final(tmp_path, rows, NAMES)
    dither = parameters(tmp_path)
    read = [AmplitudeRow(**dither[name]) for name in dither["joints"]]
    assert read == read_amplitudes(tmp_path / "final.csv", n_joints=7) == rows
    assert read_amplitudes(tmp_path / "final.yaml", n_joints=7) == rows


def test_a_node_may_have_a_name_and_others_parameters(tmp_path):
    write_final(tmp_path, ROWS, NAMES)
    path = tmp_path / "final.yaml"
    text = path.read_text().replace("/**", "arm_controller")
    path.write_text(text + "gripper:\n  ros__parameters: {joints: [a]}\n")
    assert read_amplitudes(path, n_joints=7) == ROWS


ROW = "{joint: 7, frequency_hz: 15.0, amplitude_nm: 0.1%s}"
ONE = f"/**: {{ros__parameters: {{dither: {{joints: [j7], j7: {ROW}}}}}}}"
BAD = {
    "empty": ("", "0 nodes with dither: expected a parameter file of ROS 2"),
    "no yaml": ("a: [1", r"line 1: no YAML: expected"),
    "object": ("!!python/object/apply:os.system [ls]", "no YAML"),
    "two nodes": (f"{ONE % ''}\nb: {{ros__parameters: {{dither: {{}}}}}}", "2 nodes"),
    "no list": ("/**: {ros__parameters: {dither: {joints: j7}}}", "dither: no list of joints"),
    "not there": ((ONE % "").replace("[j7]", "[j6]"), r"dither\.j6: missing: expected joint"),
    "unknown key": (ONE % ", phase: 1.0", r"dither\.j7: unknown column 'phase'"),
    "no amplitude": ((ONE % "").replace("amplitude_nm", "a"), "missing column 'amplitude_nm'"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_one_clear_line(tmp_path, name):
    text, says = BAD[name]
    path = put(tmp_path / "dither.yaml", text)
    assert str(path) in refusal(lambda: read_amplitudes(path, n_joints=7), says)
