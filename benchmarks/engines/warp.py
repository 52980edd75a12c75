"""Does an arm on MuJoCo Warp stick, let go and learn as it does on MuJoCo?

    python -m benchmarks.engines.warp [--minutes 10]         # extra warp

Every experiment runs on both engines, MuJoCo first, with the same torques, poses and seeds. Once
more it runs with angles and bristles summed in float32, as MuJoCo Warp by itself does.

What a graphics card does is measured by `warp_card`, once: the page has it wherever it is made.
"""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, partial
from importlib import metadata
from typing import Any

import numpy as np
import warp as wp
from gymnasium.utils import seeding
from numpy.typing import NDArray

from benchmarks.harness import EPISODES, Benchmark, Row
from stiction_envs.dither import tables
from stiction_envs.engines import warp_batch
from stiction_envs.envs.gym_env import ArmVectorEnv
from stiction_envs.envs.registration import EXPERIMENTS, register_all
from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import QUANTITIES, FrictionParameters, load_friction
from stiction_envs.measured import AmplitudeRow, read_amplitudes
from stiction_envs.plant import CONTROL_DT, Plant
from stiction_envs.reporting.markdown import short, table_text
from stiction_envs.robots import load_arm

Array = NDArray[np.float64]
MADE_BY = (*EPISODES, "stiction_envs/dither", "benchmarks/engines/warp.py")
PACKAGES = ("numba", "pin", "mujoco-warp", "warp-lang")
STUDY = Benchmark(__file__, __doc__, made_by=MADE_BY, packages=PACKAGES)
ENGINES = ("mujoco", "warp")
EPISODES_EACH = 4
LARGEST_SHARE = 0.6
"""Of the highest amplitude and frequency that random actions have [-]."""
HELD, PULLED = 0.9, 1.1
"""Torques over stiction that a joint has to hold, and to give way to [-]."""
WAIT_S, SEEN_S = 10.0, 30.0
"""Time in which springs come to rest, the torque grows, and the joint comes to rest, each, and time
over which it is then watched [s]."""
ARMS, STEPS = 64, 500
"""Of the timed run."""
COUNTS = (1024, 4096, 16384)
"""Environments at a time, where there is a graphics card."""
CARD = "warp_card.json"
"""What was measured on a graphics card, beside the page."""


@wp.kernel(enable_backward=False)
def engines_own_angles(
    step: wp.array[wp.int32],
    timestep: wp.float64,
    qvel: wp.array2d[wp.float32],
    angle: wp.array2d[wp.float64],
    qpos: wp.array2d[wp.float32],
    record: wp.array3d[wp.float64],
) -> None:
    """Take the angles that MuJoCo Warp has summed itself."""
    world, joint = wp.tid()
    angle[world, joint] = wp.float64(qpos[world, joint])
    record[step[0], world, joint] = angle[world, joint]


@wp.kernel(enable_backward=False)
def engines_own_bristles(
    timestep: wp.float64,
    actuators: wp.array[wp.int32],
    addresses: wp.array[wp.int32],
    dynprm: wp.array2d[warp_batch.VECTOR],
    biasprm: wp.array2d[warp_batch.VECTOR],
    velocity: wp.array2d[wp.float32],
    bristle: wp.array2d[wp.float64],
    act: wp.array2d[wp.float32],
) -> None:
    """Take the bristles that MuJoCo Warp has bent itself."""
    world, k = wp.tid()
    bristle[world, addresses[k]] = wp.float64(act[world, addresses[k]])


OWN_SUMS = {"sum_angles": engines_own_angles, "bend_bristles": engines_own_bristles}


@contextmanager
def sums_in_float32(yes: bool) -> Iterator[None]:
    """Let batches that step within sum angles and bristles as MuJoCo Warp by itself does."""
    ours = {name: getattr(warp_batch, name) for name in OWN_SUMS}
    try:
        for name, kernel in (OWN_SUMS if yes else ours).items():
            setattr(warp_batch, name, kernel)
        yield
    finally:
        for name, kernel in ours.items():
            setattr(warp_batch, name, kernel)


