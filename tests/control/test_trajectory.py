"""Trapezoidal segments, goals accepted from the measured pose, paths (sources.md 6.2)."""

import numpy as np
import pytest

from stiction_envs.control import rotation
from stiction_envs.control.trajectory import MotionLimits, Path, pentagon, read_path, triangle
from stiction_envs.control.trapezoid import write_twist
from tests.control.movements import Goals, Segment
from tests.control.rig import angle_between, from_rotation_vector
from tests.refusal import refusal

HERE = np.array([1.0, 0.0, 0.0, 0.0])


def ends(n: int = 64) -> tuple[np.ndarray, ...]:
    """Starts and goals from a millimetre to two metres, from a hundredth of a turn to half one."""
    rng = np.random.default_rng(0)
    start = rng.normal(size=(n, 3))
    direction, q, axis = (rng.normal(size=(n, k)) for k in (3, 4, 3))
    for vectors in (direction, q, axis):
        vectors /= np.linalg.norm(vectors, axis=1)[:, None]
    turn = from_rotation_vector(axis * rng.uniform(0.01, 3.1, (n, 1)))
    goal = start + direction * np.geomspace(1e-3, 2.0, n)[:, None]
    return start, q, goal, rotation.multiply(turn, q)


def segment() -> Segment:
    """Movements of 64 arms between `ends`."""
    out = Segment(64, MotionLimits())
    out.start(*ends())
    return out


def one(distance: float, angle: float = 0.0, **limits: object) -> Segment:
    """One arm that moves along x and turns about z."""
    out = Segment(1, MotionLimits(**limits))  # type: ignore[arg-type]
    turn = from_rotation_vector([[0.0, 0.0, angle]])
    out.start(np.zeros((1, 3)), HERE[None], [[distance, 0.0, 0.0]], turn)
    return out


def test_speed_and_acceleration_stay_within_the_limits():
    """Finite differences: v ≤ v_max, −b ≤ v̇ ≤ a for translation and rotation, of all 64 arms."""
    limits, s = MotionLimits(), segment()
    h = 1e-3
    t = np.arange(-0.1, s.duration.max() + 0.1, h)
    p, q, v, w = (np.array(part) for part in zip(*(s.sample(x) for x in t), strict=True))
    speed = np.linalg.norm(v, axis=2)
    for value, v_max, a, b in (
        (speed, limits.translational_speed, 0.2, 0.2),
        (w, limits.rotational_speed, 0.5, 0.2),
    ):
        assert value.min() >= 0
        assert value.max() <= v_max * (1 + 1e-12)
        rate = np.diff(value, axis=0) / h
        assert rate.max() <= a * (1 + 1e-9)
        assert rate.min() >= -b * (1 + 1e-9)
    # the speeds are the derivatives of the pose
    middle = 0.5 * (v[1:] + v[:-1])
    np.testing.assert_allclose(np.diff(p, axis=0) / h, middle, atol=2e-4)
    turned = angle_between(q[1:], q[:-1]) / h
    np.testing.assert_allclose(turned, 0.5 * (w[1:] + w[:-1]), atol=1e-3)


def test_triangle_profile_of_short_distances():
    """t_acc = √(2 d b/(a(a + b))) and the fall a/b times as long (sources.md 6.2)."""
    a, b, d = 0.5, 0.2, 0.3
    t_acc = np.sqrt(2 * d * b / (a * (a + b)))
    s = one(0.0, d)
    assert s.duration[0] == pytest.approx(t_acc * (1 + a / b), rel=1e-12)
    assert s.sample(t_acc)[3][0] == pytest.approx(a * t_acc, rel=1e-12)
    # equal acceleration and deceleration: half the time each, twice √(d/a)
    assert one(0.2).duration[0] == pytest.approx(2.0, rel=1e-12)


def test_trapezoid_of_long_distances():
    """Above v²/2a + v²/2b the speed is flat at v_max: T = d/v + v/2a + v/2b."""
    s = one(2.0)
    assert s.duration[0] == pytest.approx(2.0 / 0.5 + 0.5 / 0.4 + 0.5 / 0.4, rel=1e-12)
    assert s.sample(3.0)[2][0, 0] == pytest.approx(0.5, rel=1e-12)
    edge = 0.5**2 / 0.2  # where one profile becomes the other
    below, at, above = (one(edge * f).duration[0] for f in (1 - 1e-9, 1, 1 + 1e-9))
    assert below < at < above
    assert above - below < 1e-7


