"""Storages that cannot be opened say so in one line, without the password, and stay as they are."""

import dataclasses
import socket
import sys
import time

import pytest
from sqlalchemy import event
from sqlalchemy.engine import Engine

from stiction_envs.errors import ExperimentError
from tests.refusal import refusal
from tests.tuning.study.searches import evaluate, search, trials
from tuning.settings import tuning_settings
from tuning.study.record import run
from tuning.study.storage import open_storage

SECRET = "gr4vel"


def refused(storage, settings=None):
    said = refusal(lambda: open_storage(storage, settings))
    assert SECRET not in said
    return said


@pytest.mark.parametrize(
    ("storage", "message"),
    [
        ("study.txt", "expected a URL such as sqlite:///study.db"),
        (f"postgresql://tuner:p@{SECRET}@host/name", "more than one @ in the URL"),
        (f"nix://tuner:{SECRET}@host/name", "unknown kind: expected sqlite or postgresql"),
        (f"postgresql://tuner:{SECRET}@127.0.0.1:1/name", "cannot be opened: Connection refused"),
        (f"postgresql://tuner@127.0.0.1:1/name?password={SECRET}", "tuner@127.0.0.1:1/name: cann"),
        ("sqlite:////nowhere/study.db", "cannot be opened: unable to open database file"),
    ],
)
def test_what_cannot_be_opened(storage, message):
    assert message in refused(storage)


def test_a_host_that_says_nothing_is_given_up():
    settings = tuning_settings().shared
    assert settings.connect_s <= 10
    quick = settings.__class__(**{**vars(settings), "connect_s": 2.0})
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        began = time.monotonic()
        said = refused(f"postgresql://tuner:{SECRET}@127.0.0.1:{port}/name", quick)
    assert "timeout" in said
    assert time.monotonic() - began < 5


def test_without_the_driver_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "psycopg", None)
    said = refused(f"postgresql+psycopg://tuner:{SECRET}@host/name")
    assert said.endswith("needs psycopg: pip install 'stiction-envs[postgres]'")


def test_a_file_that_is_no_database_stays(tmp_path):
    file = tmp_path / "study.db"
    file.write_text("robot,joint\n" * 100)
    assert "file is not a database" in refused(f"sqlite:///{file}")
    assert file.read_text() == "robot,joint\n" * 100


@pytest.mark.slow
def test_a_full_database_says_so_and_goes_on_with_room(tmp_path):
    """SQLite's own refusal; written trials stay, the rest comes when there is room."""
    storage = f"sqlite:///{tmp_path}/study.db"
    whole = search(f"sqlite:///{tmp_path}/whole.db", "random")
    one = search(storage, "random")

    def no_room(_, cursor, *__):
        if cursor.connection.execute("SELECT count(*) FROM trials").fetchone()[0] >= 4:
            # an allocation of a page is refused; a trial's attributes soon need one
            cursor.connection.execute("PRAGMA max_page_count=1")

    def long(settings):
        return [
            dataclasses.replace(o, measures={**o.measures, "text": 2000 * "x"})
            for o in evaluate(settings)
        ]

    run([whole], long)
    event.listen(Engine, "before_cursor_execute", no_room)
    try:
        with pytest.raises(ExperimentError) as caught:
            run([one], long)
    finally:
        event.remove(Engine, "before_cursor_execute", no_room)
    assert str(caught.value) == f"storage {storage}: database or disk is full"
    written = trials(one.record)
    assert written
    assert written == trials(whole.record)[: len(written)] != trials(whole.record)
    again = search(storage, "random")
    run([again], long)
    assert trials(again.record) == trials(whole.record)
