import math
import warnings
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import stiction_envs.measured as measured
from stiction_envs.measured.tables import (
    AmplitudeRow,
    BaseTable,
    SJERow,
    read_amplitudes,
    read_base,
    read_sje,
    write_amplitudes,
    write_sje,
)
from stiction_envs.measured.thesis_tables import thesis_base
from tests.measured.logs.bad_logs import put, refuses
from tests.refusal import refusal

THESIS = Path(measured.__file__).parent / "thesis"
SJE = "robot,joint,load,direction,frequency_hz,amplitude_nm,tau_nm,std_nm,iterations,reduction\n"
ROW = SJERow("panda", 3, "no_load", "-", 30.0, 0.7, -0.6, 0.01, 5, 0.1)


def random_sje(count: int) -> list[SJERow]:
    rng = np.random.default_rng(0)
    return [
        SJERow(
            robot=str(rng.choice(["panda", 'my "arm", v2.xml'])),
            joint=int(rng.integers(1, 8)),
            load=str(rng.choice(["load", "no_load"])),
            direction=str(rng.choice(["+", "-"])),
            frequency_hz=rng.uniform(1, 100),
            amplitude_nm=rng.uniform(0, 4),
            tau_nm=rng.normal() * 10.0 ** rng.integers(-12, 3),
            std_nm=rng.uniform(0, 1e-9),
            iterations=int(rng.integers(1, 20)),
            reduction=rng.normal(),
        )
        for _ in range(count)
    ]


def test_sje_round_trip_is_exact(tmp_path):
    rows = random_sje(200)
    write_sje(tmp_path / "sje.csv", rows)
    assert read_sje(tmp_path / "sje.csv") == rows
    text = (tmp_path / "sje.csv").read_text()
    assert text.startswith(SJE)
    write_sje(tmp_path / "again.csv", read_sje(tmp_path / "sje.csv"))
    assert (tmp_path / "again.csv").read_bytes() == (tmp_path / "sje.csv").read_bytes()


def test_other_line_ends_column_order_and_byte_order_mark(tmp_path):
    header = ",".join(reversed(SJE.strip().split(",")))
    text = f"{header}\r\n\r\n0.1 , 5,0.01,-0.6,0.7,30,-,no_load,3,panda\r\n"
    path = put(tmp_path / "a.csv", b"\xef\xbb\xbf" + text.encode())
    assert read_sje(path) == [ROW]


@pytest.mark.parametrize("optional", ["", ",waveform,offset_nm", ",waveform,offset_nm,gate_rad_s"])
def test_amplitudes_round_trip_is_exact(tmp_path, optional):
    rng = np.random.default_rng(1)
    rows = [AmplitudeRow(j, rng.uniform(1, 99), rng.uniform(0, 2)) for j in (7, 1, 4)]
    if optional:
        gate = 0.1 / 3 if "gate" in optional else 0.0
        rows.append(AmplitudeRow(2, 15.1, 0.3, "random", -0.1 / 3, gate))
    write_amplitudes(tmp_path / "final.csv", rows)
    assert read_amplitudes(tmp_path / "final.csv", n_joints=7) == rows
    header = (tmp_path / "final.csv").read_text().splitlines()[0]
    assert header == "joint,frequency_hz,amplitude_nm" + optional


@pytest.mark.parametrize("empty", ["", "0"])
def test_a_gate_of_nothing_is_no_gate(tmp_path, empty):
    head = "joint,frequency_hz,amplitude_nm,gate_rad_s\n"
    path = put(tmp_path / "a.csv", f"{head}7,15,0.8,{empty}\n3,15,0.8,0.05\n")
    open_, gated = read_amplitudes(path, n_joints=7)
    assert open_.gate_velocity == math.inf
    assert gated.gate_velocity == 0.05


HEAD = "joint,frequency_hz,amplitude_nm\n"


def test_not_a_file(tmp_path):
    for path in (tmp_path, tmp_path / "none.csv"):
        refuses(lambda path=path: read_sje(path), r"directory.*expected")


