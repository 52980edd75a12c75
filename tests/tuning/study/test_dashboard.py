"""optuna-dashboard opens a study as it is."""

from __future__ import annotations

import io
import json
import time

import optuna
import pytest

from tests.tuning.study.searches import evaluate, search
from tuning.study.record import run
from tuning.study.storage import open_storage


@pytest.fixture(autouse=True)
def quiet():
    optuna.logging.set_verbosity(optuna.logging.ERROR)


def get(app, path):
    """Return what a web server would send for a path."""
    path, _, query = path.partition("?")
    heads = []
    environment = {
        "REQUEST_METHOD": "GET",
        "PATH_INFO": path,
        "QUERY_STRING": query,
        "SERVER_NAME": "localhost",
        "SERVER_PORT": "80",
        "wsgi.url_scheme": "http",
        "wsgi.input": io.BytesIO(),
        "wsgi.errors": io.StringIO(),
    }
    body = b"".join(app(environment, lambda status, headers, error=None: heads.append(status)))
    assert heads == ["200 OK"], body
    return body


def test_the_dashboard_shows_studies_and_trials(tmp_path):
    from optuna_dashboard import wsgi

    place = f"sqlite:///{tmp_path}/study.db"
    searches = [search(place, name, evaluations=6) for name in ("random", "tpe")]
    run(searches, evaluate)
    storage = open_storage(place)
    app = wsgi(storage)
    assert b"<html" in get(app, "/dashboard").lower()
    studies = json.loads(get(app, "/api/studies"))["study_summaries"]
    assert {s["study_name"] for s in studies} == {"small-random", "small-tpe"}
    (tpe,) = [s for s in studies if s["study_name"] == "small-tpe"]
    assert {"key": "robot", "value": "small"} in tpe["user_attrs"]
    path = f"/api/studies/{tpe['study_id']}?after=0"
    found = json.loads(get(app, path))
    for _ in range(50):  # trials are read by a thread of its own
        if len(found["trials"]) == 6:
            break
        time.sleep(0.1)
        found = json.loads(get(app, path))
    shown = {t["number"]: t for t in found["trials"]}
    for t in searches[1].record.trials:
        one = shown[t.number]
        assert one["state"] == t.state.name.capitalize()
        assert {p["name"]: float(p["param_external_value"]) for p in one["params"]} == t.params
        assert one.get("values") == t.values
        assert one["constraints"] == t.user_attrs["constraints"]
