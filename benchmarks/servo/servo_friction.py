"""A real SO-101 and its models on motions that took no part: MuJoCo's friction against LuGre.

    python -m benchmarks.servo.servo_friction [--logs FOLDER]

`diagnose` reads servo logs (commands and angles) and writes ``model.xml``. On other motions the
commands drive stock MuJoCo: ``model.xml``, and the same arm with joint ``frictionloss`` instead of
the LuGre bristle.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.harness import MEASURED, Benchmark
from benchmarks.servo.blind_servo_logs import robot_file
from stiction_envs.experiments.sje.plots import plain_axes
from stiction_envs.gap.diagnose import diagnose
from stiction_envs.gap.servo.servo_diagnosis import ServoDiagnosis
from stiction_envs.gap.servo.servo_parameters import INDEX
from stiction_envs.gap.servo.whole_arm import simulate_arm
from stiction_envs.measured.logs.reader import read_servo_logs
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.reporting.markdown import table_text
from stiction_envs.reporting.png import save_full
from stiction_envs.robots import load_arm
from stiction_envs.robots.stated import COULOMB, STICTION

Array = NDArray[np.float64]
STUDY = Benchmark(__file__, __doc__)
FITTED = (
    "friction_gravity",
    "step_response",
    "custom_motion",
    "fast_transitions",
    "gripper_cycles",
)
LEFT_OUT = (
    *("actuator_bandwidth", "multisine", "single_joint_rotation", "single_joint_wrist_pitch"),
    *("slow_precision", "spiral_motion", "velocity_ramp", "wave_motion"),
)
"""Motions in which the arm touches nothing and stands at no stop (README of the logs)."""
FAST = ("inertia_coupling", "prbs_excitation")
"""Likewise, faster than the servos follow."""
OBEYS, LUGRE, DEFAULT, PLANT = (
    "a servo that obeys (q = q_cmd)",
    "stock MuJoCo, `model.xml` (LuGre)",
    "stock MuJoCo, `frictionloss`",
    "our plant",
)
HARD = f"{DEFAULT}, solver at its hardest"
JOINTS = ("shoulder pan", "shoulder lift", "elbow", "wrist flex", "wrist roll", "jaw")
LEVELS = (0.5, 0.75, 1.0, 1.25, 1.5, 2.0)
"""Levels of `frictionloss` that are tried, over the mean of the model's stiction and Coulomb
friction [-]."""
HARDEST = ([0.002, 1.0], [0.9999, 0.9999, 0.001, 0.5, 2.0])
"""MuJoCo's solreffriction and solimpfriction that creep least at steps of 1 ms."""
SHOWN = ("wave_motion", 1, 2.0, 16.0)
"""Motion, joint (from 0), first and last time [s] of the picture."""
PICTURE = "servo_friction.png"


def with_frictionloss(xml: str, level: Array, *, hard: bool) -> mujoco.MjModel:
    """Return a diagnosed arm with joint ``frictionloss`` (n,) [N·m] instead of its bristles."""
    spec = mujoco.MjSpec.from_string(xml)
    for actuator in list(spec.actuators):
        if actuator.name.endswith("_torque"):
            spec.delete(actuator)
    for joint, value in zip(spec.joints, level, strict=True):
        joint.frictionloss = float(value)
        if hard:
            joint.solref_friction[:], joint.solimp_friction[:] = HARDEST
    return spec.compile()


def follow(model: mujoco.MjModel, log: ServoLog, delay: Array) -> Array:
    """Return (T, n) angles of stock MuJoCo under a log's commands, from its first angles [rad].

    Args:
        model: with an actuator ``JOINT_servo`` per joint.
        log: of one segment.
        delay: (n,) after which a command acts [s].
    """
    data, step = mujoco.MjData(model), model.opt.timestep
    servos = [k for k in range(model.nu) if model.actuator(k).name.endswith("_servo")]
    t = log.t - log.t[0]
    time = step * np.arange(int(np.ceil(t[-1] / step)) + 1)
    row = [np.searchsorted(t, time - d + 1e-9, side="right") - 1 for d in delay]
    command = np.stack([log.q_cmd[np.maximum(r, 0), j] for j, r in enumerate(row)], axis=1)
    data.qpos[:] = log.q[0]
    out = np.empty((len(time), model.nq))
    for k in range(len(time)):
        out[k] = data.qpos
        data.ctrl[servos] = command[k]
        mujoco.mj_step(model, data)
    return np.stack([np.interp(t, time, out[:, j]) for j in range(model.nq)], axis=1)


def rms(logs: Sequence[ServoLog], angles: Sequence[Array]) -> Array:
    """Return (n,) the root mean square error over all rows [mrad]."""
    error = np.concatenate([a - log.q for log, a in zip(logs, angles, strict=True)])
    out: Array = 1e3 * np.sqrt((error**2).mean(axis=0))
    return out


def read(folder: Path, names: Sequence[str], n: int) -> list[ServoLog]:
    """Return the logs of some motions."""
    return read_servo_logs([folder / f"so101_{name}.csv.gz" for name in names], n)


