"""The columns show torque table or joint log."""

import gzip

import pytest

from stiction_envs.measured.kinds import LOG, TABLE, file_kind
from stiction_envs.measured.tables import SJE_COLUMNS
from tests.measured.logs.bad_logs import put
from tests.refusal import refusal

SJE = ",".join(SJE_COLUMNS)


@pytest.mark.parametrize(
    ("name", "text", "kind"),
    [
        ("a.csv", SJE + "\n", TABLE),
        ("a.csv", "\n\ufeff" + SJE + "\n", TABLE),
        ("a.csv", SJE.replace(",std_nm", "") + "\n", TABLE),
        ("a.csv", "robot,joint,load,direction,tau_base_Nm\n", TABLE),
        ("a.csv", "joint,frequency_hz,amplitude_nm,waveform\n", TABLE),
        ("a.csv", "t,q1,q2,tau1,tau2\n", LOG),
        ("a.csv", " q1 , tau1\n", LOG),
        ("a.csv", "t,dq1\n", LOG),
        ("a.CSV", "", LOG),
        ("a.npz", "no archive", LOG),
        ("a.parquet", "no table", LOG),
        ("a.dat", "a,b\n", LOG),
        ("a.csv.gz", gzip.compress(b"t,q1,tau1\n", mtime=0), LOG),
        ("a.csv.gz", "t,q1,tau1\n", LOG),
    ],
)
def test_kind(tmp_path, name, text, kind):
    assert file_kind(put(tmp_path / name, text)) == kind


def test_a_missing_file_is_left_to_its_reader(tmp_path):
    assert file_kind(tmp_path / "nowhere.csv") == LOG


def test_neither(tmp_path):
    (tmp_path / "a.csv").write_text("name,age\n")
    line = refusal(lambda: file_kind(tmp_path / "a.csv"), "neither a torque table nor a joint log")
    assert "expected robot,joint,load" in line
    assert "t,q1..qn with tau1..taun or q_cmd1..q_cmdn" in line
