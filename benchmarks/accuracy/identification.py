"""Dynamics identification: excitation, consistent links, and the thesis's way beside ours.

python -m benchmarks.accuracy.identification [--quick]
"""

import dataclasses
import time
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.accuracy import imperfect_arms as excited
from benchmarks.harness import Benchmark, Row
from benchmarks.thesis.rosdyn import rosdyn
from stiction_envs.identification.excitation import excite
from stiction_envs.identification.identify import identify
from stiction_envs.identification.settings import excitation_settings
from stiction_envs.reporting.markdown import table_text
from stiction_envs.reporting.png import save_full
from stiction_envs.robots import Arm, load_arm
from stiction_envs.robots.regressor import columns_of, consistent, inertial_parameters

Array = NDArray[np.float64]
STUDY = Benchmark(__file__, __doc__)
RATE, NOISE, SIZE = 200.0, 0.1, 0.2
"""Rate [Hz] and torque noise [N·m] of simulated logs; error of the links [-]; assumed."""
REACH = 0.5
"""Largest angle of a joint that moves from pose to pose [rad]; assumed."""
AT_REST = "pose to pose, joints 1 and 2 at rest"
METHODS = ("nominal", "RosDyn's way", "base parameters", "consistent")
AT_ONCE = "optimised series, friction without presliding"
COLOURS = dict(zip(METHODS, ("0.75", "#b03a2e", "#5b8db8", "#d1701a"), strict=True))


def with_friction(arm: Arm, state: tuple[Array, Array, Array]) -> Array:
    """Return columns of links, Coulomb, viscous and offset along a motion, (T, n, 13 n)."""
    q, dq, _ = state
    own = np.stack([np.sign(excited.presliding(q, 1e-9)), dq, np.ones_like(q)], axis=2)
    return columns_of(arm.pinocchio(), *state, own)


# ---- simulated recordings ------------------------------------------------------------------------


def recordings(motion: Any, settings: Any, seed: int) -> dict[str, tuple[Arm, Any]]:
    """Return motions that were recorded, by name, and the arm they are of."""
    panda, iiwa = load_arm("panda"), load_arm("iiwa7")
    t = np.arange(round(20 * RATE)) / RATE
    # a search without iterations is its best random motion
    moving, resting = np.full(7, REACH), np.where(np.arange(7) < 2, 0.0, REACH)
    short = dataclasses.replace(settings, iterations=1, randoms=3, starts=1)
    random = excite(panda, short, seed=50 + seed)
    return {
        "optimised series": (panda, motion.state(t)),
        AT_ONCE: (panda, motion.state(t)),
        "random series": (panda, random.state(t)),
        "pose to pose": (panda, excited.from_pose_to_pose(panda, moving, 20.0, RATE, seed)),
        AT_REST: (iiwa, excited.from_pose_to_pose(iiwa, resting, 60.0, RATE, seed)),
    }


def simulated(motion: Any, settings: Any, seeds: int) -> dict[str, list[Row]]:
    """Return by recording and seed: errors of torque on another motion [N·m], masses, coverage."""
    rows: dict[str, list[Row]] = {}
    short = dataclasses.replace(settings, iterations=1, randoms=3)
    t = np.arange(0, 10, 0.02)
    other = {x: excite(x, short, seed=99).state(t) for x in ("panda", "iiwa7")}
    for seed in range(seeds):
        for name, (arm, state) in recordings(motion, settings, seed).items():
            true = excited.perturbed(arm, SIZE, seed)
            distance = 1e-7 if name == AT_ONCE else 2e-4
            log = excited.log(
                true, state, RATE, noise=NOISE, seed=seed, presliding_distance=distance
            )
            found, theirs = identify([log], arm, torque="link"), rosdyn([log], arm)
            columns, none = with_friction(arm, other[arm.name]), np.zeros(3 * arm.n)
            nominal = inertial_parameters(arm.pinocchio()).ravel()
            torques = {
                "nominal": columns @ np.concatenate([nominal, none]),
                "RosDyn's way": columns @ np.concatenate([theirs.parameters(), none[: arm.n]]),
                "base parameters": columns[:, :, found.base.kept] @ found.values,
                "consistent": columns
                @ np.concatenate([found.phi.ravel(), found.coulomb, found.viscous, found.offset]),
            }
            right = columns @ excited.truth(true)
            z = (found.values - found.base.values(excited.truth(true))) / found.errors
            rows.setdefault(name, []).append(
                {
                    "wrong": {
                        k: float(np.sqrt(np.mean((v - right) ** 2))) for k, v in torques.items()
                    },
                    "condition": found.condition,
                    "inside": float(np.mean(np.abs(z) < 1.96)),
                    "unsure": len(found.unsure),
                    "impossible": len(theirs.impossible),
                    "negative": len(theirs.negative_masses),
                    "exist": bool(consistent(found.phi).all()),
                    "ours": int((found.phi[:, 0] <= 0).sum()),
                }
            )
    return rows


