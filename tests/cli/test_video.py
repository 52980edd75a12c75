"""``--video`` of ``sje`` and ``gte``: an mp4 more, and nothing else changes."""

from __future__ import annotations

import json
import sys

import pytest

from stiction_envs.envs.render import arm_scene
from stiction_envs.envs.render import video as videos
from stiction_envs.experiments.gte import experiment
from tests.envs.helpers import sprint

SJE = ["sje", "panda", "--joint", 7, "--load", "load", "--direction", "+", "--iterations", 1]
GTE = ["gte", "panda", "--trajectory", "triangle", "--stiffness", 400, 40, 0, "--iterations", 1]


@pytest.fixture(autouse=True)
def few_frames(monkeypatch):
    pytest.importorskip("imageio_ffmpeg")
    monkeypatch.setattr(videos, "LONGEST", 0.2)
    monkeypatch.setattr(experiment, "MotionLimits", sprint)


@pytest.fixture
def written(monkeypatch):
    """Videos without OpenGL."""
    written = []

    def write(video, path, progress):
        written.append(video)
        path.write_bytes(b"mp4")
        progress(1, 1)

    monkeypatch.setattr(videos.Video, "write", write)
    monkeypatch.setattr(videos, "check_video", lambda: None)
    return written


@pytest.mark.slow
@pytest.mark.parametrize("command", [SJE, GTE], ids=["sje", "gte"])
def test_results_are_the_same_bytes_with_and_without(cli, work, written, dither, command):
    command = [*command, "--dither", dither, "--seed", 3]
    assert cli(*command, "--out", "a").code == 0
    ran = cli(*command, "--out", "b", "--video", "--json")
    assert ran.code == 0
    name = f"{command[0]}.mp4"
    result = json.loads(ran.out)
    assert result["video"] == f"b/{name}"
    assert len(written) == 1
    a, b = ({p.name: p.read_bytes() for p in (work / k).iterdir()} for k in "ab")
    assert b.keys() - a.keys() == {name}
    assert all(a[k] == b[k] for k in a.keys() - {"provenance.json"})
    before, after = (json.loads(x["provenance.json"]) for x in (a, b))
    assert name in after["files"]
    assert before["arguments_sha256"] == after["arguments_sha256"]


def test_no_encoder_is_said_before_the_work(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    assert "pip install 'stiction-envs[video]'" in refused(*SJE, "--out", "a", "--video")


def test_no_opengl_is_said_before_the_work(refused, monkeypatch):
    def none(name):
        raise RuntimeError("no libEGL")

    monkeypatch.setattr(arm_scene, "_context_class", none)
    assert "rendering needs OpenGL" in refused(*GTE, "--out", "a", "--video")


@pytest.mark.slow
@pytest.mark.parametrize("command", [SJE, GTE], ids=["sje", "gte"])
def test_it_is_an_mp4(cli, work, dither, command):
    ran = cli(*command, "--dither", dither, "--out", "a", "--video")
    if ran.code == 2:
        pytest.skip(ran.lines[0])
    assert ran.code == 0
    assert (work / "a" / f"{command[0]}.mp4").read_bytes()[4:8] == b"ftyp"
