"""Dynamics identification: excitation, links that can exist, and the thesis's way beside ours.

    python benchmarks/identification.py [--quick]

Writes identification.md, identification.png and identification_excitation.png beside this file. The
real recording is read from ../shared/measured/panda_exciting_trajectory where it is there.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).parents[1]))

from stiction_envs.gap.settings import gap_settings
from stiction_envs.gap.signals.dataset import assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.identification.excitation import excite
from stiction_envs.identification.identify import MODELS, identify
from stiction_envs.identification.settings import identification_settings
from stiction_envs.measured.logs.reader import JointLog, read_logs
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.markdown import table
from stiction_envs.reporting.png import save_full
from stiction_envs.robots import load_arm
from stiction_envs.robots.regressor import consistent, inertial_parameters, torque_regressor
from stiction_envs.testing import excited_logs as excited
from stiction_envs.thesis.rosdyn import rosdyn

HERE = Path(__file__).parent
REAL = HERE.parents[1] / "shared/measured/panda_exciting_trajectory"
TABLE_4_1 = HERE.parent / "stiction_envs/measured/thesis/table_4_1.csv"
RATE, NOISE, SIZE = 200.0, 0.1, 0.2
RESTING = np.array([0.0, 0.0, 0.5, 0.5, 0.5, 0.5, 0.5])
AT_ONCE = "optimised series, friction without presliding"
RAW = "RosDyn's way"
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
        "pose to pose, joints 1 and 2 at rest": (
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
            bite = 1e-7 if name == AT_ONCE else 2e-4
            log = excited.log(true, state, RATE, noise=NOISE, seed=seed, bite=bite)
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
    path = REAL / "panda_exciting_trajectory.csv.gz"
    if not path.is_file():
        return None
    arm = load_arm("panda")
    logs = read_logs([path], 7, limits=arm.limits)
    found = identify(logs, arm, torque="link")
    held = dict(found.rms)
    # theirs: fitted to the same parts of the time, judged on the others through the same filter
    data = assemble(arm, prepare(logs), link_side=True)
    folds, guard = identification_settings().validation.folds, data.settings.recording.guard
    smooth = JointLog(
        source="filtered",
        t=data.t.copy(),
        q=data.q.copy(),
        dq=data.dq.copy(),
        tau=data.tau.copy(),
    )
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
    """The log without the time from ``low`` to ``high`` [s]."""
    rows = (log.t < low) | (log.t > high)
    t = log.t[rows]
    return JointLog(
        source=log.source,
        t=t.copy(),
        q=log.q[rows].copy(),
        dq=None if log.dq is None else log.dq[rows].copy(),
        tau=log.tau[rows].copy(),
        breaks=tuple((np.flatnonzero(np.diff(t) > gap_settings().recording.guard) + 1).tolist()),
    )


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


def page(motions, rows, rests, measured, seconds):
    iiwa = load_arm("iiwa7")
    nominal = inertial_parameters(iiwa.pinocchio())[:, 0]
    resting = rows["pose to pose, joints 1 and 2 at rest"]
    lines = [
        "# Dynamics identification",
        "",
        f"Made by `python benchmarks/identification.py` in {seconds:.0f} s; pictures: "
        "`identification.png`, `identification_excitation.png`.",
        "",
        "## Excitation",
        "",
        "Condition number κ of the regressor of all base parameters and friction, rows over torque "
        "limits, columns over their size in the allowed range; in brackets in SI units. Random "
        "motions keep the same limits.",
        "",
        *table(
            [
                *("robot", "optimised", "random, median", "random, best"),
                *("used of position, speed, acceleration, torque", "clearance", "search"),
            ],
            [
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
            ],
        ),
        "## Simulated recordings",
        "",
        f"True links differ from the nominal ones by about {100 * SIZE:.0f} % (J → A J Aᵀ); "
        f"Coulomb, viscous and constant torque; {NOISE} N·m of torque noise, 10 µrad of angle "
        f"noise at {RATE:.0f} Hz; mean of {len(resting)} arms. Torques are MuJoCo's, the fit is "
        "pinocchio's. Error: torque without noise on *another* motion over the whole range, "
        "root mean square over joints and time. RosDyn's way is its least squares, written anew "
        "(`thesis/rosdyn.py`), on raw differences of the angles.",
        "",
    ]
    header = ["recording", "κ", "error, nominal", "RosDyn's way", "base parameters", "consistent"]
    header += ["links that cannot exist: RosDyn / ours", "negative masses: RosDyn / ours"]
    header += ["true values in 95 % intervals", "hardly excited"]
    cells = []
    for name, runs in rows.items():
        wrong = {k: np.mean([r["wrong"][k] for r in runs]) for k in runs[0]["wrong"]}
        impossible = np.mean([r["impossible"] for r in runs])
        ours = np.mean([not r["exist"] for r in runs])
        negative = np.mean([r["negative"] for r in runs])
        mine = np.mean([(r["ours"] <= 0).sum() for r in runs])
        cells.append(
            [
                name,
                f"{np.mean([r['condition'] for r in runs]):.3g}",
                *(f"{x:.3g} N·m" for x in wrong.values()),
                f"{impossible:.1f} / {ours:.0f} of 7",
                f"{negative:.1f} / {mine:.0f}",
                f"{100 * np.mean([r['inside'] for r in runs]):.0f} %",
                f"{np.mean([r['unsure'] for r in runs]):.0f} of 64",
            ]
        )
    pattern = [alike(r["theirs"], nominal) for r in resting]
    lines += [
        *table(header, cells),
        "The intervals are of what the model leaves, not of what it lacks. Where joints 1 and 2 "
        "rest, some sums of parameters act on no torque, though they would in another motion. "
        "RosDyn's basis keeps them, so noise is divided by almost nothing. Base parameters alone "
        "are no better there; their errors say so, and the links follow the nominal: on a motion "
        "that does move those joints they are as wrong as it is.",
        "",
        "## Table 4.1 of the thesis",
        "",
        *table(
            ["link", *(str(j) for j in range(1, 8))],
            [
                ["mass, Table 4.1 [kg]", *(f"{m:.5g}" for m in printed_masses())],
                [
                    "RosDyn's way, joints 1 and 2 at rest",
                    *(f"{m:.5g}" for m in resting[0]["theirs"]),
                ],
                ["ours, same recording", *(f"{m:.3g}" for m in resting[0]["ours"])],
                ["true", *(f"{m:.3g}" for m in resting[0]["true"])],
            ],
        ),
        "The wrong masses of links 3 to 7 stand in the same proportion to one another as in the "
        f"printed table (cosine {min(pattern):.4f} to {max(pattern):.4f} over the arms; links 4 "
        "to 7 wrong alike and link 3 right would be 0.992). Table 4.1 also prints viscous friction "
        "of −128 728 and 202 673 N·m·s/rad for joints 1 and 2 and ordinary values for the others. "
        "Which joints rest decides, by the same way of fitting:",
        "",
        *table(
            ["joints at rest", "cosine with Table 4.1", "largest wrong mass [kg]"],
            [
                [", ".join(map(str, k)) or "none", f"{c:.4f}", f"{m:.3g}"]
                for k, (c, m) in rests.items()
            ],
        ),
        "The table's masses come out, up to one factor, whenever **joint 2 hardly moves**; its "
        "viscous values say the same of joints 1 and 2. It is an inference: the recording is not "
        "published. The factor is noise over almost nothing and says nothing.",
        "",
        "## Real Panda",
        "",
    ]
    if measured is None:
        lines.append(f"Skipped: `{REAL.name}` is not there.")
        return "\n".join(lines) + "\n"
    held, found, theirs = measured
    lines += [
        "20 s of excitation (Gaz et al. 2019), link-side torque; residual [N·m] on time that was "
        f"not used for the fit. κ = {found.condition:.1f}.",
        "",
        *table(
            ["model", *(f"joint {j}" for j in range(1, 8))],
            [[name, *(f"{x:.3g}" for x in held[name])] for name in ORDER],
        ),
        f"Links that can exist leave {found.gain_percent:.0f} % less than the nominal with fitted "
        "friction (mean of joints). The nominal links are those of Gaz et al., who identified them "
        "from recordings like this one, so it is a strong opponent. RosDyn's way is held out "
        "alike; it uses logged speeds and their differences, and has no constant torque. On our "
        "filtered signals the same least squares does well: what breaks it here is the noise of "
        f"raw accelerations. From raw signals {len(theirs.impossible)} of its 7 links cannot "
        "exist, none of ours.",
        "",
        "Whether `q` in this log is measured or desired is not known (its README): what the "
        "tracking error adds is in the residual.",
        "",
        found.page()[found.page().find("| link") :],
    ]
    return "\n".join(lines).rstrip() + "\n"


def picture(rows, measured, path):
    figure = Figure(figsize=(11, 9), layout="constrained")
    one, two, three = figure.subplots(3, 1)
    methods = ("nominal", "RosDyn's way", "base parameters", "consistent")
    names = list(rows)
    for k, method in enumerate(methods):
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

    resting = rows["pose to pose, joints 1 and 2 at rest"][0]
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
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few iterations and arms")
    parser.add_argument("--out", type=Path, default=HERE)
    args = parser.parse_args()
    start = time.perf_counter()
    settings = identification_settings().excitation
    if args.quick:
        settings = settings.replace(iterations=15, starts=1, randoms=5)
    motions = excitations(settings)
    panda = motions["panda"][0]
    rows = simulated(panda, settings, 2 if args.quick else 8)
    rests, measured = at_rest(), real()
    text = page(motions, rows, rests, measured, time.perf_counter() - start)
    write_text_atomic(args.out / "identification.md", text)
    picture(rows, measured, args.out / "identification.png")
    panda.plot(args.out / "identification_excitation.png")
    print(text[: text.find("| link | mass")])


if __name__ == "__main__":
    main()
