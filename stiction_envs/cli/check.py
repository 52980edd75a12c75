"""``stiction check``: facts about logs, the causes they can show, defects of logs and tables."""

import argparse
from dataclasses import asdict, replace

from stiction_envs.cli import common, log_options
from stiction_envs.errors import StictionError

SUMMARY = "Show what a log is and what it can show; list what is wrong in logs and tables."
EXAMPLE = "stiction check base.csv log.csv --robot panda"


def add_options(parser: common.Parser) -> None:
    """Add the options."""
    parser.epilog = (
        f"{parser.epilog}\n"
        "exit codes of check: 0 nothing wrong (remarks do not count), 1 defects found,\n"
        "2 bad usage: no such file, or neither a torque table nor a log"
    )
    common.option(
        parser, "files FILE ...", "torque tables (as sje.csv or final.csv) or logs of joints"
    )
    common.option(
        parser,
        "--robot ROBOT",
        f"whose logs these are, for units and limits: {common.robot_help()}",
    )
    common.add_chain_option(parser)
    common.add_mounting_options(parser)
    log_options.add_reading_options(parser)
    common.add_drive_option(parser, log_options.LOG_DRIVE)
    common.add_shared_options(parser, out="write findings.csv there too (default: nothing)")


def run(args: argparse.Namespace) -> common.Answer:
    """Check; write ``findings.csv`` where asked to."""
    from stiction_envs.measured.checks.files import Finding, check

    if args.robot is None and (args.payload or args.tilt):
        raise StictionError("--payload, --tilt: of no robot: expected --robot too")
    if args.out is not None:
        common.output_folder(args, "")
    result = check(
        *args.files,
        robot=args.robot,
        chain=args.chain,
        drive=args.drive,
        **log_options.reading(args),
    )
    pages, remarks = [], []
    if args.robot is not None and result.logs:
        from stiction_envs.gap.overview import overview
        from stiction_envs.robots import load_arm

        tilt = args.tilt or (0.0, 0.0)
        arm = load_arm(args.robot, payload=args.payload, tilt=tilt, chain=args.chain)
        for log in result.logs:
            try:
                pages.append(overview(log, arm, torque=log.side or "motor"))
            except StictionError as error:
                text = str(error).removeprefix(log.source).lstrip(":, ")
                remarks.append(Finding(log.source, "", "warning", text))
                continue
            remarks += [Finding(log.source, "", *x) for x in pages[-1].findings]
        result = replace(result, findings=(*result.findings, *remarks))
    if args.out is not None:
        with common.working():
            result.save(args.out, force=args.force)
    count = len(result.defects)
    failed = f"{count} defect{'s' * (count > 1)} found" if count else None
    more = {"logs": [asdict(page) for page in pages], "failed": failed}
    return common.Answer(result=result, more=more, text="\n\n".join(map(str, [*pages, result])))
