"""Bad input: exit code 2, one line that names the matter, nothing written."""

import pytest

from stiction_envs.robots import load_arm
from tests.robots.arms import chain

HEADER = "joint,frequency_hz,amplitude_nm\n"
TOLD = "robot,joint,load,direction,frequency_hz,amplitude_nm,tau_nm\n"
LIMIT = load_arm("panda").limits.torque[6]

FILES = {
    "good.csv": HEADER + "7,15,0.1\n",
    "waveform.csv": HEADER.strip() + ",waveform\n7,15,0.1,sawtooth\n",
    "strong.csv": HEADER + f"7,15,{LIMIT + 0.1}\n",
    "strong_with_offset.csv": HEADER.strip() + f",offset_nm\n7,15,{LIMIT - 0.1},0.2\n",
    "fast.csv": HEADER + "7,1001,0.1\n",
    "fast_iiwa.csv": HEADER + "7,201,0.1\n",
    "column_missing.csv": "joint,frequency_hz\n7,15\n",
    "column_unknown.csv": "joint,frequency_hz,amplitude_nm,phase\n7,15,0.1,0\n",
    "text.csv": HEADER + "7,fast,0.1\n",
    "nan.csv": HEADER + "7,15,nan\n",
    "twice.csv": HEADER + "7,15,0.1\n7,30,0.1\n",
    "ragged.csv": HEADER + "7,15\n",
    "joint8.csv": HEADER + "8,15,0.1\n",
    "negative.csv": HEADER + "7,15,-0.1\n",
    "standing.csv": HEADER + "7,0,0.1\n",
    "offset_only.csv": HEADER.strip() + ",offset_nm\n7,15,0,0.2\n6,15,0.1,0\n",
    "silent.csv": HEADER + "7,15,0\n",
    "header_only.csv": HEADER,
    "empty.csv": "",
    "binary.csv": b"\x89PNG\r\n\x1a\n\x00\xff\xfe",
    "base_short.csv": "robot,joint,load,direction,tau_base_Nm\npanda,1,load,+,0.5\n",
    "base_twice.csv": "robot,joint,load,direction,tau_base_Nm\n" + 2 * "panda,1,load,+,0.5\n",
    "base_sign.csv": "robot,joint,load,direction,tau_base_Nm\npanda,1,load,+,-0.5\n",
    "base_robot.csv": "robot,joint,load,direction,tau_base_Nm\nur5,1,load,+,0.5\n",
    "told_other.csv": f"{TOLD}iiwa7,1,load,+,15,0.5,0.7\n",
    "told_units.csv": f"{TOLD}panda,1,load,+,15,0.5,700\n",
    "told_rad.csv": f"{TOLD}panda,1,load,+,94.2,0.5,0.5\n",
    "told_nan.csv": f"{TOLD}panda,1,load,+,nan,0.5,0.5\n",
    "told_joint.csv": f"{TOLD}panda,8,load,+,15,0.5,0.5\n",
    "bounds_key.toml": "[all]\namplitude = [0, 1]\n",
    "bounds_band.toml": "[all]\nforbidden_hz = [[1, 400]]\n",
    "bounds_slow.toml": "[all]\nfrequency_hz = [5, 80]\n",
    "one.xml": chain(1),
    "ten.xml": chain(10),
    "two.xml": chain(2),
    "massless.xml": chain(3, mass="0"),
    "slide.xml": chain(3, kind="slide"),
    "broken.xml": "<mujoco><worldbody>",
    "prose.xml": "this is no XML",
    "prose.urdf": "this is no XML",
    "friction.toml": "[stiction]\nvalue = [1.0]\n",
    "no.toml": "[stiction",
}

SJE, TUNE = ["sje", "panda"], ["tune", "panda"]
ASK = [*TUNE, "--protocol", "search"]
CALIBRATE, EXPORT = ["calibrate", "panda"], ["export", "panda"]

