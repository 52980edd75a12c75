"""A two-joint arm and a fast ramp, the whole protocol in seconds; a real PostgreSQL."""

import itertools
from pathlib import Path

import optuna
import psycopg
import pytest

from stiction_envs.experiments.sje.protocol import Protocol, load_protocol
from stiction_envs.robots import Arm, load_arm
from tests.robots.arms import chain
from tests.tuning.study.postgres import Server
from tuning.study.storage import open_storage

NUMBERS = itertools.count()
"""Names of databases."""


def small(folder: Path) -> tuple[Arm, Protocol]:
    """Return the arm, its file in a folder, and the protocol."""
    path = folder / "small.xml"
    path.write_text(chain(2))
    protocol = load_protocol("small").replace(ramp_rate=2.0, iterations=2, return_time=0.2)
    return load_arm(path), protocol


@pytest.fixture(autouse=True)
def quiet() -> None:
    optuna.logging.set_verbosity(optuna.logging.ERROR)


@pytest.fixture
def small_arm(tmp_path: Path) -> Arm:
    return small(tmp_path)[0]


@pytest.fixture
def fast(tmp_path: Path) -> Protocol:
    return small(tmp_path)[1]


@pytest.fixture(scope="module")
def server():
    """A real PostgreSQL."""
    found = Server()
    yield found
    found.close()


@pytest.fixture
def new_database(server):
    """Makes empty databases, with Optuna's tables; returns their URLs."""

    def make(tables=True):
        name = f"study{next(NUMBERS)}"
        url = server.url().replace("+psycopg", "")
        with psycopg.connect(url, autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}")
        if tables:
            open_storage(server.url(name=name))
        return server.url(name=name)

    return make


@pytest.fixture
def database(new_database):
    return new_database()
