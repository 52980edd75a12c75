"""Real servo logs through this tool and through PACE's set of parameters, on motions left out.

    python -m benchmarks.servo.servo_peers [--logs FOLDER]

PACE (leggedrobotics/pace-sim2real) fits armature, viscous friction, Coulomb friction and an encoder
bias per joint and one delay of the robot by CMA-ES, to servos whose gains are known. Here they are
fitted with our compiled simulation of each joint, and judged, as ours, by the plant with the whole
robot. Needs ``pip install .[fit]``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness import LOGS, MEASURED, Benchmark, Row, machine
from benchmarks.servo.blind_servo_logs import robot_file
from benchmarks.servo.servo_friction import JOINTS
from stiction_envs.gap.servo.arm import simulate_arm
from stiction_envs.gap.servo.diagnosis import diagnose_servo
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.motion import joint_motions
from stiction_envs.gap.servo.parameters import INDEX, absent
from stiction_envs.gap.servo.questions import Servo
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.measured.logs.servo_reader import read_servo_logs
from stiction_envs.reporting.markdown import table_text
from stiction_envs.robots import Arm, load_arm

Array = NDArray[np.float64]
MADE_BY = (
    *(*LOGS, "stiction_envs/control", "stiction_envs/plant"),
    *("benchmarks/servo/servo_peers.py", "benchmarks/servo/blind_servo_logs.py"),
)
STUDY = Benchmark(__file__, __doc__, made_by=MADE_BY)
MOTIONS = (
    *("actuator_bandwidth", "custom_motion", "fast_transitions", "friction_gravity"),
    *("gripper_cycles", "inertia_coupling", "multisine", "prbs_excitation"),
    *("single_joint_rotation", "single_joint_wrist_pitch", "slow_precision", "spiral_motion"),
    *("step_response", "velocity_ramp", "wave_motion"),
)
"""Motions of the SO-101 without contact (README of the logs); every third is left out."""
GO2 = "go2_description/urdf/go2.urdf"
GIVEN_S = 15.0
"""First part of the Go2's log that is fitted [s]."""
PERFECT, PACE, OURS = "perfect servo (q = q_cmd)", "PACE's set, CMA-ES", "`stiction diagnose`"

# ---- PACE's set ----------------------------------------------------------------------------------

OF_JOINT = ("armature", "damping", "stiction", "offset")
LOW = np.array([0.0, 0.0, 0.0, -0.15])
HIGH = np.array([0.005, 0.3, 0.15, 0.15])
"""Bounds of `OF_JOINT`: the first three over the servo's stiffness [s², s, rad], the bias [rad];
assumed, wide enough for both robots."""
DELAY = (-0.03, 0.1)
"""Bounds of the delay [s], those of `stiction diagnose`."""
SIGMA, POPULATION, GENERATIONS, SEED = 0.5, 32, 250, 0
"""CMA-ES between bounds of ±1: as PACE's, but for its population of thousands on a GPU."""


def pace_parameters(x: Array, stiffness: Array) -> Array:
    """Return (n, P) parameters of joints from (4 n + 1,) numbers between −1 and 1.

    Args:
        x: of all joints kind by kind, in the order of `OF_JOINT`, then of the delay.
        stiffness: (n,) of the servos [N·m/rad].
    """
    n = len(stiffness)
    share = (x + 1.0) / 2.0
    out = np.tile(absent(), (n, 1))
    out[:, INDEX["stiffness"]] = stiffness
    for k, name in enumerate(OF_JOINT):
        value = LOW[k] + share[k * n : (k + 1) * n] * (HIGH[k] - LOW[k])
        out[:, INDEX[name]] = value if name == "offset" else value * stiffness
    out[:, INDEX["delay"]] = DELAY[0] + share[-1] * (DELAY[1] - DELAY[0])
    return out