BAD = {
    # what is asked for does not exist
    "no_command": ([], "COMMAND"),
    "command": (["dance"], "'dance'"),
    "robot": (["sje", "ur5"], "iiwa14, iiwa7, panda"),
    "robot_export": (["export", "ur5"], "iiwa14, iiwa7, panda"),
    "robot_tune": (["tune", "ur5"], "iiwa14, iiwa7, panda"),
    "robot_calibrate": (["calibrate", "ur5", "{good.csv}"], "iiwa14, iiwa7, panda"),
    "no_robot": (["sje"], "ROBOT"),
    "joint_0": ([*SJE, "--joint", 0], "whole numbers from 1"),
    "joint_8": ([*SJE, "--joint", 8], "1, 2, 3, 4, 5, 6, 7"),
    "joint_of_two": (["sje", "{two.xml}", "--joint", 3], "1, 2"),
    "joint_text": ([*SJE, "--joint", "elbow"], "'elbow'"),
    "load": ([*SJE, "--load", "heavy"], "no_load"),
    "direction": ([*SJE, "--direction", "up"], "'up'"),
    "option": ([*SJE, "--speed", 3], "--speed"),
    "option_cut_short": ([*SJE, "--iter", 3], "--iter"),
    "waveform": ([*SJE, "--dither", "{waveform.csv}"], "sine, square, triangle"),
    # dither that the robot cannot take
    "amplitude": ([*SJE, "--dither", "{strong.csv}"], "torque limit of joint 7"),
    "amplitude_offset": ([*SJE, "--dither", "{strong_with_offset.csv}"], "torque limit"),
    "frequency": ([*SJE, "--dither", "{fast.csv}"], "at most 1000 Hz"),
    "frequency_iiwa": (["sje", "iiwa7", "--dither", "{fast_iiwa.csv}"], "at most 200 Hz"),
    "frequency_slow_controller": (
        [*SJE, "--dither", "{good.csv}", "--controller-rate", 10],
        "at most 10 Hz",
    ),
    "dither_other_joint": ([*SJE, "--dither", "{good.csv}", "--joint", 1, 2], "tested are 1, 2"),
    "dither_silent": ([*SJE, "--dither", "{silent.csv}"], "no joint"),
    "dither_offset_only": ([*SJE, "--dither", "{offset_only.csv}"], "joint 7"),
    "tune_frequency": ([*TUNE, "--frequencies", 15, 1001], "at most 1000 Hz"),
    "tune_frequency_0": ([*TUNE, "--frequencies", 0], "above 0"),
    "tune_frequency_twice": ([*TUNE, "--frequencies", 15, 15], "once"),
    "ask_0": ([*ASK, "--ask", 0], "whole numbers from 1"),
    "ask_thesis": ([*TUNE, "--ask"], "--ask: not with --protocol thesis"),
    "ask_sampler": ([*ASK, "--ask", "--sampler", "gp"], "--sampler: not with --ask or --tell"),
    "tell_nothing": ([*ASK, "--tell", "nothing.csv"], "expected a readable CSV file"),
    "tell_amplitudes": ([*ASK, "--tell", "{good.csv}"], "missing column 'robot'"),
    "tell_other_robot": ([*ASK, "--tell", "{told_other.csv}"], "robot is 'iiwa7': expected panda"),
    "tell_millinewton": ([*ASK, "--tell", "{told_units.csv}"], "tau_nm is 700: expected up to"),
    "tell_rad_per_s": ([*ASK, "--tell", "{told_rad.csv}"], "expected 15 to 80 Hz"),
    "tell_nan": ([*ASK, "--tell", "{told_nan.csv}"], "frequency_hz is 'nan'"),
    "tell_joint_8": ([*ASK, "--tell", "{told_joint.csv}"], "from 1 to 7"),
    "ask_storage": ([*ASK, "--ask", "--storage", "mysql://me:secret@x"], "storage"),
    "tune_scale": ([*TUNE, "--scales", -1], "above 0"),
    # tables
    **{
        f"table_{name}": ([*SJE, "--dither", f"{{{name}.csv}}"], text)
        for name, text in {
            "column_missing": "amplitude_nm",
            "column_unknown": "'phase'",
            "text": "'fast'",
            "nan": "finite",
            "twice": "joint 7 occurs twice",
            "ragged": "2 values",
            "joint8": "1 to 7",
            "negative": ">= 0",
            "standing": "frequency_hz",
            "header_only": "no rows",
            "empty": "empty file",
            "binary": "UTF-8",
        }.items()
    },
    "table_missing": ([*SJE, "--dither", "nowhere.csv"], "nowhere.csv"),
    "table_folder": ([*SJE, "--dither", "."], "readable CSV"),
    **{
        f"base_{name}": ([*command, *where], text)
        for name, file, text in (
            ("short", "{base_short.csv}", "missing"),
            ("twice", "{base_twice.csv}", "twice"),
            ("sign", "{base_sign.csv}", "> 0"),
            ("robot", "{base_robot.csv}", "ur5"),
            ("columns", "{good.csv}", "missing column"),
            ("empty", "{empty.csv}", "empty"),
            ("binary", "{binary.csv}", "UTF-8"),
            ("gone", "nowhere.csv", "nowhere.csv"),
        )
        for command, where in ((CALIBRATE, [file]), (TUNE, ["--table", file]))
    },
    # arms
    "xml_one": (["sje", "{one.xml}"], "2 to 9"),
    "xml_ten": (["export", "{ten.xml}"], "2 to 9"),
    "xml_massless": (["sje", "{massless.xml}"], "no mass or inertia"),
    "xml_slide": (["sje", "{slide.xml}"], "slide"),
    "xml_broken": (["sje", "{broken.xml}"], "not a readable MJCF"),
    "xml_prose": (["export", "{prose.xml}"], "not a readable MJCF"),
    "urdf_prose": (["tune", "{prose.urdf}"], "not a readable MJCF"),
    "xml_gone": (["sje", "nowhere.xml"], "nowhere.xml: no such file"),
    "payload_nan": ([*SJE, "--payload", "nan", 0, 0, 0], "finite"),
    "payload_minus_inf": ([*SJE, "--payload", 1, 0, 0, "-inf"], "finite"),
    "payload_negative": ([*SJE, "--payload", -1, 0, 0, 0], "negative"),
    "payload_short": ([*SJE, "--payload", 1], "4 arguments"),
    "tilt_inf": ([*EXPORT, "--tilt", "inf", 0], "finite"),
    "tilt_nan": ([*TUNE, "--tilt", 0, "nan"], "finite"),
    "tilt_text": ([*SJE, "--tilt", 0, "steep"], "'steep'"),
    # numbers
    "iterations_negative": ([*SJE, "--iterations", -1], "whole numbers from 1"),
    "iterations_0": ([*TUNE, "--iterations", 0], "whole numbers from 1"),
    "iterations_half": ([*SJE, "--iterations", 1.5], "whole numbers from 1"),
    "seed_negative": ([*SJE, "--seed", -1], "whole numbers from 0"),
    "seed_text": ([*TUNE, "--seed", "x"], "whole numbers from 0"),
    "threads_negative": ([*SJE, "--threads", -2], "whole numbers from 0"),
    "slots_0": ([*SJE, "--slots", 0], "whole numbers from 1"),
    "rate_0": ([*SJE, "--controller-rate", 0], "above 0"),
    "rate_nan": ([*SJE, "--controller-rate", "nan"], "above 0"),
    "rate_not_a_divisor": ([*SJE, "--controller-rate", 300], "divisors of 1000"),
    "rate_too_high": ([*SJE, "--controller-rate", 2000], "divisors of 1000"),
    "lowpass": ([*SJE, "--lowpass", -1], "from 0"),
    "ramp_rate": ([*SJE, "--ramp-rate", -0.1], "above 0"),
    # friction
    "friction_gone": ([*SJE, "--friction", "nowhere.toml"], "nowhere.toml"),
    "friction_name": ([*SJE, "--friction", "panda"], ".toml"),
    "friction_table": ([*EXPORT, "--friction", "{friction.toml}"], "source"),
    "friction_no_toml": ([*SJE, "--friction", "{no.toml}"], "not TOML"),
    "from_gone": ([*EXPORT, "--from", "nowhere"], "model.toml nor friction.toml"),
    "from_and_friction": ([*EXPORT, "--from", ".", "--friction", "a.toml"], "one"),
    # search
    "sampler": ([*TUNE, "--sampler", "tpe"], "--sampler: not with --protocol thesis"),
    "sampler_unknown": ([*ASK, "--sampler", "luck"], "'luck'"),
    "objective": ([*ASK, "--objective", "speed"], "'speed'"),
    "scales": ([*ASK, "--scales", 1], "--scales: not with --protocol search"),
    "gates": ([*ASK, "--gates", "one"], "expected objective gte or both"),
    "compensation": ([*ASK, "--compensation", "push"], "expected objective gte or both"),
    "without_dither": ([*ASK, "--objective", "gte", "--without-dither"], "a compensation"),
    "pareto": ([*ASK, "--pareto", "--sampler", "gp"], "two objectives"),
    "waveforms": ([*ASK, "--search", "waveform", "--sampler", "cmaes"], "waveforms"),
    "evaluations": ([*ASK, "--evaluations", 0], "from 1"),
    "bounds_gone": ([*ASK, "--bounds", "nowhere.toml"], "nowhere.toml"),
    "bounds_key": ([*ASK, "--bounds", "{bounds_key.toml}"], "'amplitude'"),
    "bounds_empty": ([*ASK, "--bounds", "{bounds_band.toml}"], "leaves no frequency"),
    "bounds_slow": ([*ASK, "--objective", "gte", "--bounds", "{bounds_slow.toml}"], "15 Hz"),
    "limit_gone": ([*ASK, "--limit", "nowhere.csv"], "nowhere.csv"),
    "beside_strong": ([*ASK, "--beside", "{strong.csv}"], "torque limit"),
    "storage_form": ([*ASK, "--storage", "study.txt"], "study.txt"),
    "storage_away": (
        [*ASK, "--storage", "postgresql+psycopg://me:secret@127.0.0.1:1/none"],
        "storage postgresql+psycopg://me:***@127.0.0.1:1/none",
    ),
    "protocol": ([*TUNE, "--protocol", "mine"], "thesis"),
    # places to write
    "out_file": ([*SJE, "--out", "{good.csv}"], "is a file"),
    "out_below_file": ([*SJE, "--out", "{good.csv}/x"], "not a folder"),
    "out_toml": (["calibrate", "{two.xml}", "{base_two.csv}", "--out", "friction"], ".toml"),
    "out_exists": (["calibrate", "{two.xml}", "{base_two.csv}", "--out", "{no.toml}"], "or force"),
}

