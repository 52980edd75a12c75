"""Dynamics identification: excitation, consistent links, and the thesis's way beside ours.

    python -m benchmarks.accuracy.identification [--quick]

The real recording is read from ../shared/measured where it is there.
"""

from __future__ import annotations

import csv
import time

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness import MEASURED, ROOT, Benchmark
from benchmarks.thesis.rosdyn import rosdyn
from stiction_envs.gap.settings import gap_settings
from stiction_envs.gap.signals.dataset import assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.hidden import excited_logs as excited
from stiction_envs.identification.excitation import excite
from stiction_envs.identification.identify import FOLDS, MODELS, identify
from stiction_envs.identification.settings import identification_settings
from stiction_envs.measured.logs.reader import JointLog, read_logs
from stiction_envs.reporting.markdown import table_text
from stiction_envs.reporting.png import save_full
from stiction_envs.robots import load_arm
from stiction_envs.robots.regressor import consistent, inertial_parameters, torque_regressor

STUDY = Benchmark(__file__, __doc__)
REAL = MEASURED / "panda_exciting_trajectory/panda_exciting_trajectory.csv.gz"
TABLE_4_1 = ROOT / "stiction_envs/measured/thesis/table_4_1.csv"
RATE, NOISE, SIZE = 200.0, 0.1, 0.2
RESTING = np.array([0.0, 0.0, 0.5, 0.5, 0.5, 0.5, 0.5])
RESTING_WORDS = "joints 1 and 2 at rest"
AT_REST = f"pose to pose, {RESTING_WORDS}"
METHODS = ("nominal", "RosDyn's way", "base parameters", "consistent")
COUNTS = ("condition", "impossible", "negative", "inside", "unsure")
AT_ONCE = "optimised series, friction without presliding"
FILTERED = "RosDyn's way, filtered signals"
COLOURS = {"nominal": "0.75", "nominal + friction": "0.45", "RosDyn's way": "#b03a2e"}
COLOURS |= {FILTERED: "#e6a49b", "base parameters": "#5b8db8", "consistent": "#d1701a"}
ORDER = (*MODELS[:2], "RosDyn's way", FILTERED, *MODELS[2:])


def with_friction(arm, state):
    """Columns of links, Coulomb, viscous and offset along a motion, (T, n, 13 n)."""
    q, dq, ddq = state
    n = arm.n
    own = np.zeros((len(q), n, 3, n))
    j = np.arange(n)
    own[:, j, 0, j], own[:, j, 1, j], own[:, j, 2, j] = excited.direction(dq), dq, 1.0
    links = torque_regressor(arm.pinocchio(), q, dq, ddq)
    return np.concatenate([links, own.reshape(len(q), n, -1)], axis=2)


def rms(x):
    return np.sqrt(np.mean(np.square(x), axis=0))


# ---- excitation ----------------------------------------------------------------------------------


def excitations(settings):
    """Conditions by robot; the Panda's motion is kept."""
    out = {}
    for name in ("panda", "iiwa7", "iiwa14"):
        start = time.perf_counter()
        motion = excite(name, settings, sweeps=True, seed=0)
        out[name] = motion, time.perf_counter() - start
    return out


# ---- simulated recordings ------------------------------------------------------------------------


def recordings(motion, settings, seed):
    """Motions of 20 s that were recorded, by name, and the arm they are of."""
    panda, iiwa = load_arm("panda"), load_arm("iiwa7")
    t = np.arange(round(20 * RATE)) / RATE
    # a search without iterations is its best random motion
    random = excite(panda, settings.replace(iterations=1, randoms=3, starts=1), seed=50 + seed)
    half = np.full(7, 0.5)
    return {
        "optimised series": (panda, motion.state(t)),
        AT_ONCE: (panda, motion.state(t)),
        "random series": (panda, random.state(t)),
        "pose to pose": (panda, excited.from_pose_to_pose(panda, half, 20.0, RATE, seed)),
        AT_REST: (
            iiwa,
            excited.from_pose_to_pose(iiwa, RESTING, 60.0, RATE, seed),
        ),
    }