# ---- breakaway torques ---------------------------------------------------------------------------


def table_rows(robot: str) -> list[AmplitudeRow]:
    """Return the dither of every joint: of Table 4.9 for the Panda, else the shipped table."""
    if robot == "panda":
        return list(thesis_final_dither())
    return read_amplitudes(tables.HERE / f"{robot}.csv", n_joints=7)


def torques(robot: str, *, dithered: bool, float32: bool = False) -> Row:
    """Return torques [N·m] and angles [rad] of all configurations of one ramp each."""
    out: Row = {}
    for engine in ENGINES:
        e = SingleJointExperiment(robot, scatter=False, engine=engine)
        jobs = e.jobs(dither=table_rows(robot)) if dithered else e.jobs()
        jobs = [job for job in jobs if (job.amplitude_nm > 0) == dithered]
        with sums_in_float32(float32):
            for m in e.run(jobs, iterations=1):
                c = m.job.configuration
                row = {"tau": m.mean, "angle": m.traces[0].tolist()}
                out.setdefault(f"{c.joint} {c.load} {c.direction}", {})[engine] = row
    return out


def torque_line(row: Row) -> dict[str, float]:
    """Return how far a row's engines are apart."""
    pairs = [v for k, v in row.items() if k != "seconds"]
    tau = np.array([[p[e]["tau"] for e in ENGINES] for p in pairs])
    moved = []
    for p in pairs:
        a, b = (np.array(p[e]["angle"]) for e in ENGINES)
        still = int(0.9 * min(len(a), len(b)))
        moved.append(np.abs(a[:still] - b[:still]).max())
    return {
        "count": len(pairs),
        "least": float(np.abs(tau[:, 0]).min()),
        "most": float(np.abs(tau[:, 0]).max()),
        "apart": float(np.abs(tau[:, 1] / tau[:, 0] - 1).max()),
        "angle": float(max(moved)),
    }


# ---- environments --------------------------------------------------------------------------------


def episodes(robot: str, experiment: str) -> Row:
    """Return the largest differences over whole episodes under random actions."""
    seen = {engine: run(robot, experiment, engine) for engine in ENGINES}
    a, b = (seen[engine] for engine in ENGINES)
    both = [(p, q) for p, q in zip(a["steps"], b["steps"], strict=True)]
    return {
        "steps": [len(p) for p, _ in both],
        "steps_warp": [len(q) for _, q in both],
        "observation": max(_apart(p, q, 0) for p, q in both),
        "reward": max(_apart(p, q, 1) for p, q in both),
        "returns": [float(sum(r for _, r in p)) for p, _ in both],
        "returns_warp": [float(sum(r for _, r in q)) for _, q in both],
    }


def run(robot: str, experiment: str, engine: str) -> dict[str, Any]:
    register_all()
    make: Callable[..., ArmVectorEnv] = EXPERIMENTS[experiment].vector_class()
    core = make(EPISODES_EACH, robot=robot, engine=engine).core
    space = core.action_space
    rngs = [seeding.np_random(k)[0] for k in range(EPISODES_EACH)]
    ids = np.arange(EPISODES_EACH)
    core.reset(ids, rngs, [None] * EPISODES_EACH)
    steps: list[list[tuple[Any, float]]] = [[] for _ in ids]
    draws = [np.random.default_rng([7, k]) for k in range(EPISODES_EACH)]
    while len(ids):
        share = np.stack([draws[i].uniform(0, LARGEST_SHARE, space.shape) for i in ids])
        out = core.step(ids, space.low + share * (space.high - space.low))
        for i, observation, reward in zip(ids, core.observe(ids), out.reward, strict=True):
            steps[i].append((observation, float(reward)))
        ids = ids[~(out.terminated | out.truncated)]
    return {"steps": steps}


def _apart(a: list[tuple[Any, float]], b: list[tuple[Any, float]], what: int) -> float:
    pairs = zip(a, b, strict=False)
    return max(float(np.abs(np.asarray(p[what]) - q[what]).max()) for p, q in pairs)


# ---- every quantity, and rest under load ---------------------------------------------------------


