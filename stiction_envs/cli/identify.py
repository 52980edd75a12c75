"""``stiction identify``: an arm's masses, inertias and friction from measured joint logs."""

from __future__ import annotations

import argparse
import json
from typing import Any

from stiction_envs.cli import common
from stiction_envs.cli.folder import OutputFolder, default_folder, provenance
from stiction_envs.cli.progress import Progress
from stiction_envs.errors import StictionError


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = common.add_command(
        subparsers,
        "identify",
        summary="Identify an arm's links and friction from logs of a motion that excites them.",
        example="stiction identify log.csv --robot panda --torque link --out runs/links",
        interrupted="run the same command again",
        run=run,
        show=show,
    )
    common.add_log_options(parser, logs="+")
    common.add_shared_options(parser, out="output folder (default: runs/identify-ROBOT)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Identify; write ``identification.json``, report, model, a plot and provenance."""
    from stiction_envs.robots import load_arm

    arm = load_arm(args.robot)
    for log in args.logs:
        if not log.is_file():
            raise StictionError(f"{log}: no such file")
    inputs = {f"log{k}": log for k, log in enumerate(args.logs, 1)}
    inputs["robot"] = common.robot_file(arm, args.robot)
    inputs["robot_table"] = inputs["robot"].with_suffix(".toml")
    found = provenance(args, {k: v for k, v in inputs.items() if v.is_file()})
    folder = OutputFolder(args.out or default_folder("identify", arm.name), found, force=args.force)

    from stiction_envs.identification.identify import identify
    from stiction_envs.identification.plots import plot_identification
    from stiction_envs.measured import write_text_atomic

    with Progress("per cent") as progress:
        # an error up to here is one of the logs: bad input
        result = identify(
            args.logs,
            arm,
            link_side=args.torque == "link",
            cutoff_hz=args.cutoff,
            progress=lambda stage, part: progress.set(stage, 100 * part, 100),
        )
        with common.working(), folder:
            answer = common.plain(result.to_json())
            text = json.dumps(answer, indent=2, ensure_ascii=False, allow_nan=False)
            write_text_atomic(folder.path / "identification.json", text + "\n")
            page = f"# {arm.name}: links and friction from logs\n\n![residual](residual.png)\n\n"
            write_text_atomic(folder.path / "report.md", page + result.page())
            result.write_mjcf(folder.path / "model.xml")
            plot_identification(result, folder.path / "residual.png")
    return {"command": "identify", "out": str(folder.path), **answer}


def show(result: dict[str, Any]) -> str:
    """Return the result as readable lines."""
    lines = [f"{'held-out residual [N·m], joint':<32}" + _row(range(1, len(result["links"]) + 1))]
    lines += [f"{name:<32}" + _row(rms) for name, rms in result["held_out_rms_nm"].items()]
    lines.append(f"{'noise':<32}" + _row(result["noise_nm"]))
    lines.append(
        f"links that can exist: {result['gain_percent']:.1f} % below the nominal arm with friction"
    )
    if result["hardly_excited"]:
        lines.append(
            f"hardly excited by these logs: {len(result['hardly_excited'])} of "
            f"{len(result['base'])} base parameters"
        )
    return "\n".join([*lines, f"written to {result['out']}: model.xml, report.md"])


def _row(values: Any) -> str:
    return "".join(f"{x:>9.3g}" for x in values)
