"""The store: exact, never stale, and never in the way."""

from pathlib import Path

import numpy as np
import pytest

from stiction_envs.precomputed import store
from tests.command_line import python

NUMBERS = {"a": 0.1 + 0.2, "b": [[5e-324, -0.0], [1e300, 1 / 3]], "c": [True, False], "d": 7}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, and a process that knows nothing."""
    monkeypatch.setenv("STICTION_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(store, "_memory", {})
    return tmp_path / "cache"


# ---- digest --------------------------------------------------------------------------------------


def test_what_differs_in_one_bit_has_another_digest():
    array = np.array([0.1, 0.2])
    others = [
        *(array, np.nextafter(array, 1), array[None], array.astype(np.float32), [0.1, 0.2]),
        *(0.1, np.nextafter(0.1, 1), "0.1", 0.0, -0.0, 0, False, None, "", b"", np.inf, -np.inf),
        *([], [[]], [[], []], [1, [2]], [[1], 2], ["ab", "c"], ["a", "bc"], {"a": 1}, {"b": 1}),
    ]
    assert len({store.digest(x) for x in others}) == len(others)


def test_content_without_a_digest_is_refused():
    with pytest.raises(TypeError):
        store.digest(object())


# ---- what is kept --------------------------------------------------------------------------------


def test_what_is_found_later_is_added(folder):
    store.keep("numbers", "key", {"a": 1.0})
    store.forget()
    store.recall("numbers", "key")
    store.keep("numbers", "key", {"b": 2.0})
    store.forget()
    assert store.recall("numbers", "key") == {"a": 1.0, "b": 2.0}
    assert len(list(folder.iterdir())) == 1


def test_other_code_and_another_engine_make_it_anew(folder, monkeypatch):
    def known() -> bool:
        store.forget()
        return bool(store.recall("numbers", "key"))

    store.keep("numbers", "key", NUMBERS)
    assert known()
    with monkeypatch.context() as other:
        other.setattr(store.mujoco, "__version__", "4.999")
        assert not known()
    with monkeypatch.context() as other:
        other.setattr(store, "code_digest", lambda: "other code")
        assert not known()
        store.keep("numbers", "key", {"a": 1.0})
    assert not known(), "the other code's result replaced this one's"
    assert not list(folder.iterdir()), "files of old code do not pile up"


def test_all_code_that_makes_a_result_counts():
    code = (
        "import sys, tests.envs.make_precomputed\n"
        "print(*(m for m in sys.modules if m.startswith('stiction_envs.')))"
    )
    ran = python(code)
    rooms = {name.split(".")[1] for name in ran.stdout.split()}
    counted = {name.removesuffix(".py") for name in store.MADE_BY}
    assert rooms - counted == {"arrays", "envs", "errors", "reporting", "version"} & rooms
    assert counted <= rooms


# ---- what goes wrong -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "damage", [lambda b: b[: len(b) // 2], lambda b: b.replace(b'"', b"\xff")], ids=["cut", "bytes"]
)
def test_damaged_lines_are_made_anew(folder, damage):
    store.keep("numbers", "key", NUMBERS)
    (path,) = folder.iterdir()
    path.write_bytes(damage(path.read_bytes()))
    store.forget()
    left = store.recall("numbers", "key")
    assert left.items() < NUMBERS.items()
    store.keep("numbers", "key", {k: v for k, v in NUMBERS.items() if k not in left})
    store.forget()
    assert store.recall("numbers", "key") == NUMBERS


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("STICTION_CACHE", str(tmp_path / "file" / "cache"))
    monkeypatch.setattr(store, "_memory", {})
    store.keep("numbers", "key", NUMBERS)
    assert store.recall("numbers", "key") == NUMBERS, "known to this process all the same"
    store.forget()
    assert store.recall("numbers", "key") == {}


def test_where_the_cache_is(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("STICTION_CACHE", raising=False)
    for base in (None, "", "relative/path"):
        monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
        if base is not None:
            monkeypatch.setenv("XDG_CACHE_HOME", base)
        assert store.cache_folder() == tmp_path / ".cache" / "stiction-envs"
    monkeypatch.setenv("XDG_CACHE_HOME", "/var/mine")
    assert store.cache_folder() == Path("/var/mine/stiction-envs")
    monkeypatch.setenv("STICTION_CACHE", "~/own")
    assert store.cache_folder() == tmp_path / "own"
