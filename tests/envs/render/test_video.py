"""Videos of the experiments show what was measured."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.envs.render.env_frames import HEIGHT, WIDTH, Renderer
from stiction_envs.envs.render.gte_frames import gte_video
from stiction_envs.envs.render.sje_frames import sje_video
from stiction_envs.envs.render.video import LONGEST, Video, check_video, write_frames
from stiction_envs.errors import ExperimentError, StictionError
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import Case
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job
from stiction_envs.measured import AmplitudeRow
from tests.envs.helpers import sprint

WHERE = Configuration(7, "load", "+")


@pytest.fixture
def shown(monkeypatch):
    """Record the states of which pictures are drawn, in order, without OpenGL."""
    states = []

    def picture(self, state):
        states.append(state)
        return np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)

    monkeypatch.setattr(Renderer, "picture", picture)
    return states


def bars(count=20):
    """Yield frames that need no OpenGL."""
    for k in range(count):
        out = np.zeros((48, 64, 3), dtype=np.uint8)
        out[:, : 3 * k] = 255
        yield out


def test_a_short_video_is_in_real_time_and_a_long_one_fits():
    short = Video(runs=[], duration=9.6, close=bars).times()
    assert len(short) == 97 + 10
    assert short[1] == 0.1
    assert short[96] == short[-1] == 9.6
    long = Video(runs=[], duration=44.0, close=bars).times()
    assert long[1] == pytest.approx(0.3)
    assert long[-1] >= 44.0
    assert len(long) <= LONGEST * 10 + 1 + 10


def test_a_ramp_is_the_measurement(shown):
    """The first configuration with dither, undithered first, from rest to the torque that freed."""
    experiment = SingleJointExperiment("panda")
    jobs = [Job(Configuration(7, "load", "-")), Job(WHERE), Job(WHERE, 15.0, 0.8)]
    other, *both = sorted(
        experiment.run(jobs, iterations=1),
        key=lambda m: (m.job.configuration.direction == "+", m.job.amplitude_nm),
    )
    video = sje_video(experiment, [both[1], other, both[0]])
    assert video.size == (2 * WIDTH, HEIGHT)
    for draw, m in zip(video.runs, both, strict=True):
        draw(0.0)
        draw(0.5 * len(m.traces[0]) * m.trace_dt)
        draw(1e3)
        start, half, end = shown[-3:]
        assert start.trace.time == []
        assert half.trace.time == end.trace.time[: len(half.trace.time)]
        assert not half.over
        assert end.over
        assert end.tau == m.tau[0]
        assert end.base == both[0].tau[0]
        assert end.trace.torque[-1] == pytest.approx(m.tau[0], abs=0.04), "the reading has noise"
        moved = end.position - experiment.poses.q[6, 0]
        assert moved[6] == pytest.approx(m.traces[0][-1])
        assert not moved[:6].any()
        assert end.trace.displacement[-1] >= 0.98 * experiment.protocol.threshold
        assert set(end.trace.amplitude) == {m.job.amplitude_nm}
    assert [m.job.amplitude_nm for m in both] == [0.0, 0.8]


def test_a_path_is_the_first_iteration_bit_for_bit(shown):
    experiment = GeneratedTrajectoryExperiment("panda", motion=sprint())
    case = Case(trajectory="triangle", stiffness=(400.0, 40.0, 0.0))
    dither = (AmplitudeRow(7, 15.0, 0.8),)
    cases = [case, Case(trajectory="triangle", stiffness=case.stiffness, dither=dither)]
    video = gte_video(experiment, cases)
    measured = experiment.run(cases, iterations=2)
    for draw, run in zip(video.runs, measured, strict=True):
        for t in (0.0, 0.35, 1e3):
            draw(t)
            state = shown[-1]
            k = len(state.time)
            assert np.array_equal(state.error, run.error[0, :k])
            assert np.array_equal(state.trail, run.actual[0, :k, :3])
            assert state.reached == np.sum(run.reached[0] <= t)
        assert state.reached == len(state.path) - 1
    assert [state.amplitude[6] for state in (shown[0], shown[-1])] == [0.0, 0.8]


def test_frames_become_an_mp4_that_plays(tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    write_frames(bars(), tmp_path / "a.mp4", size=(64, 48))
    assert [p.name for p in tmp_path.iterdir()] == ["a.mp4"]
    reader = ffmpeg.read_frames(str(tmp_path / "a.mp4"))
    about = next(reader)
    assert about["size"] == (64, 48)
    assert about["fps"] == 10
    frames = [np.frombuffer(f, np.uint8).reshape(48, 64, 3) for f in reader]
    assert len(frames) == 20
    assert frames[15][24, 20].min() > 200
    assert frames[15][24, 60].max() < 50


def test_a_failing_encoder_is_one_line_and_leaves_what_was_there(tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "a.mp4"
    path.write_text("before")
    with pytest.raises(ExperimentError, match=r"a\.mp4: the encoder failed: "):
        write_frames(bars(), path, size=(64, -2))
    assert path.read_text() == "before"
    assert [p.name for p in tmp_path.iterdir()] == ["a.mp4"]


def test_no_ffmpeg_is_said_before_the_work(monkeypatch):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")

    def none():
        raise RuntimeError("No ffmpeg exe could be found.\nInstall ffmpeg")

    monkeypatch.setattr(ffmpeg, "get_ffmpeg_exe", none)
    with pytest.raises(StictionError, match=r"a video needs ffmpeg: No ffmpeg exe .* Install"):
        check_video()
