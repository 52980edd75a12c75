"""What must not change while the code does: one hash per result, compared with those of before.

    python -m benchmarks.freeze --write      # before: hashes of every result into freeze.json
    python -m benchmarks.freeze              # after every step: which results are other bits
    python -m benchmarks.freeze --only gte   # some of them

    python -m benchmarks.freeze --write-quick   # a few results into benchmarks/freeze.json

Hashes hold on one machine only (compilers and linear algebra differ in last bits), so those of
``--work`` are not kept in the repository. ``benchmarks/freeze.json`` has a few numbers instead,
which hold on other machines with the pinned versions: `tests/test_freeze.py` compares them.
``final`` (the tuner) takes minutes: it runs with ``--all`` or by name.
"""

import argparse
import hashlib
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

TABLE_4_3 = Path(__file__).parents[1] / "stiction_envs" / "measured" / "thesis" / "table_4_3.csv"
SLOW = ("final",)
WORDS = {"evidence", "notes", "record_next", "summary"}
"""Sentences of ``diagnosis.json``: hashed apart, since wording may change where numbers may not."""
HIDDEN: tuple[tuple[str, int, tuple[str, ...], str, int | None], ...] = (
    # name, seed, causes, motion, joint
    ("nothing", 1, (), "fourier", None),
    ("coulomb", 2, ("coulomb_friction",), "reversals", 3),
    ("stribeck", 3, ("stribeck_friction",), "sweeps", 4),
    ("load", 4, ("load_dependent_friction",), "fourier", 2),
    ("bristle", 5, ("presliding_hysteresis",), "reversals", 5),
    ("ripple_drift", 6, ("position_dependent_friction", "warm_up_drift"), "sweeps", 4),
    ("offset_scale", 7, ("torque_offset", "torque_scale"), "poses", 2),
    ("payload_viscous", 8, ("payload", "viscous_friction"), "fourier", 6),
    ("tilt", 9, ("base_tilt",), "poses", None),
    ("elasticity_inertia", 11, ("joint_elasticity", "link_inertia"), "chirp", 2),
    ("delay_spring", 12, ("actuator_delay", "external_spring"), "fast", 5),
)
SHORT = "--iterations 2 --dither {dither}"
ROLLOUTS = {"PandaSJE-v0": 60, "IiwaSJE-v0": 40, "PandaGTE-v0": 60, "IiwaGTE-v0": 40}
"""Steps per environment."""


def stiction(out: Path, *arguments: object) -> Path:
    """Run a command of this checkout; return its output folder."""
    code = "import sys; from stiction_envs.cli import main; sys.exit(main(sys.argv[1:]))"
    words = [sys.executable, "-c", code, *map(str, arguments), "--out", str(out), "--force"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(words[3:])}\n{done.stderr}")
    return out


def dither_table(work: Path) -> Path:
    """Return an amplitude table."""
    path = work / "dither.csv"
    path.write_text("joint,frequency_hz,amplitude_nm\n7,15,0.6\n4,30,1.2\n", "utf-8")
    return path


def file_hash(*paths: Path) -> str:
    """Return the hash of files, one after the other."""
    digest = hashlib.sha256()
    for path in paths:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def hidden_logs(work: Path) -> dict[str, tuple[Path, list[str]]]:
    """Return log and options of every hidden case; made once, so that only `diagnose` is judged."""
    from stiction_envs.friction.parameters import QUANTITIES, dump_friction
    from stiction_envs.hidden.hidden_logs import make_case

    out = {}
    for name, seed, causes, motion, joint in HIDDEN:
        log, table = work / f"{name}.npz", work / f"{name}.toml"
        if not log.is_file():
            case = make_case(seed, causes, motion=motion, joint=joint, seconds=20.0, size=0.7)
            if not isinstance(case.nominal, str):
                sources = dict.fromkeys(QUANTITIES, "hidden")
                text = dump_friction(case.nominal, sources=sources, meta={}, provenance={})
                table.write_text(text, "utf-8")
            made = case.logs[0]
            np.savez(log, t=made.t, q=made.q, tau=made.tau)
        out[name] = (log, ["--nominal", str(table)] if table.is_file() else [])
    return out


def without_words(value: Any) -> Any:
    """Return the JSON without its sentences."""
    if isinstance(value, dict):
        return {k: without_words(v) for k, v in value.items() if k not in WORDS}
    return [without_words(v) for v in value] if isinstance(value, list) else value