def pushed(engine: str, parameters: FrictionParameters, servo: float = 0.0) -> Array:
    """Return angles (7, K, 7) of a Panda, shaken loose in seven poses [rad]."""
    sticking = build(load_arm("panda"), uneven())
    low, high = sticking.arm.limits.position.T
    q = np.random.default_rng(3).uniform(low + 0.4, high - 0.4, (7, 7))
    t = np.arange(300)[None, :, None] * CONTROL_DT
    size = np.linspace(0.5, 1.5, 7)[:, None, None] * sticking.parameters.stiction.max(axis=1)
    torque = 3 * size * np.sin(2 * np.pi * 5 * t) + 0.3 * np.sin(2 * np.pi * 40 * t)
    plant = Plant(sticking, 7, parameters=parameters, engine=engine)
    plant.reset(np.arange(7), q)
    stiffness = np.tile(servo * sticking.arm.limits.torque, (7, 1))
    plant.set_servo(np.arange(7), stiffness, 0.1 * stiffness, q)
    return plant.run(torque)


@cache
def uneven() -> FrictionParameters:
    """Return the Panda's friction with something of every quantity, other up than down."""
    p = build(load_arm("panda")).parameters
    by_direction = [n for n, q in QUANTITIES.items() if q.by_direction]
    down = {n: getattr(p, n) * [1.0, 0.8 if n == "coulomb_ratio" else 1.3] for n in by_direction}
    given = {
        **dict.fromkeys(("ripple_amplitude", "warm_up_friction", "warm_up_viscous"), 0.2),
        **{"load_coefficient": 0.03, "load_low": 0.0, "load_high": 20.0, "offset": 0.1},
        **{"gravity_error": 0.02, "warm_up_time": 1.0},
    }
    return p.replace(**down, **{n: np.full(7, x) for n, x in given.items()})


OTHER = {"load_low": 5.0, "load_high": 2.0}
"""Values of quantities that a factor would not change, or not within the loads there."""


def quantity(name: str) -> Row:
    """Return how far a change of a quantity moves the arm, and how far engines are then apart."""
    if name == "servo":
        there = [pushed(engine, uneven(), servo=8.0) for engine in ENGINES]
    else:
        own = getattr(uneven(), name)
        new = own * (0.8 if name.startswith(("coulomb", "bristle_stiff")) else 1.3)
        new = np.full_like(own, OTHER[name]) if name in OTHER else new
        new = own + 1.3 if name == "ripple_phase" else new
        there = [pushed(engine, uneven().replace(**{name: new})) for engine in ENGINES]
    moves = np.abs(there[0] - pushed("mujoco", uneven())).max()
    return {"moves": float(moves), "apart": float(np.abs(there[0] - there[1]).max())}


def rest(engine: str, factor: float, float32: bool = False) -> Row:
    """Return how far each joint of the Panda creeps under a share of its stiction [rad]."""
    smooth = load_friction("panda", 7).replace(ripple_amplitude=np.zeros(7))
    sticking = build(load_arm("panda"), smooth)
    with sums_in_float32(float32):
        plant, joints = Plant(sticking, 7, engine=engine), np.arange(7)
        plant.reset(joints, np.tile(sticking.arm.rest, (7, 1)))
        steps = round(WAIT_S / CONTROL_DT)
        plant.run(np.zeros((7, steps, 7)))  # the springs ring
        level = factor * plant.stiction[joints, joints] + plant.offset[joints, joints]
        torque = np.zeros((7, 2 * steps, 7))
        share = np.minimum(1.0, np.linspace(0.0, 2.0, 2 * steps))
        torque[joints, :, joints] = level[:, None] * share
        plant.run(torque)
        before = plant.position[joints, joints].copy()
        held = np.repeat(torque[:, -1:], round(SEEN_S / CONTROL_DT), axis=1)
        after = plant.run(held, joint=joints)[:, -1]
    start = sticking.arm.rest
    return {"creep": np.abs(after - before).tolist(), "moved": np.abs(after - start).tolist()}


# ---- time ----------------------------------------------------------------------------------------