def simulated(motion, settings, seeds):
    """By recording and method: error of torque on another motion [N·m], masses, coverage."""
    rows = {}
    check = excite("panda", settings.replace(iterations=1, randoms=3), seed=99)
    other = {"panda": check.state(np.arange(0, 10, 0.02))}
    other["iiwa7"] = excite("iiwa7", settings.replace(iterations=1, randoms=3), seed=99).state(
        np.arange(0, 10, 0.02)
    )
    for seed in range(seeds):
        for name, (arm, state) in recordings(motion, settings, seed).items():
            true = excited.perturbed(arm, SIZE, seed)
            distance = 1e-7 if name == AT_ONCE else 2e-4
            log = excited.log(
                true, state, RATE, noise=NOISE, seed=seed, presliding_distance=distance
            )
            found = identify([log], arm, torque="link")
            theirs = rosdyn([log], arm)
            columns = with_friction(arm, other[arm.name])
            right = columns @ excited.truth(true)
            nominal = np.concatenate(
                [inertial_parameters(arm.pinocchio()).ravel(), np.zeros(3 * arm.n)]
            )
            ours = [found.phi.ravel(), found.coulomb, found.viscous, found.offset]
            wrong = {
                "nominal": columns @ nominal - right,
                "RosDyn's way": columns @ np.concatenate([theirs.parameters(), np.zeros(arm.n)])
                - right,
                "base parameters": columns[:, :, found.base.kept] @ found.values - right,
                "consistent": columns @ np.concatenate(ours) - right,
            }
            z = (found.values - found.base.values(excited.truth(true))) / found.errors
            rows.setdefault(name, []).append(
                {
                    "wrong": {k: float(np.sqrt(np.mean(v**2))) for k, v in wrong.items()},
                    "condition": found.condition,
                    "inside": float(np.mean(np.abs(z) < 1.96)),
                    "unsure": len(found.unsure),
                    "impossible": len(theirs.impossible),
                    "negative": len(theirs.negative_masses),
                    "exist": bool(consistent(found.phi).all()),
                    "theirs": theirs.phi[:, 0],
                    "ours": found.phi[:, 0],
                    "true": inertial_parameters(true.pinocchio())[:, 0],
                }
            )
    return rows


def printed_masses():
    with TABLE_4_1.open() as file:
        found = {(r["joint"], r["quantity"]): float(r["value"]) for r in csv.DictReader(file)}
    return np.array([found[str(j), "mass"] for j in range(1, 8)])


def alike(masses, nominal):
    """Cosine between two patterns of wrong masses of links 3 to 7."""
    a, b = (masses - nominal)[2:], (printed_masses() - nominal)[2:]
    return float(abs(a @ b) / np.linalg.norm(a) / np.linalg.norm(b))


# ---- the real Panda ------------------------------------------------------------------------------


def real():
    """Held-out residual by model, (7,) each, the result, and what RosDyn's way gives; or None."""
    if not REAL.is_file():
        return None
    arm = load_arm("panda")
    logs = read_logs([REAL], 7, limits=arm.limits)
    found = identify(logs, arm, torque="link")
    held = dict(found.rms)
    # theirs: fitted to the same parts of the time, judged on the others through the same filter
    data = assemble(arm, prepare(logs), torque="link")
    folds, guard = FOLDS, data.settings.recording.guard
    smooth = JointLog(source="filtered", t=data.t, q=data.q, dq=data.dq, tau=data.tau)
    for name, log in (("RosDyn's way", logs[0]), (FILTERED, smooth)):
        squares, count = np.zeros(7), 0
        for fold in np.array_split(np.arange(data.block.max() + 1), folds):
            test = np.isin(data.block, fold)
            low, high = data.t[test].min() - guard, data.t[test].max() + guard
            fit = rosdyn([without(log, low, high)], arm)
            columns = with_friction(arm, (data.q[test], data.dq[test], data.ddq[test]))
            left = data.tau[test] - columns @ np.concatenate([fit.parameters(), np.zeros(7)])
            squares += np.square(left).sum(axis=0)
            count += len(left)
        held[name] = np.sqrt(squares / count)
    return held, found, rosdyn(logs, arm)