def test_frequencies_at_which_a_held_command_misleads_warn(tmp_path):
    path = put(tmp_path / "a.csv", HEAD + "1,99,0.5\n2,100,0.5\n3,200,0.5\n")
    with pytest.warns(UserWarning, match="200 Hz controller") as caught:
        read_amplitudes(path, n_joints=7, controller_rate_hz=200)
    assert [str(w.message).split(": ")[0] for w in caught] == [f"{path}, line {i}" for i in (3, 4)]
    assert "Nyquist" in str(caught[0].message)
    assert "constant offset" in str(caught[1].message)
    assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_amplitudes(path, n_joints=7, controller_rate_hz=1000)
        read_amplitudes(path, n_joints=7)


def test_write_amplitudes_writes_nothing_it_could_not_read(tmp_path):
    good = AmplitudeRow(1, 15.0, 0.5)
    for bad in (good, AmplitudeRow(2, 0.0, 0.5), AmplitudeRow(2, 15.0, 0.5, gate_rad_s=math.nan)):
        refusal(lambda bad=bad: write_amplitudes(tmp_path / "a.csv", [good, bad]), "expected")
    assert not list(tmp_path.iterdir())


def test_half_sums_are_those_of_the_reference():
    """sources.md 1.6: half-width and offset of table 4.3, loaded pose, rounded to 1 mN·m."""
    panda = thesis_base("panda")
    friction = [0.700, 2.106, 0.996, 1.095, 0.597, 0.432, 0.652]
    offset = [-0.129, -1.026, -0.341, 0.569, -0.126, 0.038, -0.018]
    # 0.6 mN·m: a half-sum that ends on 5 may be rounded either way.
    np.testing.assert_allclose(panda.friction[:, 0], friction, atol=6e-4)
    np.testing.assert_allclose(panda.offset[:, 0], offset, atol=6e-4)
    assert (panda.robot, panda.n_joints) == ("panda", 7)
    assert panda.tau[1, 0, 1] == -3.132
    assert thesis_base("iiwa").tau[0, 1, 0] == 1.072


def base_rows() -> list[SJERow]:
    tau = thesis_base("panda").tau
    return [
        SJERow("panda", j + 1, load, sign, 0.0, 0.0, tau[j, k, d], 0.02, 5, 0.0)
        for j in range(7)
        for k, load in enumerate(("load", "no_load"))
        for d, sign in enumerate("+-")
    ]


def test_base_from_our_own_table(tmp_path):
    """Rows with dither and other robots are left out; order does not matter."""
    rows = base_rows()[::-1]
    write_sje(tmp_path / "base.csv", rows)
    assert read_base(tmp_path / "base.csv").tau.tobytes() == thesis_base("panda").tau.tobytes()
    write_sje(tmp_path / "sje.csv", [ROW, *rows, replace(rows[0], robot="iiwa7")])
    table = read_base(tmp_path / "sje.csv", "panda")
    assert table.tau.tobytes() == thesis_base("panda").tau.tobytes()
    says = "robots with base torques are"
    refuses(lambda: read_base(tmp_path / "sje.csv"), f"{says} panda, iiwa7")
    write_sje(tmp_path / "sje.csv", [ROW])
    refuses(lambda: read_base(tmp_path / "sje.csv"), f"{says} none")


