"""Does dither of the commanded angle bring an SO-101 nearer to its goals?

    python -m benchmarks.servo.servo_dither [--goals 64]

The arm of ``servo_so101.toml``, which `benchmarks.servo.servo_friction` made of logs of a real
one, is told random goals and comes to rest: without dither, with a sine on every command, and
with one that fades once the command has arrived.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.harness import Benchmark, Row
from benchmarks.servo.blind_servo_logs import robot_file
from benchmarks.servo.servo_friction import JOINTS, MODEL, with_frictionloss
from stiction_envs.control.position_servo import put_under_servos, read_servos
from stiction_envs.experiments.reach import Moves, random_poses, reach, weights
from stiction_envs.experiments.rig import minimum_jerk
from stiction_envs.experiments.settings import experiment_settings
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import load_friction
from stiction_envs.gap.servo.model import read_servo, servo_mjcf
from stiction_envs.reporting.markdown import table_text
from stiction_envs.robots import load_arm

Array = NDArray[np.float64]
MADE_BY = (
    *("stiction_envs/compiled.py", "stiction_envs/control", "stiction_envs/experiments"),
    *("stiction_envs/friction", "stiction_envs/plant", "stiction_envs/robots"),
    *("stiction_envs/gap", "benchmarks/servo/servo_dither.py"),
    *("benchmarks/servo/servo_friction.py", f"benchmarks/servo/{MODEL}"),
)
STUDY = Benchmark(__file__, __doc__, made_by=MADE_BY)
FREQUENCIES = (2.0, 5.0, 10.0, 15.0)
SCALES = (0.25, 0.5, 1.0, 1.5)
SENT_HZ = 50
"""Rate at which commands are sent [Hz]: that of the logs."""
CHOSEN = (5.0, 1.0)
"""Frequency [Hz] and scale of the tables by joint."""
WRONG, SOFTER, STIFFER = 1.3, 5.0, 2.0
"""Factors of friction and of the presliding distance that the sender does not know, and of the
servos' stiffness."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """What is done to reach the goals."""

    frequency: float = 5.0
    """[Hz]."""
    scale: float = 0.0
    """Amplitude over stiction/stiffness of the joint at the goal, as the model has it [-]."""
    fades: bool = False
    friction: float = 0.0
    """Share of stiction/stiffness by which the command goes past the goal [-]."""
    gravity: float = 0.0
    """Share of the sag that is added to the command [-]."""
    real_friction: float = 1.0
    """The arm's friction over the model's [-]."""
    presliding: float = 1.0
    """The arm's presliding distance over the model's [-]."""
    stiffness: float = 1.0
    """The servos' stiffness over the model's [-]."""
    coulomb: bool = False
    """Whether friction is MuJoCo's, at its hardest, of the model's stiction at the goal."""


COMPARED = {
    "nothing": Case(),
    "dither, on": Case(frequency=CHOSEN[0], scale=CHOSEN[1]),
    "dither that fades": Case(frequency=CHOSEN[0], scale=CHOSEN[1], fades=True),
    "command past the goal by friction": Case(friction=1.0),
    "gravity's sag added": Case(gravity=1.0),
    "sag added, dither that fades": Case(
        frequency=CHOSEN[0], scale=CHOSEN[1], fades=True, gravity=1.0
    ),
    "sag added, past the goal by friction": Case(friction=1.0, gravity=1.0),
    "servos twice as stiff (P = 32)": Case(stiffness=STIFFER),
}
"""By what is done."""
LESS_KNOWN: dict[str, dict[str, Any]] = {
    f"friction {WRONG:g} times as large": {"real_friction": WRONG},
    f"presliding distance {SOFTER:g} times as long": {"presliding": SOFTER},
}
"""What the sender of commands does not know."""
TRIED_ON_THEM = (
    *("nothing", "dither that fades", "sag added, dither that fades"),
    "sag added, past the goal by friction",
)


def cases() -> dict[str, Case]:
    """Return every case by the key of its row."""
    out = {
        f"{f:g} Hz, {s:g}, {'fades' if fades else 'on'}": Case(frequency=f, scale=s, fades=fades)
        for f in FREQUENCIES
        for s in SCALES
        for fades in (False, True)
    }
    out |= COMPARED
    for name, changes in LESS_KNOWN.items():
        out |= {f"{name}: {do}": replace(COMPARED[do], **changes) for do in TRIED_ON_THEM}
    for scale in (0.0, *SCALES):
        case = Case(frequency=CHOSEN[0], scale=scale, fades=True, gravity=1.0)
        out |= {f"LuGre, {scale:g}": case, f"Coulomb, {scale:g}": replace(case, coulomb=True)}
    return out


