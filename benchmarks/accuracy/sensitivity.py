"""What each number in `diagnose` is worth: logs diagnosed again with it halved and doubled.

    python -m benchmarks.accuracy.sensitivity [--cases 8] [--group 57] [--minutes 60]

Numbers are the settings of ``gap/settings.toml`` and the constants that modules of ``gap`` name in
capitals. They are changed a group at a time, each number at random halved or doubled, and the other
way in a second pass. A group that changes which causes are named is divided until single numbers
are left. So two numbers that undo each other's change can be missed.
"""

from __future__ import annotations

import ast
import os
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import cache
from importlib.machinery import PathFinder, SourceFileLoader
from multiprocessing import get_context
from types import CodeType
from typing import Any, ClassVar

import numpy as np

from benchmarks.harness import LOGS, MEASURED, ROOT, Benchmark, Row
from stiction_envs.errors import StictionError
from stiction_envs.method_settings import override
from stiction_envs.reporting.markdown import table_text

MADE_BY = (*LOGS, "stiction_envs/hidden", "benchmarks/accuracy/sensitivity.py")
STUDY = Benchmark(__file__, __doc__, made_by=MADE_BY)
ROOM = "stiction_envs.gap"
REAL = MEASURED / "panda_exciting_trajectory" / "panda_exciting_trajectory.csv.gz"
HIDDEN: tuple[tuple[int, tuple[str, ...], str, int | None], ...] = (
    # seed, causes, motion, joint; the real Panda comes before them
    (1, ("coulomb_friction", "stribeck_friction"), "sweeps", 4),
    (2, ("payload", "viscous_friction"), "fourier", 6),
    (3, (), "fourier", None),
    (4, ("backlash",), "reversals", 3),
    (5, ("joint_elasticity", "torque_scale"), "chirp", 2),
    (6, ("presliding_hysteresis",), "reversals", 5),
    (7, ("actuator_delay", "external_spring"), "fast", 5),
    (8, ("position_dependent_friction", "warm_up_drift"), "sweeps", 4),
    (9, ("base_tilt", "load_dependent_friction"), "poses", 2),
    (10, ("position_dependent_torque", "torque_offset"), "fourier", 3),
    (11, ("link_parameters",), "fourier", None),
)
Changes = dict[str, float]
"""Factors by names of numbers."""


# ---- numbers -------------------------------------------------------------------------------------


def numbers() -> list[str]:
    """Return the names of all settings, and of all constants as MODULE:NAME."""
    from stiction_envs.gap.settings import gap_settings

    def settings(node: Any, prefix: str = "") -> list[str]:
        out = []
        for field in fields(node):
            value, name = getattr(node, field.name), f"{prefix}{field.name}"
            if is_dataclass(value):
                out += settings(value, f"{name}.")
            elif not isinstance(value, bool | str | tuple):
                out.append(name)
        return out

    constants = []
    for path in sorted((ROOT / ROOM.replace(".", "/")).rglob("*.py")):
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        names = named_numbers(ast.parse(path.read_text("utf-8")))
        constants += [f"{module.removeprefix(ROOM + '.')}:{name}" for name in names]
    return settings(gap_settings()) + constants


def named_numbers(tree: ast.Module) -> dict[str, ast.Assign]:
    """Return the assignments of numbers, or tuples of numbers, to names in capitals."""
    found = {}
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            name, parts = node.targets[0].id, getattr(node.value, "elts", [node.value])
            if name.isupper() and all(isinstance(number(x), int | float) for x in parts):
                found[name] = node
    return found


def number(node: ast.expr) -> Any:
    """Return the value of a literal; None of anything else, and of flags."""
    try:
        value = ast.literal_eval(node)
    except ValueError:
        return None
    return None if isinstance(value, bool) else value


def scaled(value: Any, factor: float) -> Any:
    """Return a number multiplied; whole numbers are rounded, and stay at least one."""
    return max(1, round(factor * value)) if isinstance(value, int) else factor * value


class Changed(SourceFileLoader):
    """Loads a module with some of its constants multiplied."""

    changes: ClassVar[Changes] = {}

    def get_code(self, fullname: str) -> CodeType:
        """Compile the source: what is cached has the constants as they were."""
        tree = ast.parse(self.get_data(self.path))
        for name, node in named_numbers(tree).items():
            if factor := self.changes.get(f"{self.name.removeprefix(ROOM + '.')}:{name}"):
                for place in ast.walk(node.value):
                    if isinstance(place, ast.Constant):
                        place.value = scaled(place.value, factor)
        return compile(tree, self.path, "exec")


class Finder(PathFinder):
    """Finds modules of the room for `Changed`."""

    @classmethod
    def find_spec(cls, name: str, path: Any = None, target: Any = None) -> Any:
        """Return the specification of a module, with the other loader."""
        spec = super().find_spec(name, path, target) if name.startswith(ROOM) else None
        if spec and spec.origin:
            spec.loader = Changed(name, spec.origin)
        return spec


