"""Films of the experiments show what was measured."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.envs.render.arm_scene import ArmScene
from stiction_envs.envs.render.dial import Dial
from stiction_envs.envs.render.film import (
    HEADER,
    WIDTH,
    Timing,
    check_film,
    write_film,
    write_frames,
)
from stiction_envs.envs.render.path_film import PathFilm
from stiction_envs.envs.render.ramp_film import Ramp, RampFilm, shown
from stiction_envs.errors import ExperimentError, StictionError
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import Case
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job
from stiction_envs.measured import AmplitudeRow
from stiction_envs.robots import load_arm
from tests.envs.helpers import sprint
from tests.envs.render.conftest import blue, orange

WHERE = Configuration(7, "load", "+")


@pytest.fixture(scope="module")
def measured():
    """An experiment, and its measurements without and with dither."""
    experiment = SingleJointExperiment("panda")
    found = experiment.run([Job(WHERE), Job(WHERE, 15.0, 0.8)], iterations=2)
    return experiment, sorted(found, key=lambda m: m.job.amplitude_nm)


@pytest.fixture
def posed(monkeypatch):
    """Joint angles of every arm that is drawn."""
    seen, pose = [], ArmScene.pose

    def noted(self, q):
        seen.append(np.array(q))
        pose(self, q)

    monkeypatch.setattr(ArmScene, "pose", noted)
    return seen


# ---- timing --------------------------------------------------------------------------------------


def test_a_short_film_is_in_real_time_and_a_long_one_fits():
    short = Timing(9.6, fps=10, longest=15)
    times = list(short.times())
    assert short.speed == 1
    assert not short.caption
    assert len(times) == short.count == 97 + 10
    assert times[1] == 0.1
    assert times[-1] == times[96] == 9.6
    long = Timing(44.0, fps=10, longest=15)
    assert long.speed == 3
    assert long.caption.strip() == "(shown ×3)"
    assert max(long.times()) >= 44.0
    assert long.count <= 15 * 10 + 1 + 10


# ---- the ramp ------------------------------------------------------------------------------------


def test_a_ramp_is_the_measurement(measured):
    experiment, (base, dithered) = measured
    rate, dt = experiment.protocol.ramp_rate, base.trace_dt
    for m in (base, dithered):
        for k in range(2):
            r = Ramp.of(m, rate, k)
            assert r.tau == m.tau[k]
            assert len(r.time) == len(r.torque) == len(r.angle) == len(m.traces[k])
            assert abs(r.tau - r.torque[-1]) < rate * dt + 0.03, "the reading has noise"
            assert abs(r.angle[0]) < 0.02
            assert r.angle[-1] >= 0.98 * experiment.protocol.threshold
    assert Ramp.of(base, rate).title == "no dither"
    assert Ramp.of(dithered, rate).title == "dither 15 Hz, 0.8 N·m"


def test_what_is_shown_is_the_first_with_dither(measured):
    _, (base, dithered) = measured
    assert shown([dithered, base]) == [base, dithered]
    assert shown([base]) == [base]


@pytest.mark.usefixtures("gl")
def test_frames_of_a_ramp(measured, posed):
    experiment, both = measured
    film = RampFilm(experiment, both, fps=0.3)
    frames = list(film.frames())
    for drawn, m in zip(posed[-2:], both, strict=True):
        moved = drawn - experiment.poses.q[6, 0]
        assert moved[6] == pytest.approx(m.traces[0][-1] - m.start[0])
        assert not moved[:6].any()
    assert len(frames) == film.timing.count
    assert film.size == (2 * WIDTH, frames[0].shape[0])
    assert all(f.shape == frames[0].shape and f.dtype == np.uint8 for f in frames)
    scenes = [f[HEADER : HEADER + film.SCENE] for f in frames]
    seen = np.array([[orange(x).sum() for x in np.hsplit(scene, 2)] for scene in scenes])
    assert np.all(seen[0] > 100), "the pointer"
    assert np.all(seen[-1] > 1.5 * seen[0]), "it has turned"
    base, dithered = seen[len(seen) // 2]
    assert dithered > 1.3 * base, "dither goes first"
    assert not np.array_equal(frames[0][:HEADER], frames[-1][:HEADER])


def test_a_film_of_two_configurations_is_refused(measured):
    experiment, (base, _) = measured
    other = next(experiment.run([Job(Configuration(7, "load", "-"))], iterations=1))
    with pytest.raises(StictionError, match="expected measurements of one"):
        RampFilm(experiment, [base, other])


@pytest.mark.parametrize("joint", range(7))
def test_a_dial_is_in_view_and_faces_the_camera(joint):
    scene = ArmScene(load_arm("panda"), 480, 300)
    scene.pose(scene.arm.rest)
    dial = Dial(scene, joint)
    a, e = np.deg2rad(dial.camera.azimuth), np.deg2rad(dial.camera.elevation)
    view = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    assert abs(view @ scene.data.xaxis[scene.joints[joint]]) > 0.4
    eye = dial.camera.lookat - dial.camera.distance * view
    pointer = np.array([dial._at(0.0, s) for s in (0.5, 0.75, 1.0)])
    assert dial._share_seen(pointer, eye) == 1.0
    half_of_view = np.deg2rad(scene.model.vis.global_.fovy / 2)
    rays = pointer - eye
    off = np.arccos(rays @ view / np.linalg.norm(rays, axis=1))
    assert (off < half_of_view).all()


# ---- the path ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def path_film():
    experiment = GeneratedTrajectoryExperiment("panda", motion=sprint())
    case = Case(trajectory="triangle", stiffness=(400.0, 40.0, 0.0))
    dithered = Case(
        trajectory="triangle", stiffness=case.stiffness, dither=(AmplitudeRow(7, 15.0, 0.8),)
    )
    cases = [case, dithered]
    return experiment, cases, PathFilm(experiment, cases, fps=0.5)


def test_a_path_film_shows_the_first_iteration_bit_for_bit(path_film):
    experiment, cases, film = path_film
    for measured, filmed in zip(experiment.run(cases, iterations=2), film._runs, strict=True):
        k = len(filmed.time)
        assert np.array_equal(measured.actual[0, :k], filmed.actual[0])
        assert np.array_equal(measured.reference[0, :k], filmed.reference[0])


def test_the_arm_is_where_its_tool_point_was(path_film):
    experiment, _, film = path_film
    scene = ArmScene(experiment.sticking.arm, 32, 32)
    run = film._runs[0]
    for k in (0, 7, 15):
        scene.pose(film._q[0, k])
        sample = np.argmin(np.abs(run.time - 0.05 * k))
        assert np.allclose(scene.flange, run.actual[0, sample, :3], atol=2e-3)


@pytest.mark.usefixtures("gl")
def test_frames_of_a_path(path_film, posed):
    film = path_film[2]
    frames = list(film.frames())
    assert np.array_equal(posed[1:3], film._q[:, 0])
    assert np.array_equal(posed[-2:], film._q[:, -1])
    assert not np.array_equal(posed[1], posed[3])
    assert len(frames) == film.timing.count
    assert film.size == (frames[0].shape[1], frames[0].shape[0])
    first, last = (f[62 : 62 + 320, :480] for f in (frames[0], frames[-1]))
    assert blue(first).sum() > 300, "the path is not hidden by the arm"
    assert orange(last).sum() > orange(first).sum() + 150, "the trail"


# ---- the file ------------------------------------------------------------------------------------


class Bars:
    """A film that needs no OpenGL."""

    size = (64, 48)
    timing = Timing(1.0, fps=10, longest=10)

    def frames(self):
        for k in range(self.timing.count):
            out = np.zeros((48, 64, 3), dtype=np.uint8)
            out[:, : 3 * k] = 255
            yield out


def test_a_film_is_written_and_plays(tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    done = []
    write_film(Bars(), tmp_path / "a.mp4", progress=lambda k, n: done.append((k, n)))
    assert done[-1] == (Bars.timing.count, Bars.timing.count)
    assert [p.name for p in tmp_path.iterdir()] == ["a.mp4"]
    reader = ffmpeg.read_frames(str(tmp_path / "a.mp4"))
    about = next(reader)
    assert about["size"] == (64, 48)
    assert about["fps"] == 10
    frames = [np.frombuffer(f, np.uint8).reshape(48, 64, 3) for f in reader]
    assert len(frames) == Bars.timing.count
    assert frames[15][24, 20].min() > 200
    assert frames[15][24, 60].max() < 50


def test_a_failing_encoder_is_one_line_and_leaves_what_was_there(tmp_path, monkeypatch):
    pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "a.mp4"
    path.write_text("before")
    with pytest.raises(ExperimentError, match=r"a\.mp4: the encoder failed: "):
        write_frames(Bars().frames(), path, size=(64, -2), fps=10)
    assert path.read_text() == "before"
    assert [p.name for p in tmp_path.iterdir()] == ["a.mp4"]


def test_no_ffmpeg_is_said_before_the_work(monkeypatch):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")

    def none():
        raise RuntimeError("No ffmpeg exe could be found.\nInstall ffmpeg")

    monkeypatch.setattr(ffmpeg, "get_ffmpeg_exe", none)
    with pytest.raises(StictionError, match=r"a video needs ffmpeg: No ffmpeg exe .* Install"):
        check_film()
