"""Output folders, and the provenance that tells one run from another."""

import errno
import json
from importlib import metadata

import pytest

from stiction_envs.errors import StictionError
from stiction_envs.reporting import output_folder
from stiction_envs.reporting import provenance as provenance_module
from stiction_envs.reporting.output_folder import OutputFolder, check_file
from stiction_envs.reporting.provenance import git_commit, provenance, sha256, versions
from tests.refusal import refusal


def found(command: str = "sje", seed: int = 0, **arguments: object) -> dict:
    return provenance(command, {"joint": [7], **arguments}, seed=seed)


def test_identity_depends_on_the_content_of_inputs_and_not_on_their_place(tmp_path):
    hashes = []
    for name, text in (("a.csv", "1"), ("b.csv", "1"), ("a.csv", "2")):
        path = tmp_path / name
        path.write_text(text)
        made = provenance("sje", {"dither": path}, seed=0, inputs={"dither": path})
        hashes.append(made["arguments_sha256"])
    assert hashes[0] == hashes[1]
    assert hashes[0] != hashes[2]


def test_unfinished_run_is_resumed_by_itself_only(tmp_path):
    def half() -> None:
        with OutputFolder(tmp_path, found(), resumable=True):
            (tmp_path / "half.csv").write_text("1")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        half()
    assert OutputFolder(tmp_path, found(), resumable=True).resumed
    refusal(lambda: OutputFolder(tmp_path, found()), "a run of stiction sje")
    refusal(lambda: OutputFolder(tmp_path, found(seed=1), resumable=True), "or force")
    assert not OutputFolder(tmp_path, found(seed=1), resumable=True, force=True).resumed


def test_force_deletes_only_what_a_run_has_listed(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (tmp_path / "precious.txt").write_text("x")
    (out / "mine.txt").write_text("x")
    with OutputFolder(out, found(), force=True) as f:
        (f.path / "plots").mkdir()
        (f.path / "plots" / "a.png").write_text("x")
    text = json.loads((out / "provenance.json").read_text())
    assert text["files"] == ["plots/a.png"]
    text["files"].append("../precious.txt")
    (out / "provenance.json").write_text(json.dumps(text))
    with OutputFolder(out, found(), force=True):
        assert not (out / "plots").exists()
    assert (tmp_path / "precious.txt").exists()
    assert (out / "mine.txt").exists()


def test_commit_is_that_of_this_checkout_or_none(monkeypatch, tmp_path):
    commit = git_commit()
    assert commit is None or len(commit.removesuffix("-dirty")) == 40
    git_commit.cache_clear()
    # a package below somebody else's repository
    monkeypatch.setattr(provenance_module, "package_folder", lambda: tmp_path / "p")
    assert git_commit() is None
    git_commit.cache_clear()


def test_a_file_is_not_replaced_unless_forced(tmp_path):
    path = tmp_path / "friction.toml"
    check_file(path, ".toml", force=False)
    path.write_text("mine")
    refusal(lambda: check_file(path, ".toml", force=False), "or force")
    check_file(path, ".toml", force=True)
    for wrong in (tmp_path / "friction", tmp_path, tmp_path / "friction.csv"):
        with pytest.raises(StictionError, match=r"expected a path to a \.toml"):
            check_file(wrong, ".toml", force=True)


def test_what_a_killed_run_left_half_written_is_gone_when_it_goes_on(tmp_path):
    def killed():
        with OutputFolder(tmp_path, found(), resumable=True):
            (tmp_path / "base.csv").write_text("done")
            (tmp_path / "plots").mkdir()
            for name in (".scale.csv.123.part", "plots/.joint1.png.123.part"):
                (tmp_path / name).write_text("hal")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        killed()
    with OutputFolder(tmp_path, found(), resumable=True):
        pass
    assert not list(tmp_path.rglob(".*.part"))
    assert (tmp_path / "base.csv").read_text() == "done"


def test_a_process_that_is_refused_leaves_the_files_that_another_is_writing(tmp_path):
    with OutputFolder(tmp_path, found(), resumable=True):
        (tmp_path / "base.csv").write_text("done")
        part = tmp_path / ".scale.csv.123.part"
        part.write_text("hal")
        with (
            pytest.raises(StictionError, match="in use"),
            OutputFolder(tmp_path, found(), resumable=True),
        ):
            raise StictionError("in use")
        part.rename(tmp_path / "scale.csv")
    assert (tmp_path / "scale.csv").is_file()


def full(*_: object) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_on_a_full_disk_force_leaves_the_other_runs_files(tmp_path, monkeypatch):
    with OutputFolder(tmp_path, found()) as out:
        (out.path / "sje.csv").write_text("old")
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    with monkeypatch.context() as patched:
        patched.setattr(output_folder, "write_text_atomic", full)
        with pytest.raises(OSError, match="No space"), OutputFolder(tmp_path, found(), force=True):
            pass
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before
    with OutputFolder(tmp_path, found(seed=1), force=True):
        assert {p.name for p in tmp_path.iterdir()} == {output_folder.NAME}


def test_a_folder_that_cannot_be_begun_is_not_left(tmp_path, monkeypatch):
    monkeypatch.setattr(output_folder, "write_text_atomic", full)
    with pytest.raises(OSError, match="No space"), OutputFolder(tmp_path / "a", found()):
        pass
    assert list(tmp_path.iterdir()) == []


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
