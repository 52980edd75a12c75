"""``stiction train``: a policy that dithers, by reinforcement learning."""

import argparse
from dataclasses import replace

from stiction_envs.cli import common
from stiction_envs.cli.progress import Progress
from tuning.commands import evaluate
from tuning.names import ALGORITHMS, CHECKPOINT_EVERY

SUMMARY = "Train a policy that dithers (Stable-Baselines3, extra rl), and evaluate it."
EXAMPLE = "stiction train panda gte --algo ppo --steps 300000 --out runs/train-panda"
INTERRUPTED = "the last checkpoint is kept; run the same command again to go on from it"


def add_options(parser: common.Parser) -> None:
    """Add the options."""
    evaluate.add_task_options(parser)
    common.option(parser, f"--algo {'|'.join(ALGORITHMS)}", "learning algorithm", required=True)
    common.option(
        parser,
        "--steps N",
        "total steps of all arms; a step is one control interval (default: 0.1 s)",
        required=True,
    )
    common.option(
        parser,
        "--settings FILE.toml",
        "settings that differ from the defaults: environments, networks, intervals … "
        "([ppo], [sac], [td3], [run] as in tuning/policies/settings.toml)",
    )
    common.option(
        parser,
        "--checkpoint-every N",
        "steps between two checkpoints (default: %(default)s)",
        default=CHECKPOINT_EVERY,
    )
    common.add_shared_options(
        parser,
        out="output folder (default: runs/train-ROBOT); an unfinished training of the same "
        "command is continued",
    )


def run(args: argparse.Namespace) -> common.Answer:
    """Train; write policy, curve, evaluation, plots and provenance."""
    from stiction_envs.method_settings import override
    from tuning.policies import train as training
    from tuning.policies.comparison import evaluate_all
    from tuning.policies.settings import policy_settings

    arm = common.read_arm(args)
    task = test = evaluate.read_task(args, arm.n)
    if args.experiment == "gte":
        # the triangle and the pentagon are what it is evaluated on
        options = {"trajectory": "random", **test.arguments.get("fixed_options", {})}
        task = replace(test, arguments={**test.arguments, "fixed_options": options})
    settings = override(policy_settings(), args.settings)
    inputs = {**common.model_files(args, arm), "settings": args.settings}
    folder = common.output_folder(args, task.arm_name, inputs, resumable=True)
    plan = training.Training(
        task=task,
        algorithm=args.algo,
        steps=args.steps,
        seed=args.seed,
        checkpoint_every=args.checkpoint_every,
        settings=settings,
    )
    plan.check()
    with common.working(), Progress("episodes") as progress, folder:
        trained = plan.run(folder.path, progress.whole)
        evaluated = evaluate_all(
            test,
            ["none", ("trained", trained.policy)],
            episodes=settings.run.final_episodes,
            seed=training.far_seed(args.seed, 2),
            progress=progress.set,
        )
        evaluated.save(folder.path)
        plan.draw_curve(folder.path / "curve.png", trained.points)
    first, last, best = trained.points[0], trained.points[-1], trained.best
    more = {
        "seed": args.seed,
        "algorithm": args.algo,
        "steps": last.steps,
        "resumed_at": trained.resumed_at,
        "first_return": first.evaluation_return,
        "best_return": best.evaluation_return,
        "best_steps": best.steps,
    }
    text = (
        f"{args.algo}, {last.steps} steps: evaluated return {first.evaluation_return:.3f} at "
        f"first, {best.evaluation_return:.3f} at {best.steps} steps (kept); other episodes:\n"
        f"{evaluated}\nwritten to {folder.path}"
    )
    return common.Answer(result=evaluated, out=folder.path, more=more, text=text)