def cost(engine: str) -> Row:
    """Return processor seconds of an arm's control step, the least of three runs."""
    sticking = build(load_arm("panda"))
    plant = Plant(sticking, ARMS, threads=1, engine=engine)
    torque = np.zeros((ARMS, STEPS, 7))
    seconds = []
    for _ in range(4):
        start = time.process_time()
        plant.run(torque)
        seconds.append(time.process_time() - start)
    return {"cost": min(seconds[1:]) / (ARMS * STEPS)}


# ---- the page ------------------------------------------------------------------------------------

ROBOTS = {"panda": "Panda", "iiwa7": "iiwa 7"}
JOBS: dict[str, Callable[[], Row]] = {
    **{f"cost {e}": partial(cost, e) for e in ENGINES},
    **{f"rest {e} {f}": partial(rest, e, f) for e in ENGINES for f in (HELD, PULLED)},
    **{f"rest float32 {f}": partial(rest, "warp", f, float32=True) for f in (HELD, PULLED)},
    **{f"quantity {name}": partial(quantity, name) for name in (*QUANTITIES, "servo")},
    **{f"torques {r}": partial(torques, r, dithered=False) for r in ROBOTS},
    **{f"dithered {r}": partial(torques, r, dithered=True) for r in ROBOTS},
    **{f"{x} {r}": partial(episodes, r, x) for x in ("sje", "gte") for r in ROBOTS},
    "float32 torques panda": partial(torques, "panda", dithered=False, float32=True),
    "float32 dithered panda": partial(torques, "panda", dithered=True, float32=True),
}
"""By the keys of their rows; the quick ones first."""