PRINTED = (THESIS / "table_4_3.csv").read_text()
PANDA = "panda,5,no_load,-,-0.506"
WIDE = "joint,frequency_hz,amplitude_nm,waveform,offset_nm\n"
KNOWN = {"n_joints": 7, "torque_limit": [87] * 4 + [12] * 3, "controller_rate_hz": 200}
READERS = {
    "sje.csv": read_sje,
    "final.csv": partial(read_amplitudes, **KNOWN),
    "base.csv": partial(read_base, robot="panda"),
}
BAD = {
    "sje.csv": {
        "line 2.*load 'up'.*load, no_load": SJE + "panda,3,up,-,30,0.7,-0.6,0.01,5,0.1\n",
        "iterations is 0": SJE + "panda,1,load,-,30,0.7,-0.6,0.01,0,0.1\n",
        "tau_nm is 'nan'.*finite": SJE + "panda,1,load,-,30,0.7,nan,0.01,5,0.1\n",
        "frequency_hz is 0.0.*> 0": SJE + "panda,1,load,-,0,0.7,-0.6,0.01,5,0.1\n",
        "robot is empty": SJE + ",1,load,-,30,0.7,-0.6,0.01,5,0.1\n",
    },
    "final.csv": {
        "missing column 'amplitude_nm'.*joint,freq": "joint,frequency_hz\n1,2\n",
        "column 'f'.*waveform,off": "joint,frequency_hz,amplitude_nm,f\n1,2,3,4\n",
        "repeated column": "joint,joint,frequency_hz,amplitude_nm\n1,1,2,3\n",
        "line 3: frequency_hz is 'fast'.*number": HEAD + "1,15,0.5\n2,fast,0.5\n",
        "amplitude_nm is 'nan'.*finite": HEAD + "1,15,nan\n",
        "line 3: joint 1 occurs twice": HEAD + "1,15,0.5\n1,15,0.5\n",
        "joint is 8.*1 to 7": HEAD + "8,15,0.5\n",
        "amplitude_nm is -0.5.*>= 0": HEAD + "1,15,-0.5\n",
        "amplitude_nm is 12.5.*joint 7, 12 N·m": HEAD + "7,15,12.5\n",
        r"\|offset_nm\| is 13.*12 N·m": WIDE + "7,15,11,sine,-2\n",
        "frequency_hz is 0.0.*> 0": HEAD + "1,0,0.5\n",
        "line 2: .*201 Hz.*at most 200 Hz": HEAD + "1,201,0.5\n",
        "waveform 'saw'.*sine, square": WIDE + "1,15,0.5,saw,0\n",
        "empty file.*joint,frequency_hz,amplitude_nm": "",
        "byte 37 is not UTF-8": HEAD.encode() + b"1,15,\xff\n",
        "line 2: 2 values": HEAD + "1,15\n",
        "expected comma-separated text": HEAD + '1,15,"0.5\n',
    },
    "base.csv": {
        "27 of 28 base torques of panda: joint 5, no_load - missing": PRINTED.replace(PANDA, ""),
        r"line 5\d: joint 5, no_load - occurs twice": PRINTED.replace(PANDA, f"{PANDA}\n{PANDA}"),
        r"line \d+: joint 5, no_load -: .* 0.506 N·m: .*< 0": (
            PRINTED.replace(PANDA, PANDA.replace("-0.", "0."))
        ),
        "tau_base_Nm is 'nan'": PRINTED.replace(PANDA, "panda,5,no_load,-,nan"),
        "direction 'x'": PRINTED.replace(PANDA, "panda,5,no_load,x,-1"),
    },
}


@pytest.mark.parametrize(("name", "says"), [(k, x) for k, texts in BAD.items() for x in texts])
def test_a_bad_table_is_one_clear_line(tmp_path, name, says):
    path = put(tmp_path / name, BAD[name][says])
    assert name in refuses(lambda: READERS[name](path), says)
    if name == "base.csv":
        assert read_base(path, "iiwa7").n_joints == 7, "the other robot's rows are sound"


def test_base_table_checks_its_array():
    refusal(lambda: BaseTable("panda", np.ones((7, 2))), r"shape \(7, 2\)")
    tau = thesis_base("panda").tau.copy()
    tau[2, 1, 0] = np.nan
    refusal(lambda: BaseTable("panda", tau), r"joint 3, no_load \+: base torque is nan")
    with pytest.raises(ValueError, match="read-only"):
        thesis_base("panda").tau[0, 0, 0] = 1