def without(log, low, high):
    """Return the log without the time from ``low`` to ``high`` [s]."""
    rows = (log.t < low) | (log.t > high)
    t = log.t[rows]
    seams = np.flatnonzero(np.diff(t) > gap_settings().recording.guard) + 1
    dq = None if log.dq is None else log.dq[rows]
    q, tau, breaks = log.q[rows], log.tau[rows], tuple(seams.tolist())
    return JointLog(source=log.source, t=t, q=q, dq=dq, tau=tau, breaks=breaks)


def at_rest():
    """Which joints rest: likeness of the wrong masses to Table 4.1, and their size [kg]."""
    arm = load_arm("iiwa7")
    nominal = inertial_parameters(arm.pinocchio())[:, 0]
    out = {}
    for resting in ((), (1,), (2,), (3,), (1, 2), (1, 3), (2, 3), (1, 2, 3), (1, 2, 4), (6, 7)):
        reach = np.where(np.isin(np.arange(1, 8), resting), 0.0, 0.5)
        state = excited.from_pose_to_pose(arm, reach, 30.0, RATE, 1)
        log = excited.log(excited.perturbed(arm, SIZE, 1), state, RATE, noise=NOISE, seed=1)
        masses = rosdyn([log], arm).phi[:, 0]
        out[resting] = alike(masses, nominal), float(np.abs(masses - nominal).max())
    return out


# ---- page and picture ----------------------------------------------------------------------------


def page(motions, rows, rests, measured):
    """Return what the page's template asks for."""
    nominal = inertial_parameters(load_arm("iiwa7").pinocchio())[:, 0]
    resting = rows[AT_REST]
    pattern = [alike(r["theirs"], nominal) for r in resting]
    errors = {k: np.mean([r["wrong"][k] for r in rows["optimised series"]]) for k in METHODS}
    return {
        "errors": errors,
        "motions": _motions(motions),
        "recordings": _recordings(rows),
        "size": 100 * SIZE,
        "noise": NOISE,
        "rate": RATE,
        "arms": len(resting),
        "masses": table_text(
            ["link", *(str(j) for j in range(1, 8))],
            [
                ["mass, Table 4.1 [kg]", *(f"{m:.5g}" for m in printed_masses())],
                [f"RosDyn's way, {RESTING_WORDS}", *(f"{m:.5g}" for m in resting[0]["theirs"])],
                ["ours, same recording", *(f"{m:.3g}" for m in resting[0]["ours"])],
                ["true", *(f"{m:.3g}" for m in resting[0]["true"])],
            ],
        ),
        "pattern": [min(pattern), max(pattern)],
        "rests": table_text(
            ["joints at rest", "cosine with Table 4.1", "largest wrong mass [kg]"],
            [
                [", ".join(map(str, k)) or "none", f"{c:.4f}", f"{m:.3g}"]
                for k, (c, m) in rests.items()
            ],
        ),
        "real": None if measured is None else _real(*measured),
    }


def _motions(motions):
    header = ["robot", "optimised", "random, median", "random, best"]
    header += ["used of position, speed, acceleration, torque", "clearance", "search"]
    rows = [
        [
            name,
            f"{m.condition:.1f} ({m.condition_si:.0f})",
            f"{np.median(m.random_condition):.0f}",
            f"{m.random_condition.min():.0f}",
            ", ".join(f"{100 * v:.0f} %" for v in m.used.values()),
            f"{100 * m.clearance:.0f} cm",
            f"{took:.0f} s",
        ]
        for name, (m, took) in motions.items()
    ]
    return table_text(header, rows)


def _recordings(rows):
    header = ["recording", "κ", "error, nominal", "RosDyn's way", "base parameters", "consistent"]
    header += ["links that cannot exist: RosDyn / ours", "negative masses: RosDyn / ours"]
    header += ["true values in 95 % intervals", "hardly excited"]
    cells = []
    for name, runs in rows.items():
        mean = {k: np.mean([r[k] for r in runs]) for k in COUNTS}
        wrong = [np.mean([r["wrong"][k] for r in runs]) for k in METHODS]
        mine = np.mean([(r["ours"] <= 0).sum() for r in runs])
        cells.append(
            [
                *(name, f"{mean['condition']:.3g}"),
                *(f"{x:.3g} N·m" for x in wrong),
                f"{mean['impossible']:.1f} / {np.mean([not r['exist'] for r in runs]):.0f} of 7",
                f"{mean['negative']:.1f} / {mine:.0f}",
                f"{100 * mean['inside']:.0f} %",
                f"{mean['unsure']:.0f} of 64",
            ]
        )
    return table_text(header, cells)