# ---- diagnoses -----------------------------------------------------------------------------------


def in_child(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return what a function returns in a process of its own; of an error, its text."""
    here, there = (context := get_context("fork")).Pipe(duplex=False)

    def call() -> None:
        try:
            there.send(function(*arguments))
        except Exception as error:  # a number that is not allowed is a result too
            there.send(f"{type(error).__name__}: {error}")

    process = context.Process(target=call)
    process.start()
    out = here.recv()
    process.join()
    return out


@cache
def logs_of(case: int) -> Any:
    """Return logs, robot and nominal friction of a case; case 0 is the real Panda."""

    def make() -> Any:
        from stiction_envs.hidden.hidden_logs import make_case

        seed, causes, motion, joint = HIDDEN[case - 1]
        found = make_case(seed, causes, motion=motion, joint=joint, size=0.7)
        return found.logs, found.robot, found.nominal

    def real() -> Any:
        from stiction_envs.measured.logs.reader import read_logs

        return read_logs([REAL], 7), "panda", "rigid"

    return in_child(make if case else real)


def diagnose(case: int, changes: Changes) -> Any:
    """Return verdict and causes by joints, with some numbers changed."""
    logs, robot, nominal = logs_of(case)
    Changed.changes = changes
    for name in [x for x in sys.modules if x.startswith(ROOM)]:
        del sys.modules[name]
    sys.meta_path.insert(0, Finder)
    from stiction_envs.gap.diagnosis import diagnose_logs
    from stiction_envs.gap.settings import gap_settings

    own: dict[str, Any] = {}
    for name, factor in changes.items():
        if ":" not in name:
            value: Any = gap_settings()
            for part in name.split("."):
                value = getattr(value, part)
            with suppress(StictionError):  # out of its range: it stays as it is
                changed = {name: scaled(value, factor)}
                override(gap_settings(), changed)
                own |= changed
    torque = "motor" if case else "link"
    found = diagnose_logs(logs, robot, nominal=nominal, torque=torque, settings=own)
    return [found.verdict, sorted([c.name, list(c.joints)] for c in found.causes)]


def changing(case: int, changes: Changes, default: Any) -> dict[str, Any]:
    """Return what a case says with single numbers changed, where that is not the default.

    A group without such numbers is one diagnosis; else both its halves are tried.
    """
    found = in_child(diagnose, case, changes)
    if found == default:
        return {}
    if len(changes) == 1:
        ((name, factor),) = changes.items()
        return {f"{name} × {factor:g}": found}
    parts, half = list(changes.items()), len(changes) // 2
    first = changing(case, dict(parts[:half]), default)
    return first | changing(case, dict(parts[half:]), default)


@cache
def default_of(case: int) -> Any:
    """Return what a case says with nothing changed."""
    return in_child(diagnose, case, {})


def measure(job: tuple[int, Changes]) -> Row:
    """Return what changes a case, of a group of numbers."""
    case, changes = job
    default = default_of(case)
    return {"default": default, "changing": changing(case, changes, default)}


def plan(cases: Sequence[int], size: int) -> dict[str, tuple[int, Changes]]:
    """Return groups by case, number of the group and pass."""
    names, rng = numbers(), np.random.default_rng(0)
    order, up = rng.permutation(len(names)), rng.random(len(names)) < 0.5
    jobs = {}
    for case in cases:
        for flip in (False, True):
            for k in range(0, len(names), size):
                group = {names[i]: 2.0 if up[i] != flip else 0.5 for i in order[k : k + size]}
                jobs[f"{case} {int(flip)} {k} {size}"] = (case, group)
    return jobs


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--cases", type=int, default=len(HIDDEN) + 1)
    parser.add_argument("--group", type=int, default=57, help="numbers that are changed together")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    options = parser.parse_args()
    cases = range(0 if REAL.is_file() else 1, options.cases)
    jobs = plan(cases, options.group)
    rows = STUDY.rows(options).fill(
        jobs, measure, processes=options.processes, minutes=options.minutes
    )
    done = Counter(jobs[key][0] for key in rows)
    changed: dict[str, set[int]] = {}
    for key, row in rows.items():
        for name in row["changing"]:
            changed.setdefault(name, set()).add(jobs[key][0])
    lines = [
        [*name.split(" × "), str(len(changed[name])), " ".join(map(str, sorted(changed[name])))]
        for name in sorted(changed, key=lambda x: (-len(changed[x]), x))
    ]
    STUDY.write_page(
        options,
        numbers=len(numbers()),
        changing=len({name.split(" × ")[0] for name in changed}),
        real=REAL.is_file(),
        done=[f"{done[c]} of number {c}" for c in cases if done[c]],
        groups=len(jobs) // len(cases),
        group=options.group,
        table=table_text(["number", "times", "cases with another result", "which"], lines),
    )


if __name__ == "__main__":
    main()
