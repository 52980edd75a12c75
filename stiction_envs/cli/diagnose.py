"""``stiction diagnose``: what the simulation gets wrong about measured joint logs."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction_envs.cli import common
from stiction_envs.cli.folder import OutputFolder, default_folder, provenance
from stiction_envs.cli.progress import Progress
from stiction_envs.errors import StictionError

if TYPE_CHECKING:
    from stiction_envs.gap.model_file import Nominal
    from stiction_envs.robots import Arm


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = common.add_command(
        subparsers,
        "diagnose",
        summary="Name what a simulation gets wrong about measured joint logs, and mend it.",
        example="stiction diagnose log.csv --robot panda --torque link --out runs/why",
        interrupted="run the same command again",
        run=run,
        show=show,
    )
    common.add_log_options(parser, logs="*")
    parser.add_argument(
        "--poses",
        nargs="+",
        default=[],
        type=Path,
        metavar="FILE",
        help="poses at rest without time: q1..qn,tau1..taun, a pose in a row; with logs or alone",
    )
    parser.add_argument(
        "--nominal",
        default="rigid",
        metavar="rigid|shipped|MODEL.toml",
        help="the simulation to judge: rigid bodies without friction (default), with our friction, "
        "or what an earlier diagnosis wrote",
    )
    parser.add_argument(
        "--payload",
        nargs=4,
        type=common.number(),
        metavar=("MASS", "X", "Y", "Z"),
        help="known mass on the flange [kg] and its centre of mass in the flange frame [m]",
    )
    parser.add_argument(
        "--tilt",
        nargs=2,
        type=common.number(),
        metavar=("ROLL", "PITCH"),
        help="known inclination of the base: about the world's x, then its y [rad]",
    )
    parser.add_argument(
        "--method",
        choices=("auto", "lsm"),
        default="auto",
        help="lsm adds the thesis's least squares (equation 3.1) beside the tool's result",
    )
    common.add_shared_options(parser, out="output folder (default: runs/diagnose-ROBOT)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Diagnose; write ``diagnosis.json``, report, model, plots and provenance."""
    arm, nominal = _models(args)
    files = [*args.logs, *args.poses]
    if not files:
        raise StictionError("no log given: allowed are one or more logs, or --poses")
    for log in files:
        if not log.is_file():
            raise StictionError(f"{log}: no such file")
    inputs = {f"log{k}": log for k, log in enumerate(files, 1)}
    inputs["robot"] = common.robot_file(arm, args.robot)
    inputs["robot_table"] = inputs["robot"].with_suffix(".toml")
    if args.nominal not in ("rigid", "shipped"):
        inputs["nominal"] = Path(args.nominal)
    found = provenance(args, {k: v for k, v in inputs.items() if v.is_file()})
    folder = OutputFolder(args.out or default_folder("diagnose", arm.name), found, force=args.force)

    from stiction_envs.gap.diagnosis import diagnose
    from stiction_envs.measured.logs.reader import read_logs, read_poses

    with Progress("per cent") as progress:

        def say(stage: str, part: float) -> None:
            progress.set(stage, 100 * part, 100)

        # an error up to here is one of the logs: bad input
        read = read_logs(args.logs, arm.n, limits=arm.limits) if args.logs else []
        read += [read_poses(x, arm.n, limits=arm.limits) for x in args.poses]
        diagnosis = diagnose(
            read,
            arm,
            nominal=nominal,
            link_side=args.torque == "link",
            cutoff_hz=args.cutoff,
            seed=args.seed,
            progress=say,
        )
        with common.working(), folder:
            return _write(args, diagnosis, folder.path, found, say)


def _models(args: argparse.Namespace) -> tuple[Arm, Nominal]:
    """Return the arm and what is judged; an earlier diagnosis knows its payload and tilt."""
    from stiction_envs.gap.model_file import read, resolve
    from stiction_envs.robots import load_arm

    payload, tilt = args.payload, args.tilt
    path = Path(args.nominal)
    if path.suffix == ".toml":
        before = read(path)
        if before.robot is not None:
            payload = before.payload if payload is None else payload
            tilt = before.tilt if tilt is None else tilt
    arm = load_arm(args.robot, payload=payload, tilt=tilt or (0.0, 0.0))
    return arm, resolve(args.nominal, arm)


def _write(
    args: argparse.Namespace,
    diagnosis: Any,
    folder: Path,
    found: dict[str, Any],
    say: Any,
) -> dict[str, Any]:
    from stiction_envs.gap.diagnosis import model_of
    from stiction_envs.gap.extended_model import extend
    from stiction_envs.gap.forward_validation import prove
    from stiction_envs.gap.least_squares import least_squares
    from stiction_envs.gap.report import verdict_sentences, write_report
    from stiction_envs.measured import write_text_atomic

    base = diagnosis.base
    say("extended model", 0.0)
    extension = extend(base, model_of(diagnosis))
    say("forward proof", 0.0)
    proof = prove(diagnosis, nthread=args.threads)
    say("report", 0.0)
    squares = least_squares(diagnosis.logs, base) if args.method == "lsm" else None
    answer = diagnosis.to_json()
    if squares is not None:
        answer["lsm"] = squares.to_json()
    if not isinstance(proof, str):
        answer["forward"] = {
            "windows": len(proof.start),
            "replay_rad": {
                "nominal": proof.nominal.position_rms,
                "extended": proof.extended.position_rms,
            },
            "tracking_nm": {
                "nominal": proof.nominal.torque_rms,
                "extended": proof.extended.torque_rms,
            },
        }
    answer = common.plain(answer)
    logs = {
        f"log {k}": found["inputs"][f"log{k}"] for k in range(1, len(args.logs + args.poses) + 1)
    }
    text = json.dumps(answer, indent=2, ensure_ascii=False, allow_nan=False)
    write_text_atomic(folder / "diagnosis.json", text + "\n")
    write_text_atomic(folder / "model.xml", extension.xml)
    meta = {
        "title": f"{diagnosis.robot} as its logs show it",
        "units": "SI",
        "verdict": diagnosis.verdict,
    }
    hashes = {k.replace(" ", ""): v["sha256"] for k, v in logs.items()}
    write_text_atomic(folder / "model.toml", extension.toml(meta=meta, provenance=hashes))
    rows = [(k, f"`{Path(v['file']).name}`, sha256 `{v['sha256'][:16]}…`") for k, v in logs.items()]
    rows += [("commit", str(found["git_commit"])), ("seed", str(args.seed))]
    rows += [("torque", f"{args.torque} side"), ("nominal", _name(args))]
    rows += [(k, str(v)) for k, v in found["versions"].items() if v]
    write_report(
        folder,
        diagnosis,
        extension=extension,
        proof=proof,
        nominal_name=_name(args),
        squares=squares,
        provenance=rows,
    )
    return {
        "command": "diagnose",
        "out": str(folder),
        "summary": verdict_sentences(diagnosis, _name(args)),
        **answer,
    }


def _name(args: argparse.Namespace) -> str:
    return args.nominal if args.nominal in ("rigid", "shipped") else Path(args.nominal).name


def show(result: dict[str, Any]) -> str:
    """Return the verdict and the causes as readable lines."""
    lines = [f"{result['verdict']}: {result['summary']}", ""]
    for cause in result["causes"]:
        confused = cause["confused_with"]
        also = f"  (or {', '.join(confused)})" if confused else ""
        where = ",".join(map(str, cause["joints"])) or "arm"
        lines.append(f"{cause['gain_percent']:6.1f} %  {cause['name']:<28} joints {where}{also}")
    return "\n".join([*lines, f"written to {result['out']}: report.html"])
