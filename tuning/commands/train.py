"""``stiction train``: a policy that dithers, by reinforcement learning."""

from __future__ import annotations

import argparse
from pathlib import Path

from stiction_envs.cli import common
from stiction_envs.cli.progress import Progress
from stiction_envs.errors import StictionError
from stiction_envs.reporting.json_text import JsonRecord
from tuning.commands import evaluate

# as the packages have them; written out, so that --help does not load them
ALGORITHMS = ("sac", "ppo", "td3")


def add_parser(subparsers: common.Subparsers) -> None:
    """Add the command."""
    parser = common.add_command(
        subparsers,
        "train",
        summary="Train a policy that dithers (Stable-Baselines3, extra rl), and evaluate it.",
        example="stiction train panda gte --algo ppo --steps 300000 --out runs/train-panda",
        interrupted="the last checkpoint is kept; run the same command again to go on",
        run=run,
        show=show,
    )
    evaluate.add_task_options(parser)
    parser.add_argument("--algo", required=True, metavar="|".join(ALGORITHMS), help="how it learns")
    parser.add_argument(
        "--steps",
        required=True,
        type=common.whole(1),
        metavar="N",
        help="steps of all arms together, each one control interval long (default: 0.1 s)",
    )
    parser.add_argument(
        "--start",
        type=Path,
        metavar="TABLE.csv",
        help="amplitude table that the policy starts with, without its gates (default: half "
        "of the highest amplitudes and frequencies; with --action dither+push no dither, and the "
        "gains of --compensation)",
    )
    parser.add_argument(
        "--settings",
        type=Path,
        metavar="FILE.toml",
        help="settings that differ from the defaults: environments, networks, intervals … "
        "([ppo], [sac], [td3], [run] as in tuning/policies/settings.toml)",
    )
    parser.add_argument(
        "--distil",
        action="store_true",
        help="also write the closest gated table (final.csv), and say what it loses",
    )
    common.add_shared_options(
        parser,
        out="output folder (default: runs/train-ROBOT); one that holds a part of the same training "
        "is continued",
    )


def run(args: argparse.Namespace) -> dict[str, object]:
    """Train; write policy, curve, evaluation, plots and provenance."""
    from stiction_envs.measured import AmplitudeRow, read_amplitudes
    from stiction_envs.method_settings import override
    from tuning.policies import train as training
    from tuning.policies.distil import distil
    from tuning.policies.evaluation import evaluate_all
    from tuning.policies.report import draw_curve, write_report
    from tuning.policies.settings import policy_settings

    # the triangle and the pentagon are what it is evaluated on
    task = evaluate.read_task(
        args, **({"trajectory": "random"} if args.experiment == "gte" else {})
    )
    settings = override(policy_settings(), args.settings)
    start: list[AmplitudeRow] = []
    if args.start is not None:
        start = read_amplitudes(args.start, n_joints=common.read_arm(args).n)
    action = task.arguments.get("action", evaluate.ACTIONS[0])
    if args.distil and action != evaluate.ACTIONS[0]:
        raise StictionError(f"--distil: not with --action {action}: a table holds no gains")
    inputs = {**common.model_files(args), "settings": args.settings, "start": args.start}
    inputs["compensation"] = evaluate.compensation_file(args)
    folder = common.output_folder(args, task.arm_name, inputs, resumable=True)
    there = folder.path if folder.resumed else None
    plan = training.Training(
        task=task,
        algorithm=args.algo,
        steps=args.steps,
        seed=args.seed,
        start=start,
        settings=settings,
    )
    plan.check(there)
    with common.working(), Progress("episodes") as progress, folder:
        trained = plan.run(folder.path, progress.whole)
        test = evaluate.read_task(args)
        evaluated = evaluate_all(
            test,
            ["none", ("trained", trained.policy)],
            episodes=settings.run.final_episodes,
            seed=training.far_seed(args.seed, 2),
            options=evaluate.read_options(args),
            progress=progress.set,
        )
        evaluated.save(folder.path)
        distilled = None
        if args.distil:
            distilled = distil(test, trained.policy, seed=training.far_seed(args.seed, 3))
            distilled.save(folder.path)
        draw_curve(
            folder.path / "curve.png",
            trained.points,
            title=f"{args.algo.upper()} on {task.name}, seed {args.seed}",
            experiment=args.experiment,
        )
        write_report(folder.path, task, args.algo, trained, evaluated, distilled)
    return {
        "command": "train",
        "seed": args.seed,
        "out": str(folder.path),
        "environment": task.name,
        "algorithm": args.algo,
        "steps": trained.points[-1].steps,
        "steps_per_second": trained.steps_per_second,
        "resumed_at": trained.resumed_at,
        "first_return": trained.points[0].evaluation_return,
        "best_return": trained.best.evaluation_return,
        "best_steps": trained.best.steps,
        "summary": evaluated.summary(),
        "distilled": None if distilled is None else distilled.to_json(),
        "notes": list(trained.notes),
    }


def show(result: JsonRecord) -> str:
    """Return the result as readable lines."""
    rate = result["steps_per_second"]
    speed = "" if rate is None else f", {rate:.0f} steps/s"
    kept = (
        f"{result['algorithm']}, {result['steps']} steps{speed}: evaluated return "
        f"{result['first_return']:.3f} at first, {result['best_return']:.3f} at "
        f"{result['best_steps']} steps (kept); other episodes:"
    )
    lines = [kept, evaluate.show(result), *result["notes"]]
    if result["distilled"] is not None:
        lost = result["distilled"]["lost"]
        lines.append(
            f"the closest gated table (final.csv) loses {100 * lost['table']:.0f} % of what the "
            f"policy gains in return, the closest rule (rule.csv) {100 * lost['rule']:.0f} %"
        )
        for kind in ("table", "rule"):
            shares = [joint[f"{kind}_r2"] for joint in result["distilled"]["joints"]]
            lines.append(f"R² of its amplitudes, {kind}: {', '.join(f'{x:.2f}' for x in shares)}")
    return "\n".join(lines)