def fit_pace(
    motions: Sequence[JointMotion],
    stiffness: Array,
    *,
    population: int = POPULATION,
    generations: int = GENERATIONS,
) -> tuple[Array, Array]:
    """Return the (4 n + 1,) numbers of `pace_parameters` that fit best, and PACE's cost [rad²].

    The cost is the mean square error, summed over the joints, of the mean of each generation.
    """
    from cmaes import CMA

    bounds = np.tile([-1.0, 1.0], (4 * len(motions) + 1, 1))
    search = CMA(
        mean=np.zeros(len(bounds)),
        sigma=SIGMA,
        bounds=bounds,
        seed=SEED,
        population_size=population,
    )
    costs = []
    with ThreadPoolExecutor() as workers:

        def cost(tried: Array) -> Array:
            sets = np.stack([pace_parameters(x, stiffness) for x in tried])

            def one(j: int) -> Array:
                error = motions[j].simulate(sets[:, j]) - motions[j].q
                square: Array = np.mean(np.nan_to_num(error, nan=6.0) ** 2, axis=1)
                return square

            total: Array = np.sum(list(workers.map(one, range(len(motions)))), axis=0)
            return total

        for _ in range(generations):
            tried = np.stack([search.ask() for _ in range(population)])
            found = cost(np.vstack([tried, search.mean]))
            search.tell(list(zip(tried, found[:-1], strict=True)))
            costs.append(found[-1])
        last = cost(search.mean[None])
    return np.array(search.mean), np.array([*costs, *last])


# ---- robots --------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """Logs on which models are judged."""

    arm: Arm
    logs: Sequence[ServoLog]
    after: float = 0.0
    """Time from which the rows count [s]; the simulation begins with the log."""

    def rms(self, angles: Sequence[Array]) -> list[float]:
        """Return (n,) root mean square errors over the rows that count [rad]."""
        error = [
            (a - log.q)[log.t - log.t[0] >= self.after]
            for log, a in zip(self.logs, angles, strict=True)
        ]
        out: list[float] = np.sqrt(np.mean(np.concatenate(error) ** 2, axis=0)).tolist()
        return out

    def errors(self, parameters: Array, load: Array) -> list[float]:
        """Return those of a model of the whole robot, simulated by the plant [rad]."""
        return self.rms(simulate_arm(self.arm, self.logs, parameters, load))


@dataclass(frozen=True, kw_only=True, eq=False)
class Robot:
    """One robot: what is fitted, and what is judged by name."""

    arm: Arm
    given: Sequence[ServoLog]
    judged: Mapping[str, Judged]
    names: Sequence[str]
    """Of the joints."""


def so101(folder: Path) -> Robot:
    """Two of three motions are given."""
    arm = load_arm(robot_file("so101"))
    logs = read_servo_logs([folder / f"so101_{x}.csv.gz" for x in MOTIONS], arm.n)
    left_out = logs[::3]
    return Robot(
        arm=arm,
        given=[log for k, log in enumerate(logs) if k % 3],
        judged={"motions left out": Judged(arm=arm, logs=left_out)},
        names=JOINTS,
    )


def go2(folder: Path) -> Robot:
    """The first part of one leg's log is given."""
    file = Path(robot_file("so101")).parents[2] / GO2
    legs = {leg: load_arm(file, chain=("base", f"{leg}_foot")) for leg in ("FL", "RR")}
    logs = {leg: read_servo_logs([folder / f"go2_{leg}.csv.gz"], 3)[0] for leg in legs}
    return Robot(
        arm=legs["FL"],
        given=[head(logs["FL"], GIVEN_S)],
        judged={
            "same leg, later": Judged(arm=legs["FL"], logs=[logs["FL"]], after=GIVEN_S),
            "another leg (RR)": Judged(arm=legs["RR"], logs=[logs["RR"]]),
        },
        names=("hip", "thigh", "calf"),
    )


def head(log: ServoLog, seconds: float) -> ServoLog:
    """Return the first part of a log without gaps."""
    rows = slice(0, int(np.searchsorted(log.t, log.t[0] + seconds)))

    def cut(x: Array | None) -> Array | None:
        return None if x is None else x[rows]

    return replace(
        log,
        t=log.t[rows],
        q=log.q[rows],
        q_cmd=log.q_cmd[rows],
        dq=cut(log.dq),
        tau=cut(log.tau),
        current=cut(log.current),
        extra={k: x[rows] for k, x in log.extra.items()},
        breaks=tuple(b for b in log.breaks if b < rows.stop),
    )


ROBOTS: dict[str, Callable[[Path], Robot]] = {"SO-101": so101, "Unitree Go2, a leg": go2}

# ---- rows ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Job:
    """One robot, and who fits it."""

    robot: str
    folder: Path
    stiffness: tuple[float, ...] = ()
    """(n,) of the servos, for PACE [N·m/rad]; none: ours finds it."""

    def measure(self) -> Row:
        """Return the row."""
        robot = ROBOTS[self.robot](self.folder)
        return pace(robot, np.array(self.stiffness)) if self.stiffness else ours(robot)