def test_movements_of_both_kinds_end_together():
    """The shorter one is stretched in time: same shape, slower."""
    together, alone = one(0.2, 0.1), one(0.0, 0.1)
    assert together.duration[0] == one(0.2).duration[0]
    assert alone.duration[0] < 0.9 * together.duration[0]
    start = np.array([HERE])
    for fraction in (0.2, 0.5, 0.8, 1.0):
        stretched = angle_between(together.sample(fraction * 2.0)[1], start)
        own = angle_between(alone.sample(fraction * alone.duration)[1], start)
        np.testing.assert_allclose(stretched, own, atol=1e-12)
    assert together.sample(1.9)[3][0] > 0


def test_a_movement_without_distance_takes_no_time():
    """Goal = start: duration 0, rest, nothing but finite numbers; also half a turn on the spot."""
    s = one(0.0)
    assert s.duration[0] == 0
    for t in (-1.0, 0.0, 1.0):
        position, quaternion, *speeds = s.sample(t)
        np.testing.assert_array_equal(position, np.zeros((1, 3)))
        np.testing.assert_array_equal(quaternion, HERE[None])
        assert not any(speed.any() for speed in speeds)
    half = one(0.0, np.pi)
    turned = angle_between(half.sample(half.duration)[1], HERE[None])
    np.testing.assert_allclose(turned, np.pi, atol=1e-12)


def sequencer(n: int = 3, **limits: object) -> tuple[Goals, np.ndarray, np.ndarray]:
    """Arms at different places with the triangle before them."""
    out = Goals(n, MotionLimits(**limits), 5)  # type: ignore[arg-type]
    p, q = np.arange(3.0 * n).reshape(n, 3), np.tile(HERE, (n, 1))
    out.start_all(range(n), *triangle().goals(p, q), p, q)
    return out, p, q


def test_next_goal_starts_from_the_measured_pose():
    """sources.md 6.2: the standing error is forgotten at the corner; the goals stay where put."""
    k, p, q = sequencer()
    goals, _ = triangle().goals(p, q)
    off = np.array([[0.03, 0, 0], [0, 0.02, 0.01], [0, 0, -0.03]])
    assert not k.accept(goals[:, 0] + off, q, 1.999).any()
    end = k.movement.duration.copy()
    measured = goals[:, 0] + off
    turn = from_rotation_vector(np.tile([0.1, 0, 0], (3, 1)))
    assert k.accept(measured, turn, end).all()
    np.testing.assert_array_equal(k.arrays.current, [1, 1, 1])
    position, quaternion, velocity, _ = k.reference(end)
    np.testing.assert_array_equal(position, measured)
    np.testing.assert_array_equal(quaternion, turn)
    assert not velocity.any()
    position, quaternion, _, _ = k.reference(end + k.movement.duration + 1e-9)
    np.testing.assert_array_equal(position, goals[:, 1])
    np.testing.assert_array_equal(quaternion, q)


def test_goals_wait_for_time_and_tolerance():
    """Reached: the movement has ended, and under 0.04 m and 0.25 rad; each arm for itself."""
    k, p, q = sequencer(4)
    goal = triangle().goals(p, q)[0][:, 0]
    off = np.array([[0.0399, 0, 0], [0.0401, 0, 0], [0, 0, 0], [0, 0, 0]])
    tilt = from_rotation_vector([[0.0, 0, 0], [0, 0, 0], [0.2499, 0, 0], [0, 0.2501, 0]])
    reached = k.accept(goal + off, rotation.multiply(tilt, q), 2.5)
    assert reached.tolist() == [True, False, True, False]
    np.testing.assert_array_equal(k.arrays.current, [1, 0, 1, 0])
    assert k.accept(goal, q, 3.0).tolist() == [False, True, False, True]
    np.testing.assert_array_equal(k.arrays.accepted[:, :2], [[0, 2.5], [0, 3], [0, 2.5], [0, 3]])
    np.testing.assert_array_equal(k.arrays.reached[:, 0], [2.5, 3, 2.5, 3])
    assert np.isnan(k.arrays.accepted[:, 2:]).all()
    far, _, _ = sequencer(4, position_tolerance=np.inf, rotation_tolerance=np.inf)
    assert far.accept(goal + 1.0, q, 2.5).all()


