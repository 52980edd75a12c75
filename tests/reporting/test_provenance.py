"""Hashes of what a run was made from."""

from __future__ import annotations

from importlib import metadata

from stiction_envs.reporting.provenance import sha256, versions


def test_hash_of_a_folder_is_that_of_names_and_contents(tmp_path):
    """A bag of ROS 2 is a folder: another byte, another name or another file is another input."""
    found = set()
    for names, data in (("ab", b"x"), ("ab", b"y"), ("ac", b"x"), ("abc", b"x")):
        folder = tmp_path / f"{names}{data!r}"
        folder.mkdir()
        for name in names:
            (folder / name).write_bytes(data)
        found.add(sha256(folder))
    assert len(found) == 4
    again = tmp_path / "again"
    again.mkdir()
    for name in "ba":
        (again / name).write_bytes(b"x")
    assert sha256(again) in found


def test_versions_name_every_package_that_takes_part():
    found = versions()
    assert {"numpy", "optuna", "mujoco"} <= set(found)
    for name in ("cmaes", "numba", "scikit-learn", "torch"):
        try:
            assert found[name] == metadata.version(name)
        except metadata.PackageNotFoundError:
            assert name not in found