def diagnoses(work: Path) -> Iterable[tuple[str, str]]:
    """Yield numbers and words of every hidden log's ``diagnosis.json``, and of its models."""
    for name, (log, options) in hidden_logs(work).items():
        words = ["diagnose", log, "--robot", "panda", *options]
        out = stiction(work / f"diagnose-{name}", *words)
        text = (out / "diagnosis.json").read_text("utf-8")
        numbers = json.dumps(without_words(json.loads(text)), sort_keys=True)
        yield f"diagnose.{name}", hashlib.sha256(numbers.encode()).hexdigest()[:16]
        yield f"diagnose.{name}.words", file_hash(out / "diagnosis.json")
        yield f"diagnose.{name}.model.xml", file_hash(out / "model.xml")


COMMANDS: dict[str, dict[str, tuple[str, str]]] = {
    "experiments": {
        **{f"sje.{x}": (f"sje {x} {SHORT} --joint 7 4", "sje.csv") for x in ("panda", "iiwa7")},
        **{f"export.{x}": (f"export {x}", "model.xml") for x in ("panda", "iiwa7")},
    },
    "gte": {
        f"gte.{robot}.{path}": (
            f"gte {robot} {SHORT} --trajectory {path} --stiffness {stiffness}",
            "errors.csv",
        )
        for robot, path, stiffness in (
            ("panda", "triangle", "200 20 0"),
            ("panda", "pentagon", "800 80 10"),
            ("iiwa14", "triangle", "200 20 0"),
        )
    },
    "excitation": {"excite": ("excite panda", "*.csv")},
    "final": {"tune": (f"tune panda --table {TABLE_4_3}", "*.csv")},
}
"""By part and name of its results: a command, ``{dither}`` an amplitude table, and its files."""


def commands(part: str, work: Path) -> Iterable[tuple[str, str]]:
    """Yield the files that the commands of a part write."""
    for name, (command, files) in COMMANDS[part].items():
        out = stiction(work / name, *command.format(dither=dither_table(work)).split())
        for path in sorted(out.glob(files)):
            yield f"{name}.{path.stem}" if "*" in files else name, file_hash(path)


def calibrate(work: Path) -> Iterable[tuple[str, str]]:
    """Yield an arm's friction from Table 4.3."""
    out = stiction(work / "friction.toml", "calibrate", "panda", TABLE_4_3)
    lines = [x for x in out.read_text("utf-8").splitlines() if "commit" not in x]
    yield "calibrate", hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def steps_of(name: str, count: int, steps: int) -> Iterator[tuple[Any, ...]]:
    """Yield what an environment says of the same actions: observations alone after a reset."""
    import gymnasium as gym

    import stiction_envs  # noqa: F401

    env = gym.make_vec(name, num_envs=count) if count > 1 else gym.make(name)
    env.action_space.seed(5)
    yield (env.reset(seed=11)[0],)
    for _ in range(steps):
        said = env.step(env.action_space.sample())[:4]
        yield said
        if count == 1 and (said[2] or said[3]):
            yield (env.reset()[0],)
    env.close()


def rollouts(work: Path) -> Iterable[tuple[str, str]]:
    """Yield what every environment says of the same actions, alone and as a batch."""
    for name, steps in ROLLOUTS.items():
        for count in (1, 3):
            digest = hashlib.sha256()
            for said in steps_of(name, count, steps):
                for x in said:
                    digest.update(np.ascontiguousarray(x).tobytes())
            yield f"rollout.{name}.{count}", digest.hexdigest()[:16]


PARTS: dict[str, Callable[[Path], Iterable[tuple[str, str]]]] = {
    **{part: partial(commands, part) for part in COMMANDS},
    "rollouts": rollouts,
    "calibrate": calibrate,
    "diagnoses": diagnoses,
}


# ---- a few results, as numbers -------------------------------------------------------------------

QUICK = Path(__file__).with_suffix(".json")
TOLERANCE = {"sje": 1e-9, "gte": 1e-9, "calibrate": 1e-9, "rollout": 1e-6, "diagnose": 1e-6}
"""Relative [-], assumed, by the first word of a result's name; observations are single
precision."""