def test_walks_through_all_goals_and_finishes():
    """Perfect arms: three goals, then rest at the last, once each.

    Ahead are the next goal and the vector from there to the one after it.
    """
    assert Goals(3, MotionLimits(), 5).goals_left.tolist() == [0, 0, 0], "before the start"
    k, p, q = sequencer()
    goals, count = triangle().goals(p, q)[0], np.zeros(3)
    onward = np.diff(goals, axis=1, append=goals[:, -1:])
    for clock in 0.01 * np.arange(900):
        np.testing.assert_array_equal(k.goals_left, 3 - k.arrays.current)
        at = np.arange(3), np.minimum(k.arrays.current, 2)
        np.testing.assert_array_equal(k.ahead, [goals[at], onward[at]])
        position, quaternion, _, _ = k.reference(np.full(3, clock))
        count += k.accept(position, quaternion, clock)
    assert k.finished.all()
    assert not k.goals_left.any()
    np.testing.assert_array_equal(count, 2)  # the first was accepted by `start`
    np.testing.assert_array_equal(k.arrays.current, 3)
    np.testing.assert_allclose(k.arrays.accepted[:, :3].T, [[0] * 3, [2] * 3, [4] * 3], atol=0.021)
    np.testing.assert_array_equal(k.arrays.accepted[:, 1:3], k.arrays.reached[:, :2])
    assert np.isfinite(k.arrays.reached[:, 2]).all()
    np.testing.assert_array_equal(k.reference(np.full(3, 99.0))[0], p)
    np.testing.assert_array_equal(k.ahead, [p, 0 * p])


def test_polygons_are_regular_closed_and_where_the_thesis_puts_them():
    """Thesis 4.1: a triangle in space, a pentagon in the XY-plane; sizes of gte.toml."""
    for path, corners, side in ((triangle(), 3, 0.2), (pentagon(), 5, 0.15)):
        assert path.position.shape == (corners, 3)
        np.testing.assert_array_equal(path.position[-1], 0.0)
        edges = np.diff(np.vstack([np.zeros(3), path.position]), axis=0)
        np.testing.assert_allclose(np.linalg.norm(edges, axis=1), side, rtol=1e-12)
        cosines = np.sum(edges * np.roll(edges, 1, axis=0), axis=1) / side**2
        np.testing.assert_allclose(cosines, np.cos(2 * np.pi / corners), atol=1e-12)
        np.testing.assert_array_equal(path.quaternion, np.tile(HERE, (corners, 1)))
    assert not pentagon().position[:, 2].any()
    assert np.ptp(triangle().position, axis=0).min() > 0.05


def test_goals_are_relative_to_the_start_in_the_axes_of_the_base(tmp_path):
    """p_goal = p + Δp, q_goal = Δq ⊗ q."""
    file = tmp_path / "turn.csv"
    file.write_text("x,y,z,roll,pitch,yaw\n0.1,0,0,0,0,1.5\n0,0.2,0,0.1,0.2,0.3\n")
    path = read_path(file)
    assert path.name == "turn"
    start, q = ends(4)[:2]
    p_goal, q_goal = path.goals(start, q)
    np.testing.assert_allclose(p_goal[2], start[2] + [[0.1, 0, 0], [0, 0.2, 0]])
    turned = rotation.rotation_error(q_goal[:, 0], q)
    np.testing.assert_allclose(turned, np.tile([0, 0, 1.5], (4, 1)), atol=1e-12)
    expected = rotation.multiply(rotation.from_rpy([0.1, 0.2, 0.3]), q)
    np.testing.assert_allclose(angle_between(q_goal[:, 1], expected), 0.0, atol=1e-12)