def best_level(xml: str, p: Array, logs: Sequence[ServoLog], *, hard: bool) -> Array:
    """Return (n,) the ``frictionloss`` [N·m] with which each joint follows fitted motions best."""
    model = mujoco.MjModel.from_xml_string(xml)
    bristles = [k for k in range(model.nu) if model.actuator(k).name.endswith("_torque")]
    level = model.actuator_biasprm[bristles][:, [COULOMB, STICTION]].mean(axis=1)
    delay = p[:, INDEX["delay"]]
    found = []
    for share in LEVELS:
        other = with_frictionloss(xml, share * level, hard=hard)
        found.append(rms(logs, [follow(other, log, delay) for log in logs]))
    out: Array = np.array(LEVELS)[np.argmin(found, axis=0)] * level
    return out


def measure(folder: Path) -> tuple[dict[str, dict[str, Array]], dict[str, Array]]:
    """Return per group of motions errors by model (n,) [mrad]; what is drawn."""
    path = robot_file("so101")
    arm = load_arm(path)
    files = [folder / f"so101_{name}.csv.gz" for name in FITTED]
    result = diagnose(files, robot=path, same_servo=True, threads=1)
    found = result.diagnosis
    assert isinstance(found, ServoDiagnosis)
    xml, p = result.extension.xml, found.parameters
    fitted, delay = read(folder, FITTED, arm.n), p[:, INDEX["delay"]]
    models = {LUGRE: mujoco.MjModel.from_xml_string(xml)}
    for name, hard in ((DEFAULT, False), (HARD, True)):
        models[name] = with_frictionloss(xml, best_level(xml, p, fitted, hard=hard), hard=hard)
    errors, shown = {}, {}
    for group, names in (("left out", LEFT_OUT), ("left out, fast", FAST)):
        logs = read(folder, names, arm.n)
        angles = {OBEYS: [log.q_cmd for log in logs]}
        angles |= {name: [follow(m, log, delay) for log in logs] for name, m in models.items()}
        angles[PLANT] = simulate_arm(arm, logs, p, found.load)
        errors[group] = {name: rms(logs, a) for name, a in angles.items()}
        if SHOWN[0] in names:
            k, j = names.index(SHOWN[0]), SHOWN[1]
            log = logs[k]
            shown = {name: angles[name][k][:, j] - log.q_cmd[:, j] for name in (LUGRE, DEFAULT)}
            shown |= {"t": log.t - log.t[0], "measured": log.q[:, j] - log.q_cmd[:, j]}
    return errors, shown


def draw(shown: Mapping[str, Array], path: Path) -> None:
    """Draw how far one joint stands from its command."""
    figure = Figure(figsize=(8.2, 3.0), layout="constrained")
    axes = figure.subplots()
    _, joint, first, last = SHOWN
    t = shown["t"]
    inside = (t >= first) & (t <= last)
    for name, colour, width, text, above in (
        (DEFAULT, "#c0392b", 1.8, "MuJoCo's usual friction creeps on and sags", False),
        ("measured", "0.15", 1.6, "the real arm stops and stays", False),
        (LUGRE, "#2471a3", 1.8, "so does ours", True),
    ):
        y = 1e3 * shown[name][inside]
        axes.plot(t[inside] - first, y, color=colour, lw=width)
        style: dict[str, Any] = {"ha": "right", "va": "bottom" if above else "top"}
        style |= {"xytext": (0, 5 if above else -5), "textcoords": "offset points"}
        at = (0.99 * (last - first), y[-1])
        axes.annotate(text, at, color=colour, fontsize=11, **style)
    axes.axhline(0.0, color="0.5", lw=0.8, ls=(0, (4, 3)))
    axes.annotate(
        "command", (0.0, 0.0), xytext=(2, -3), textcoords="offset points", va="top", color="0.4"
    )
    axes.set_xlim(0, last - first)
    axes.set_ylim(bottom=-18)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("distance from\nthe command [mrad]")
    axes.set_title(f"SO-101, {JOINTS[joint]}, a motion that the models have not seen", fontsize=11)
    plain_axes(axes)
    save_full(figure, path)


def page(errors: Mapping[str, Mapping[str, Array]]) -> dict[str, Any]:
    """Return what the page's template asks for."""
    rows = [
        [group, name, *(f"{x:.1f}" for x in error)]
        for group, found in errors.items()
        for name, error in found.items()
    ]
    usual = errors["left out"]
    return {
        "table": table_text(["motions", "what is simulated", *JOINTS], rows),
        "mean": {k: float(usual[k].mean()) for k in usual},
        "names": {"obeys": OBEYS, "lugre": LUGRE, "default": DEFAULT, "hard": HARD},
        "picture": PICTURE,
        "fitted": ", ".join(FITTED),
        "left_out": ", ".join(LEFT_OUT),
        "fast": ", ".join(FAST),
    }


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--logs", type=Path, default=MEASURED / "servo_logs", help="folder of logs")
    options = parser.parse_args()
    errors, shown = measure(options.logs)
    STUDY.write_page(options, **page(errors))
    draw(shown, options.out / PICTURE)


if __name__ == "__main__":
    main()