BASE_TWO = "robot,joint,load,direction,tau_base_Nm\n" + "".join(
    f"two,{j},{load},{d},{d}0.8\n" for j in (1, 2) for load in ("load", "no_load") for d in "+-"
)
FILES["base_two.csv"] = BASE_TWO


@pytest.mark.parametrize(("argv", "says"), BAD.values(), ids=BAD)
def test_bad_input(cli, work, inputs, argv, says):
    argv = list(map(str, argv))
    for name, content in FILES.items():
        if any(f"{{{name}}}" in a for a in argv):
            data = content if isinstance(content, bytes) else content.encode()
            (inputs / name).write_bytes(data)
            argv = [a.replace(f"{{{name}}}", str(inputs / name)) for a in argv]
    before = {p: p.read_bytes() for p in inputs.iterdir()}
    ran = cli(*argv)
    assert ran.code == 2
    assert len(ran.lines) == 1
    assert ran.lines[0].startswith("error: ")
    assert says in ran.lines[0]
    assert ran.out == ""
    assert list(work.iterdir()) == []
    assert {p: p.read_bytes() for p in inputs.iterdir()} == before


@pytest.mark.parametrize(
    ("robot", "frequency", "says"),
    [("iiwa7", 150, "aliases to 50 Hz"), ("iiwa7", 100, "Nyquist"), ("iiwa7", 200, "constant")],
)
def test_frequency_past_half_the_controller_rate_is_warned_of(cli, inputs, robot, frequency, says):
    table = inputs / "a.csv"
    table.write_text(f"{HEADER}7,{frequency},0.1\n")
    options = ["--joint", 7, "--load", "load", "--direction", "+", "--iterations", 1]
    ran = cli("sje", robot, "--dither", table, *options)
    assert ran.code == 0
    assert len(ran.lines) == 1
    assert ran.lines[0].startswith("warning: ")
    assert says in ran.lines[0]


@pytest.mark.parametrize("command", ["sje", "export", "tune"])
def test_output_folder_of_another_run(cli, work, command):
    (work / "out").mkdir()
    (work / "out" / "notes.txt").write_text("mine")
    ran = cli(command, "panda", "--out", "out")
    assert ran.code == 2
    assert len(ran.lines) == 1
    assert "or force" in ran.lines[0]
    assert [p.name for p in (work / "out").iterdir()] == ["notes.txt"]