def card_values(kept: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page's template asks for of a graphics card."""
    rows = kept["rows"]
    lines = [rows[f"{kind} {r}"] for r in ROBOTS for kind in ("torques", "dithered")]
    seen = [rows[f"{x} {r}"] for x in ("sje", "gte") for r in ROBOTS]
    twice = [rows[f"twice {x} panda"] for x in ("sje", "gte")]
    rates = [
        [
            str(count),
            *(
                _millions(rows[f"throughput {x} {e} {count}"])
                for x in ("gte", "sje")
                for e in ENGINES
            ),
            _millions(rows[f"replayed {count}"]),
        ]
        for count in COUNTS
    ]
    columns = [f"{x}, {e}" for x in ("GTE", "SJE") for e in ("MuJoCo", "Warp")]
    trained = {e: rows[f"training sje {e}"] for e in ENGINES if f"training sje {e}" in rows}
    learnt = [
        [e, f"{r['seconds']:.0f}", *(short(r["returns"][x], 3) for x in ("none", "trained"))]
        for e, r in trained.items()
    ]
    heads = ["engine", "training and evaluations [s]", "return without dither", "trained"]
    return {
        **{name: kept[name] for name in ("card", "processors", "date", "versions")},
        "rates": table_text(["environments", *columns, "captured steps alone"], rates),
        "configurations": sum(x["count"] for x in lines),
        "worst": _percent(max(x["apart"] for x in lines)),
        "angle": short(1e6 * max(x["angle"] for x in lines), 2),
        "end": all(x["steps"] == x["steps_warp"] for x in seen),
        "observation": _power(max(x["observation"] for x in seen)),
        "reward": _power(max(x["reward"] for x in seen)),
        "same": all(x["same"] for x in twice),
        "steps": sum(x["steps"] for x in twice),
        "training": table_text(heads, learnt) if "warp" in trained else "",
    }


def page(rows: Mapping[str, Row], kept: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page's template asks for, of the rows and of a card's."""
    named = {
        **{f"torques {r}": f"{name}, no dither" for r, name in ROBOTS.items()},
        "dithered panda": "Panda, dither of Table 4.9",
        "dithered iiwa7": "iiwa 7, dither of the shipped table",
        "float32 torques panda": "Panda, no dither, all in float32",
        "float32 dithered panda": "Panda, Table 4.9, all in float32",
    }
    lines = {key: torque_line(rows[key]) for key in named if key in rows}
    breakaway = [
        [
            *(named[key], f"{x['count']:g}", f"{x['least']:.2f} to {x['most']:.2f}"),
            *(_percent(x["apart"]), short(1e6 * x["angle"], 2)),
        ]
        for key, x in lines.items()
    ]
    environments = {
        f"{r} {x}": rows[f"{x} {r}"] for x in ("sje", "gte") for r in ROBOTS if f"{x} {r}" in rows
    }
    seen = [
        [
            f"{ROBOTS[key.split()[0]].removesuffix(' 7').capitalize()}{key.split()[1].upper()}-v0",
            f"{sum(row['steps'])}",
            "yes" if row["steps"] == row["steps_warp"] else "no",
            *(_power(row[what]) for what in ("observation", "reward")),
            _power(np.abs(np.subtract(row["returns"], row["returns_warp"])).max()),
        ]
        for key, row in environments.items()
    ]
    quantities = {k.split()[1]: rows[k] for k in rows if k.startswith("quantity")}
    acts = [[n, short(1e3 * q["moves"], 2), _power(q["apart"])] for n, q in quantities.items()]
    resting = [
        [
            name,
            _power(max(rows[f"rest {key} {HELD}"]["creep"])),
            short(min(rows[f"rest {key} {PULLED}"]["moved"]), 2),
        ]
        for key, name in (
            ("mujoco", "MuJoCo"),
            ("warp", "MuJoCo Warp, angles and bristles in float64"),
            ("float32", "MuJoCo Warp, all in float32"),
        )
        if f"rest {key} {PULLED}" in rows
    ]
    costs = {e: rows[f"cost {e}"]["cost"] for e in ENGINES if f"cost {e}" in rows}
    angles = {
        key: short(1e6 * lines[name]["angle"], 2)
        for key, name in (("ours", "torques panda"), ("own", "float32 torques panda"))
        if name in lines
    }
    done = [x for key, x in lines.items() if not key.startswith("float32")]
    return {
        "breakaway": table_text(
            ["", "configurations", "τ [N·m]", "largest difference of τ", "of the angle [µrad]"],
            breakaway,
        ),
        "configurations": sum(int(x["count"]) for x in done),
        "worst": _percent(max(x["apart"] for x in done)),
        "environments": table_text(
            ["", "steps", "episodes end together", "observations", "rewards", "returns"], seen
        ),
        "observation": _power(max(row["observation"] for row in environments.values())),
        "reward": _power(max(row["reward"] for row in environments.values())),
        "acts": table_text(["", "its change moves a joint [mrad]", "engines differ [rad]"], acts),
        "quantities": len(quantities),
        "least_ratio": short(min(q["moves"] / q["apart"] for q in quantities.values()), 2),
        "rest": table_text(
            [
                "",
                f"most creep at {HELD:.0%} of stiction in {SEEN_S:.0f} s [rad]",
                f"least motion at {PULLED:.0%} [rad]",
            ],
            resting,
        ),
        "angles": angles,
        "card": card_values(kept),
        "costs": {e: short(1e6 * x, 2) for e, x in costs.items()},
        "ratio": short(costs["warp"] / costs["mujoco"], 2),
        "arms": ARMS,
        "each": EPISODES_EACH,
        "machine": platform.machine(),
        "versions": {p: metadata.version(p) for p in ("mujoco", "mujoco-warp", "warp-lang")},
    }


def _millions(row: Row) -> str:
    return short(row["rate"] / 1e6, 3)


def _percent(x: float) -> str:
    return "0" if x == 0 else f"{_power(100 * x)} %"


def _power(x: float) -> str:
    """Return a small number such as 3·10⁻⁶."""
    if x == 0:
        return "0"
    digits = f"{x:.0e}".split("e")
    return f"{digits[0]}·10{str(int(digits[1])).translate(_RAISED)}"


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def main() -> None:
    options = STUDY.parser().parse_args()
    found = STUDY.rows(options).fill(JOBS, lambda job: job(), minutes=options.minutes)
    kept = json.loads((STUDY.folder / CARD).read_text("utf-8"))
    STUDY.write_page(options, **page(found, kept))


if __name__ == "__main__":
    main()