def test_files_with_and_without_orientation(tmp_path):
    """Positions alone keep the orientation; quaternions are normalised; order and blanks free."""
    file = tmp_path / "path.csv"
    file.write_text("z, x, y\n3,1,2\n\n6,4,5\n")
    path = read_path(file)
    np.testing.assert_array_equal(path.position, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(path.quaternion, np.tile(HERE, (2, 1)))
    file.write_text("x,y,z,qw,qx,qy,qz\n0,0,0,0.7071,0,0,0.7071\n")
    q = read_path(file).quaternion
    np.testing.assert_allclose(q, [[0.5**0.5, 0, 0, 0.5**0.5]], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "empty file"),
        ("x,y,z\n", "no rows"),
        ("x,y\n1,2\n", "missing column 'z': expected x,y,z with optional roll"),
        ("x,y,z,roll,pitch\n1,2,3,0,0\n", "missing column 'yaw'"),
        ("x,y,z,qw\n1,2,3,1\n", "missing column 'qx', 'qy', 'qz'"),
        ("x,y,z,w\n1,2,3,1\n", "unknown column 'w'"),
        ("x,y,z\n1,2,up\n", "line 2: z is 'up': expected a number"),
        ("x,y,z\n1,2,3\n1,nan,3\n", "line 3: y is 'nan'"),
        ("x,y,z\n1,2\n", "line 2: 2 values"),
        ("x,y,z,qw,qx,qy,qz\n0,0,0,1,0,0,0\n0,0,0,1,1,0,0\n", r"line 3: .*length 1.41"),
    ],
)
def test_bad_files_name_file_line_column_and_what_was_expected(tmp_path, text, words):
    file = tmp_path / "bad.csv"
    file.write_text(text)
    line = refusal(lambda: read_path(file), words)
    assert "bad.csv" in line
    assert "expected" in line


@pytest.mark.parametrize("name", ["translational_speed", "rotational_deceleration"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, np.float64(-1), "fast"])
def test_bad_limits_say_what_and_what_was_expected(name, value):
    refusal(lambda: MotionLimits(**{name: value}), f"motion {name} is .*expected")


def test_twist_is_the_references_velocity():
    """By central differences of position and orientation; 0 at rest."""
    s = segment()
    h = 1e-6
    for share in (0.1, 0.45, 0.8):
        t = share * s.duration
        (x0, q0, _, _), (x1, q1, _, _) = s.sample(t - h), s.sample(t + h)
        moved = np.concatenate([x1 - x0, rotation.rotation_error(q1, q0)], axis=1)
        twist = np.empty_like(moved)
        for i, now in enumerate(t):
            write_twist(i, now, s.arrays, twist[i])
        np.testing.assert_allclose(twist, moved / (2 * h), atol=1e-6)
    for rest in (-1.0, 1e3):
        write_twist(0, rest, s.arrays, twist[0])
        assert not twist[0].any()


def test_pace_stretches_every_movement_of_its_arm_in_time():
    """The same way in 1/pace of the time, speeds times the pace: goal after goal, arm by arm."""
    goals = np.array([[0.3, 0.1, -0.2], [0.1, 0.0, 0.1]])
    turns = np.stack([HERE, from_rotation_vector([0.0, 0.0, 0.5])])
    s = Goals(2, MotionLimits(), 2)
    for i, pace in enumerate((1.0, 0.5)):
        s.start(i, goals, turns, np.zeros(3), HERE, pace)
    for goal, turn in zip(goals, turns, strict=True):
        duration = s.movement.duration.copy()
        assert duration[1] == pytest.approx(2 * duration[0], rel=1e-12)
        for share in np.linspace(0, 0.99, 7):
            begun = s.arrays.accepted[:, s.arrays.current[0]]
            x, q, velocity, speed = s.reference(begun + share * duration)
            assert x[1] == pytest.approx(x[0], abs=1e-12)
            assert q[1] == pytest.approx(q[0], abs=1e-12)
            assert velocity[1] == pytest.approx(0.5 * velocity[0], abs=1e-12)
            assert speed[1] == pytest.approx(0.5 * speed[0], abs=1e-12)
        s.accept(np.stack([goal] * 2), np.stack([turn] * 2), begun + duration)
    assert s.finished.all()


@pytest.mark.parametrize("pace", [0.0, -1.0, 1.2, float("nan")])
def test_a_pace_is_over_zero_to_one(pace):
    says = f"path fast: pace is {pace}: expected `float`"
    refusal(lambda: Path("fast", np.zeros((1, 3)), HERE[None], pace), says)