def ours(robot: Robot) -> Row:
    """Return errors of the model that is found, and of perfect servos."""
    start = time.process_time()
    found = diagnose_servo(robot.given, robot.arm, Servo())
    seconds = time.process_time() - start
    return {
        "seconds": seconds,
        "rms": {k: x.errors(found.parameters, found.load) for k, x in robot.judged.items()},
        "perfect": {k: x.rms([log.q_cmd for log in x.logs]) for k, x in robot.judged.items()},
        "parameters": found.parameters.tolist(),
        "causes": [[c.name, list(c.joints)] for c in found.causes],
    }


def pace(robot: Robot, stiffness: Array) -> Row:
    """Return errors of PACE's set."""
    start = time.process_time()
    motions = joint_motions(robot.arm, robot.given)
    x, costs = fit_pace(motions, stiffness)
    seconds = time.process_time() - start
    parameters = pace_parameters(x, stiffness)
    load = np.array([float(np.abs(m.gravity).mean()) for m in motions])
    return {
        "seconds": seconds,
        "rms": {k: j.errors(parameters, load) for k, j in robot.judged.items()},
        "parameters": parameters.tolist(),
        "on_bound": on_bound(x, robot.names),
        "cost": costs.tolist(),
    }


def on_bound(x: Array, names: Sequence[str]) -> list[str]:
    """Return which of the fitted numbers, between −1 and 1, end at a bound."""
    of = [f"{what} of the {joint}" for what in OF_JOINT for joint in names] + ["delay"]
    return [name for name, value in zip(of, x, strict=True) if abs(value) > 0.99]


def section(mine: Row, peer: Row, names: Sequence[str]) -> dict[str, Any]:
    """Return what the page's template asks for, of one robot."""
    rows, where, means = [], [], {}
    for group in mine["rms"]:
        found = {
            PERFECT: mine["perfect"][group],
            PACE: peer["rms"][group],
            OURS: mine["rms"][group],
        }
        best = np.min(list(found.values()), axis=0)
        for name, error in found.items():
            pairs = zip(error, best, strict=True)
            shown = [f"**{1e3 * x:.1f}**" if x <= y else f"{1e3 * x:.1f}" for x, y in pairs]
            took = {PACE: f"{peer['seconds']:.0f}", OURS: f"{mine['seconds']:.0f}"}.get(name, "")
            rows.append([group, name, *shown, f"{1e3 * np.mean(error):.1f}", took])
        where += [
            f"{joint} ({group}: {1e3 * y:.1f} against {1e3 * x:.1f} mrad)"
            for joint, x, y in zip(names, found[PACE], found[OURS], strict=True)
            if y > x
        ]
        means[group] = {k: 1e3 * float(np.mean(v)) for k, v in found.items()}
    halfway = peer["cost"][len(peer["cost"]) // 2]
    return {
        "table": table_text(["on", "what is simulated", *names, "mean", "processor seconds"], rows),
        "worse": where,
        "means": means,
        "on_bound": peer["on_bound"],
        "late_gain": 100.0 * (1.0 - np.sqrt(peer["cost"][-1] / halfway)),
    }


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--logs", type=Path, default=MEASURED / "servo_logs", help="folder of logs")
    options = parser.parse_args()
    if not options.logs.is_dir():
        parser.error(f"--logs: {options.logs}: expected a folder of logs")
    kept, folder = STUDY.rows(options), options.logs.resolve()
    jobs = {f"{robot}, ours": Job(robot, folder) for robot in ROBOTS}
    kept.fill(jobs, Job.measure, minutes=options.minutes)
    for robot in ROBOTS:
        if f"{robot}, ours" in kept:
            found = np.array(kept[f"{robot}, ours"]["parameters"])[:, INDEX["stiffness"]]
            jobs[f"{robot}, PACE"] = Job(robot, folder, tuple(found.tolist()))
    rows = kept.fill(jobs, Job.measure, minutes=options.minutes)
    if len(rows) < 2 * len(ROBOTS):
        print(f"no page is written: {len(rows)} of {2 * len(ROBOTS)} rows")
        return
    names = {robot: make(folder).names for robot, make in ROBOTS.items()}
    STUDY.write_page(
        options,
        machine=machine(),
        robots={
            robot: section(rows[f"{robot}, ours"], rows[f"{robot}, PACE"], names[robot])
            for robot in ROBOTS
        },
        words={"perfect": PERFECT, "pace": PACE, "ours": OURS},
        given_s=GIVEN_S,
        motions={
            "given": [x for k, x in enumerate(MOTIONS) if k % 3],
            "left out": list(MOTIONS[::3]),
        },
        search={"population": POPULATION, "generations": GENERATIONS},
    )


if __name__ == "__main__":
    main()
