"""The columns show torque table or joint log."""

import gzip

import pytest

from stiction_envs.measured.kinds import LOG, TABLE, file_kind
from stiction_envs.measured.tables import SJE_COLUMNS
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
    ],
)
def test_kind(tmp_path, name, text, kind):
    (tmp_path / name).write_text(text, encoding="utf-8")
    assert file_kind(tmp_path / name) == kind


def test_packed_missing_and_broken_files_are_left_to_their_reader(tmp_path):
    with gzip.open(tmp_path / "a.csv.gz", "wt") as file:
        file.write("t,q1,tau1\n")
    (tmp_path / "b.csv.gz").write_text("t,q1,tau1\n")
    for name in ("a.csv.gz", "b.csv.gz", "nowhere.csv"):
        assert file_kind(tmp_path / name) == LOG


def test_neither(tmp_path):
    (tmp_path / "a.csv").write_text("name,age\n")
    line = refusal(lambda: file_kind(tmp_path / "a.csv"), "neither a torque table nor a joint log")
    assert "expected robot,joint,load" in line
    assert "t,q1..qn with tau1..taun or q_cmd1..q_cmdn" in line