def _real(held, found, theirs):
    return {
        "condition": found.condition,
        "held": table_text(
            ["model", *(f"joint {j}" for j in range(1, 8))],
            [[name, *(f"{x:.3g}" for x in held[name])] for name in ORDER],
        ),
        "gain": found.gain_percent,
        "impossible": len(theirs.impossible),
        "identified": found.page()[found.page().find("| link") :],
    }


def draw(rows, measured, path):
    figure = Figure(figsize=(11, 9), layout="constrained")
    one, two, three = figure.subplots(3, 1)
    names = list(rows)
    for k, method in enumerate(METHODS):
        for i, name in enumerate(names):
            values = [r["wrong"][method] for r in rows[name]]
            at = i + (k - 1.5) * 0.2
            one.bar(at, np.mean(values), 0.18, color=COLOURS[method], label=method if not i else "")
            one.scatter([at] * len(values), values, s=8, color="black", zorder=3)
    one.set(yscale="log", ylabel="error of torque on\nanother motion [N·m]")
    one.set_xticks(range(len(names)), [n.replace(", ", ",\n") for n in names])
    one.set_title("Simulated: nominal and identified arms (dots: single arms)")
    one.legend(ncols=4, fontsize=8, loc="upper left")
    one.grid(axis="y", alpha=0.25)

    resting = rows[AT_REST][0]
    nominal = inertial_parameters(load_arm("iiwa7").pinocchio())[:, 0]
    wrong, printed = resting["theirs"] - nominal, printed_masses() - nominal
    shown = nominal + wrong * (wrong[2:] @ printed[2:]) / (wrong[2:] @ wrong[2:])
    series = (
        ("Table 4.1", printed_masses(), "0.35"),
        (
            "RosDyn's way, joints 1 and 2 at rest; errors scaled to the table's",
            shown,
            COLOURS["RosDyn's way"],
        ),
        ("ours, same recording, not scaled", resting["ours"], COLOURS["consistent"]),
        ("true", resting["true"], "0.75"),
    )
    for k, (name, masses, colour) in enumerate(series):
        two.bar(np.arange(1, 8) + (k - 1.5) * 0.2, masses, 0.18, color=colour, label=name)
    two.set_yscale("symlog", linthresh=5)
    two.axhline(0, color="black", lw=0.8)
    two.set(ylabel="mass [kg]", xlabel="link", title="The thesis's iiwa masses")
    two.set_xticks(range(1, 8))
    two.legend(fontsize=8, ncols=2, loc="lower right")

    if measured is None:
        three.text(0.5, 0.5, "real recording not there", ha="center")
        three.set_axis_off()
    else:
        held = measured[0]
        for k, name in enumerate(ORDER):
            at = np.arange(1, 8) + (k - 2.5) * 0.14
            three.bar(at, held[name], 0.12, color=COLOURS[name], label=name)
        three.set(ylabel="held-out residual [N·m]", xlabel="joint", title="Real Panda, 20 s")
        three.set_xticks(range(1, 8))
        three.legend(ncols=3, fontsize=8)
        three.grid(axis="y", alpha=0.25)
    save_full(figure, path)


def main():
    parser = STUDY.parser()
    parser.add_argument("--quick", action="store_true", help="few iterations and arms")
    options = parser.parse_args()
    start = time.perf_counter()
    settings = identification_settings().excitation
    if options.quick:
        settings = settings.replace(iterations=15, starts=1, randoms=5)
    motions = excitations(settings)
    panda = motions["panda"][0]
    rows = simulated(panda, settings, 2 if options.quick else 8)
    rests, measured = at_rest(), real()
    seconds = time.perf_counter() - start
    STUDY.write_page(options, seconds=seconds, **page(motions, rows, rests, measured))
    draw(rows, measured, options.out / "identification.png")
    panda.plot(options.out / "identification_excitation.png")


if __name__ == "__main__":
    main()