def measure(case: Case, *, goals: int, model: Path) -> Row:
    """Return errors and shaking at rest, root mean squares over the goals [rad, m/s]."""
    arm = load_arm(robot_file("so101"))
    friction, servos = load_friction(model, arm.n), read_servos(model, arm.n)
    assert servos is not None
    believed = build(arm, friction)
    put_under_servos(believed, servos)
    poses = random_poses(arm, 2 * goals, seed=0)
    start, goal = poses[:goals], poses[goals:]
    balance, stiction = weights(believed, servos, goal)
    short, sag = stiction / servos.stiffness, balance / servos.stiffness
    real = friction.replace(
        stiction=case.real_friction * friction.stiction,
        load_coefficient=case.real_friction * friction.load_coefficient,
        bristle_stiffness=case.real_friction * friction.bristle_stiffness / case.presliding,
    )
    sticking = build(arm, real)
    driven = replace(servos, stiffness=case.stiffness * servos.stiffness)
    put_under_servos(sticking, driven)
    rng = np.random.default_rng(1)
    moves = Moves(
        start=start,
        goal=goal,
        past=case.friction * np.sign(goal - start) * short + case.gravity * sag,
        amplitude=case.scale * short,
        frequency=np.full(goals, case.frequency),
        phase=rng.uniform(0.0, 2 * np.pi, goal.shape),
        fades=np.full(goals, case.fades),
    )
    hold_steps = round(1000 / SENT_HZ)
    if case.coulomb:
        error = stock_errors(model, moves, stiction, balance / servos.stiffness, hold_steps)
        return {"error": np.sqrt((error**2).mean(axis=0)).tolist()}
    found = reach(sticking, driven, moves, hold_steps=hold_steps)
    rms = {k: np.sqrt((getattr(found, k) ** 2).mean(axis=0)) for k in ("error", "shaking", "sag")}
    made_by_friction = np.sqrt((found.friction_error**2).mean(axis=0))
    return {
        **{k: v.tolist() for k, v in rms.items()},
        "friction": made_by_friction.tolist(),
        "tip": float(np.sqrt((found.tip_speed**2).mean())),
        "amplitude": np.sqrt((moves.amplitude**2).mean(axis=0)).tolist(),
    }


def stock_errors(model: Path, moves: Moves, level: Array, sag: Array, hold_steps: int) -> Array:
    """Return (N, n) errors at rest in stock MuJoCo with ``frictionloss`` at its hardest [rad].

    Args:
        model: ``model.toml``.
        moves: N of them; their dither fades.
        level: (N, n) friction [N·m].
        sag: (N, n) by which commands hold the arm higher, before the move as after it [rad].
        hold_steps: control steps for which a command is held.
    """
    s = experiment_settings().reach
    parameters = read_servo(model, level.shape[1])
    xml, _ = servo_mjcf(load_arm(robot_file("so101")), parameters, np.zeros(level.shape[1]))
    shaken = s.move_time + s.shaken_time
    steps = round(1000 * (shaken + s.fade_time + s.still_time))
    time = np.arange(steps) // hold_steps * hold_steps * 1e-3
    x = minimum_jerk(time / s.move_time)[:, None]
    size = np.clip(1.0 - (time - shaken) / s.fade_time, 0.0, 1.0)[:, None]
    error = np.empty_like(level)
    for i, goal in enumerate(moves.goal):
        arm = with_frictionloss(xml, level[i], hard=True)
        data = mujoco.MjData(arm)
        data.qpos[:] = moves.start[i]
        angle = 2 * np.pi * moves.frequency[i] * time[:, None] + moves.phase[i]
        command = moves.start[i] + sag[i] + x * (goal + moves.past[i] - moves.start[i] - sag[i])
        command += size * moves.amplitude[i] * np.sin(angle)
        for row in command:
            data.ctrl[:] = row
            mujoco.mj_step(arm, data)
        error[i] = data.qpos - goal
    return error


def page(rows: Mapping[str, Row]) -> dict[str, Any]:
    """Return what the page's template asks for."""

    def mean(key: str, what: str) -> float:
        return 1e3 * float(np.mean(rows[key][what]))

    def by_joint(key: str) -> list[str]:
        row = rows[key]
        return [*(f"{1e3 * x:.1f}" for x in row["error"]), f"{1e3 * row['tip']:.1f}"]

    def cell(f: float, s: float, how: str) -> str:
        key = f"{f:g} Hz, {s:g}, {how}"
        shaken = f" / {1e3 * rows[key]['tip']:.0f}" if how == "on" else ""
        return f"{mean(key, 'friction'):.1f}{shaken}"

    grid = [
        [f"{f:g}", how, *(cell(f, s, how) for s in SCALES)]
        for f in FREQUENCIES
        for how in ("on", "fades")
    ]
    said = [[what, *by_joint(what)] for what in COMPARED]
    parts = [
        [name, *(f"{1e3 * x:.1f}" for x in rows[key][what])]
        for name, key, what in (
            ("friction, without dither", "nothing", "friction"),
            ("friction, dither on", "dither, on", "friction"),
            ("friction, dither that fades", "dither that fades", "friction"),
            ("sag under gravity", "nothing", "sag"),
            ("amplitude of the command's sine", "dither, on", "amplitude"),
            ("shaking while it is on", "dither, on", "shaking"),
        )
    ]
    unknown = [
        [f"{name}: {do}", *by_joint(f"{name}: {do}")] for name in LESS_KNOWN for do in TRIED_ON_THEM
    ]
    drifting = [
        [law, *(f"{mean(f'{law}, {scale:g}', 'error'):.1f}" for scale in (0.0, *SCALES))]
        for law in ("LuGre", "Coulomb")
    ]
    header = ["", *JOINTS]
    return {
        "compared": table_text([*header, "tip [mm/s]"], said),
        "parts": table_text(header, parts),
        "grid": table_text(["f [Hz]", "dither", *(f"{s:g}" for s in SCALES)], grid),
        "unknown": table_text([*header, "tip [mm/s]"], unknown),
        "drifting": table_text(["friction", "none", *(f"{s:g}" for s in SCALES)], drifting),
        "mean": {key: {w: mean(key, w) for w in ("error", "friction", "sag")} for key in COMPARED},
        "tip": 1e3 * rows["dither, on"]["tip"],
        "chosen": CHOSEN,
        "sent": SENT_HZ,
        "model": MODEL,
    }


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--goals", type=int, default=64)
    options = parser.parse_args()
    work = partial(measure, goals=options.goals, model=STUDY.folder / MODEL)
    found = STUDY.rows(options, f"goals{options.goals}").fill(
        cases(), work, minutes=options.minutes
    )
    STUDY.write_page(options, goals=options.goals, **page(found))


if __name__ == "__main__":
    main()
