"""MATLAB's files and NumPy's arrays as logs."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from stiction_envs.measured.logs.formats import mat
from stiction_envs.measured.logs.reader import drive_of
from tests.measured.logs.bad_logs import VALUES, assert_holds, put, refuses, torque_log

T, Q, DQ, TAU = np.split(VALUES, [1, 8, 15], axis=1)
LISTED = ("t", "q1..q7", "dq1..dq7", "tau1..tau7")


@pytest.mark.parametrize(
    ("content", "packed"),
    [
        ({"t": T, "q": Q, "dq": DQ, "tau": TAU}, False),
        ({"time": T[:, 0], "position": Q.T, "effort": TAU.T, "name": "a motion"}, True),
        ({"out": {"t": T, "q": Q, "tau": TAU, "note": {"who": "x"}}}, True),
    ],
    ids=["matrices", "rows", "structure"],
)
def test_version_5(tmp_path: Path, content: dict[str, object], packed: bool) -> None:
    savemat(tmp_path / "log.mat", content, do_compression=packed)
    assert drive_of(tmp_path / "log.mat") == "torque"
    assert_holds(torque_log(tmp_path / "log.mat"), VALUES, "t q tau")


def test_tables_without_names(tmp_path: Path) -> None:
    """One matrix of all columns: a person names them; so it is with numpy.save."""
    savemat(tmp_path / "log.mat", {"data": VALUES})
    np.save(tmp_path / "log.npy", VALUES)
    np.save(tmp_path / "new.npy", np.asfortranarray(VALUES))
    for name in ("log.mat", "log.npy", "new.npy"):
        assert_holds(torque_log(tmp_path / name, columns=LISTED), VALUES)
    log = torque_log(tmp_path / "log.npy", columns=("a", *LISTED[1:], "t=a"))
    assert_holds(log, VALUES)
    refuses(
        lambda: torque_log(tmp_path / "log.npy"), "22 columns without names: .* columns t q1..q6"
    )
    refuses(lambda: drive_of(tmp_path / "log.mat"), "neither torques .*columns OURS=NAME")


def hdf5(path: Path) -> Path:
    """Write as MATLAB's ``-v7.3``: HDF5 behind 512 bytes, matrices turned, text as numbers."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, x in {"log/t": T, "log/q": Q, "log/tau": TAU}.items():
            file[name] = x.T
        file["log/note"] = np.frombuffer(b"motion", np.uint8)[:, None].astype(np.uint16)
        file["log/note"].attrs["MATLAB_class"] = np.bytes_("char")
    return path


def test_version_7_3(tmp_path: Path) -> None:
    assert_holds(torque_log(hdf5(tmp_path / "log.mat")), VALUES, "t q tau")


def test_version_7_3_without_h5py(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = put(tmp_path / "log.mat", b"MATLAB 7.3".ljust(512) + mat.HDF5 + b"\0" * 600)
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ValueError, match=r"needs h5py: pip install 'stiction-envs\[mat\]'$"):
        torque_log(path)


def test_no_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    savemat(tmp_path / "text.mat", {"name": "x"})
    refuses(lambda: torque_log(tmp_path / "text.mat"), "no matrices of numbers: expected t, q, tau")
    refuses(lambda: torque_log(put(tmp_path / "log.mat", b"")), "damaged or no MATLAB file")
    np.save(tmp_path / "deep.npy", np.ones((3, 3, 3)))
    refuses(lambda: torque_log(tmp_path / "deep.npy"), r"shape \(3, 3, 3\): expected \(T, k\)")
    np.save(tmp_path / "object.npy", np.array([[None]]), allow_pickle=True)
    refuses(lambda: torque_log(tmp_path / "object.npy"), "no NumPy array: expected numbers")
    for packed, limit in ((False, "MOST_BYTES"), (True, "MOST_VALUES")):
        savemat(tmp_path / "log.mat", {"t": T}, do_compression=packed)
        with monkeypatch.context() as patch:
            patch.setattr(mat, limit, 100)
            refuses(lambda: torque_log(tmp_path / "log.mat"), "over 0 MiB: expected a shorter log")