def quick() -> dict[str, Any]:
    """Return a few results of every room, in some seconds on one core."""
    from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
    from stiction_envs.experiments.gte.measures import Measures
    from stiction_envs.experiments.gte.protocol import Case
    from stiction_envs.experiments.sje.calibrate import calibrate
    from stiction_envs.experiments.sje.experiment import SingleJointExperiment
    from stiction_envs.experiments.sje.protocol import Configuration, Job
    from stiction_envs.gap.diagnosis import diagnose_logs
    from stiction_envs.hidden.hidden_logs import make_case
    from stiction_envs.measured.tables import AmplitudeRow
    from stiction_envs.measured.thesis_tables import thesis_base

    dither = {7: (15.0, 0.6), 4: (30.0, 1.2)}
    sje = SingleJointExperiment("panda", threads=1)
    jobs = [Job(Configuration(j, "load", "+"), *x) for j in dither for x in ((0.0, 0.0), dither[j])]
    rows = tuple(AmplitudeRow(j, *x) for j, x in dither.items())
    gte = GeneratedTrajectoryExperiment("panda", threads=1)
    case = Case(trajectory="triangle", stiffness=(200, 20, 0), dither=rows)
    (run,) = gte.run([case], iterations=1)
    friction = calibrate(thesis_base("panda"), sje, tolerance=0.02).parameters
    torques = {m.job: m.mean for m in sje.run(jobs, iterations=1)}
    out: dict[str, Any] = {
        "sje": [torques[job] for job in jobs],
        "gte": Measures(run, gte.protocol, gte.motion).rms[0].tolist(),
        "calibrate": np.ravel(friction.stiction).tolist(),
    }
    for name in ROLLOUTS:
        out[f"rollout {name}"] = [
            value
            for x in steps_of(name, 1, 5)
            if len(x) > 1
            for value in (float(np.mean(x[0], dtype=np.float64)), float(x[1]))
        ]
    for seed, cause, motion in ((2, "coulomb_friction", "reversals"), (8, "payload", "fourier")):
        hidden = make_case(seed, (cause,), motion=motion, seconds=10.0, size=0.7)
        found = diagnose_logs(hidden.logs, hidden.robot, nominal=hidden.nominal)
        out[f"diagnose {cause}"] = {
            "verdict": found.verdict,
            "causes": [[c.name, *c.joints, c.gain_percent] for c in found.causes],
            "held_out_nm": found.extended_rms.tolist(),
        }
    return out


def changed(now: Any, before: Any, tolerance: float, name: str = "") -> list[str]:
    """Return what differs between two results by more than a relative tolerance."""
    if isinstance(now, dict) and isinstance(before, dict) and now.keys() == before.keys():
        return [x for k in now for x in changed(now[k], before[k], tolerance, f"{name} {k}")]
    if isinstance(now, list) and isinstance(before, list) and len(now) == len(before):
        pairs = enumerate(zip(now, before, strict=True))
        return [x for k, (a, b) in pairs for x in changed(a, b, tolerance, f"{name} [{k}]")]
    numbers = isinstance(now, float) and isinstance(before, float)
    same = np.isclose(now, before, rtol=tolerance, atol=0.0) if numbers else now == before
    return [] if same else [f"{name.strip()}: {before} before, {now} now"]


def main() -> int:
    """Hash, and write or compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=Path("runs/freeze"), help="folder")
    parser.add_argument("--write", action="store_true", help="take these results as the true ones")
    parser.add_argument("--write-quick", action="store_true", help=f"write {QUICK.name}, no more")
    parser.add_argument("--only", nargs="+", choices=list(PARTS), help="some results")
    parser.add_argument("--all", action="store_true", help="the part too that takes minutes")
    args = parser.parse_args()
    if args.write_quick:
        QUICK.write_text(json.dumps(quick(), indent=1) + "\n", "utf-8")
        return 0
    work = args.work.resolve()
    work.mkdir(parents=True, exist_ok=True)
    kept = work / "freeze.json"
    before = json.loads(kept.read_text("utf-8")) if kept.is_file() else {}
    now, other = {}, []
    for name in args.only or [x for x in PARTS if args.all or x not in SLOW]:
        start = time.monotonic()
        for key, value in PARTS[name](work):
            now[key] = value
            same = before.get(key) == value
            if not same:
                other.append(key)
            state = "same" if same else "new" if key not in before else "CHANGED"
            print(f"{state:8}{key}  {value}", flush=True)
        print(f"        {name}: {time.monotonic() - start:.0f} s", flush=True)
    if args.write:
        kept.write_text(json.dumps({**before, **now}, indent=1, sort_keys=True) + "\n", "utf-8")
        return 0
    print(f"{len(now) - len(other)} of {len(now)} as before")
    return int(bool(other))


if __name__ == "__main__":
    sys.exit(main())