# ---- page and picture ----------------------------------------------------------------------------


def page(motions: dict[str, Any], rows: dict[str, list[Row]]) -> dict[str, Any]:
    """Return what the page's template asks for."""
    optimised = rows["optimised series"]
    return {
        "errors": {k: np.mean([r["wrong"][k] for r in optimised]) for k in METHODS},
        "motions": _motions(motions),
        "recordings": _recordings(rows),
        "size": 100 * SIZE,
        "noise": NOISE,
        "rate": RATE,
        "arms": len(optimised),
    }


def _motions(motions: dict[str, Any]) -> str:
    header = ["robot", "optimised", "random, median", "random, best"]
    header += ["used of position, speed, acceleration, torque", "clearance", "search"]
    rows = [
        [
            name,
            f"{m.condition:.1f} ({m.condition_si:.0f})",
            *(f"{f(m.random_condition):.0f}" for f in (np.median, np.min)),
            ", ".join(f"{100 * v:.0f} %" for v in m.used.values()),
            f"{100 * m.clearance:.0f} cm",
            f"{took:.0f} s",
        ]
        for name, (m, took) in motions.items()
    ]
    return table_text(header, rows)


def _recordings(rows: dict[str, list[Row]]) -> str:
    header = ["recording", "κ", "error, nominal", "RosDyn's way", "base parameters", "consistent"]
    header += ["links that cannot exist: RosDyn / ours", "negative masses: RosDyn / ours"]
    header += ["true values in 95 % intervals", "hardly excited"]
    cells = []
    for name, runs in rows.items():
        mean = {k: float(np.mean([r[k] for r in runs])) for k in runs[0] if k != "wrong"}
        wrong = [np.mean([r["wrong"][k] for r in runs]) for k in METHODS]
        cells.append(
            [
                *(name, f"{mean['condition']:.3g}"),
                *(f"{x:.3g} N·m" for x in wrong),
                f"{mean['impossible']:.1f} / {1 - mean['exist']:.0f} of 7",
                f"{mean['negative']:.1f} / {mean['ours']:.0f}",
                f"{100 * mean['inside']:.0f} %",
                f"{mean['unsure']:.0f} of 64",
            ]
        )
    return table_text(header, cells)


def draw(rows: dict[str, list[Row]], path: Any) -> None:
    """Draw errors on another motion."""
    figure = Figure(figsize=(11, 3.4), layout="constrained")
    axes = figure.subplots()
    for k, method in enumerate(METHODS):
        values = np.array([[r["wrong"][method] for r in runs] for runs in rows.values()])
        at = np.arange(len(values)) + (k - 1.5) * 0.2
        axes.bar(at, values.mean(axis=1), 0.18, color=COLOURS[method], label=method)
        axes.scatter(at[:, None] + 0 * values, values, s=8, color="black", zorder=3)
    axes.set(yscale="log", ylabel="error of torque on\nanother motion [N·m]")
    axes.set_xticks(range(len(rows)), [n.replace(", ", ",\n") for n in rows])
    axes.set_title("Simulated: nominal and identified arms (dots: single arms)")
    axes.legend(ncols=4, fontsize=8, loc="upper left")
    axes.grid(axis="y", alpha=0.25)
    save_full(figure, path)


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--quick", action="store_true", help="few iterations and arms")
    options = parser.parse_args()
    start = time.perf_counter()
    settings = excitation_settings()
    if options.quick:
        settings = dataclasses.replace(settings, iterations=15, starts=1, randoms=5)
    motions = {}
    for name in ("panda", "iiwa7", "iiwa14"):
        began = time.perf_counter()
        motion = excite(name, settings, sweeps=True, seed=0)
        motions[name] = motion, time.perf_counter() - began
    panda = motions["panda"][0]
    rows = simulated(panda, settings, 2 if options.quick else 8)
    values = page(motions, rows)
    STUDY.write_page(options, seconds=time.perf_counter() - start, **values)
    draw(rows, options.out / "identification.png")
    panda.plot(options.out / "identification_excitation.png")


if __name__ == "__main__":
    main()
