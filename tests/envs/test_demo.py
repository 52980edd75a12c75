"""The first minute: `python -m stiction_envs.envs.demo`."""

from __future__ import annotations

import sys

import pytest

from stiction_envs.envs import demo


@pytest.fixture(autouse=True)
def no_display(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    monkeypatch.setattr(demo, "has_display", lambda: False)
    monkeypatch.chdir(tmp_path)


@pytest.mark.slow
def test_an_episode_becomes_a_video(tmp_path, capsys):
    pytest.importorskip("imageio_ffmpeg")
    assert demo.main(["PandaSJE-v0", "--agent", "rule", "--seed", "3"]) == 0
    said = capsys.readouterr().out
    assert "agent rule, seed 3: return" in said
    assert "reduction: " in said
    video = tmp_path / "PandaSJE-v0-rule.mp4"
    assert video.read_bytes()[4:8] == b"ftyp"
    assert demo.main(["PandaSJE-v0", "--agent", "rule", "--seed", "3"]) == 2
    assert "is there already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["Panda-v0"], "unknown environment 'Panda-v0': expected one of IiwaGTE-v0"),
        (["PandaSJE-v0", "--seed", "-1"], "seed -1: expected a whole number from 0"),
        (["PandaSJE-v0", "--path", "3", "--out", "a.mp4"], "reset option 'path'"),
        (["PandaGTE-v0", "--out", "nowhere/a.mp4"], "nowhere: no such folder"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(arguments, words, capsys, tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    assert demo.main(arguments) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_an_unknown_agent_is_bad_usage(capsys):
    with pytest.raises(SystemExit) as left:
        demo.main(["PandaSJE-v0", "--agent", "clever"])
    assert left.value.code == 2
    assert "clever" in capsys.readouterr().err


def test_without_an_encoder_one_line_says_what_to_install(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    assert demo.main(["PandaSJE-v0"]) == 2
    assert "stiction-envs[video]" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
