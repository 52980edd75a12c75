"""Pages written before Sphinx reads: environments, commands, causes, benchmarks, the notebook.

They lie in ``docs/generated/``, which git ignores, so that no page can drift from its source.
"""

import argparse
import inspect
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import gymnasium
from gymnasium.envs.registration import load_env_creator
from notebook_page import notebook_page
from sphinx.application import Sphinx

import stiction_envs
from stiction_envs.cli.dispatch import all_commands, build_parser
from stiction_envs.gap.causes import Cause, registered
from stiction_envs.reporting.markdown import table_text

DOCS = Path(__file__).parents[1]
OUT = DOCS / "generated"
NOTEBOOK = DOCS / "first_look.ipynb"
BENCHMARKS = DOCS.parent / "benchmarks"


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages when the builder starts."""
    app.connect("builder-inited", lambda app: write_all())
    return {"parallel_read_safe": True}


def write_all() -> None:
    """Write every page that has changed and remove those without a source."""
    OUT.mkdir(exist_ok=True)
    look = {f"{NOTEBOOK.stem}.md": notebook_page(NOTEBOOK, OUT / f"{NOTEBOOK.stem}.md")}
    pages = {**environment_pages(), **command_pages(), **cause_pages(), **benchmark_pages(), **look}
    for name, text in pages.items():
        path = OUT / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
    for path in OUT.rglob("*.md"):
        if path.relative_to(OUT).as_posix() not in pages:
            path.unlink()


def contents(title: str, text: str, pages: Iterable[str]) -> str:
    """Return a page that leads to others."""
    toctree = "\n".join(["```{toctree}", ":hidden:", *pages, "```"])
    return f"# {title}\n\n{text}\n\n{toctree}\n"


def environments() -> list[str]:
    """Return the names of our environments."""
    return [n for n, s in gymnasium.registry.items() if "stiction_envs" in str(s.entry_point)]


def environment_pages() -> dict[str, str]:
    """Return one page per environment: the docstring of its class, which is Markdown."""
    assert stiction_envs.__version__  # the import has registered them
    pages, rows = {}, []
    for name in environments():
        single = load_env_creator(gymnasium.registry[name].entry_point)
        robot = gymnasium.registry[name].kwargs["robot"]
        text = inspect.getdoc(single) or ""
        pages[f"environments/{name}.md"] = (
            f'# {name}\n\n`{single.__name__}` with `robot="{robot}"`.\n\n{text}\n'
        )
        rows.append([f"[{name}](environments/{name}.md)", robot, text.partition("\n")[0]])
    text = table_text(["`gymnasium.make`", "arm", "task"], rows)
    names = (f"environments/{name}" for name in environments())
    return {**pages, "environments.md": contents("Environments", text, names)}


def subcommands() -> dict[str, argparse.ArgumentParser]:
    """Return the parser of each command."""
    for action in build_parser(all_commands())._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    raise LookupError("the parser has no commands")


def command_pages() -> dict[str, str]:
    """Return one page per command, from its parser."""
    os.environ["COLUMNS"] = "80"
    commands = subcommands()
    pages = {f"commands/{name}.md": command_page(name, x) for name, x in commands.items()}
    rows = [[f"[{name}](commands/{name}.md)", x.description or ""] for name, x in commands.items()]
    text = table_text(["`stiction` …", ""], rows)
    names = (f"commands/{name}" for name in commands)
    return {**pages, "commands.md": contents("Commands", text, names)}


def command_page(name: str, parser: argparse.ArgumentParser) -> str:
    """Return usage, every argument with its help, and the example of a command."""
    parts = [f"# stiction {name}", parser.description or ""]
    usage = parser.format_usage().rstrip().replace("\n" + " " * len("usage: "), "\n")
    parts.append(f"```text\n{usage.removeprefix('usage: ')}\n```")
    for group in parser._action_groups:
        shown = [x for x in group._group_actions if x.help != argparse.SUPPRESS]
        if shown:
            title = (group.title or "").removesuffix(":")
            parts.append(f"## {escaped(title[:1].upper() + title[1:])}")
            parts.extend(argument(parser, x) for x in shown)
    if parser.epilog:
        example, *after = re.split(r"\n(?=\S)", parser.epilog.strip().removeprefix("example:"))
        lines = "\n".join(f"$ {line.strip()}" for line in example.strip().splitlines())
        parts += ["## Example", f"```console\n{lines}\n```", " ".join(x.strip() for x in after)]
    return "\n\n".join(x for x in parts if x) + "\n"


def argument(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    """Return one argument as an item of a definition list."""
    formatter = parser._get_formatter()
    call = formatter._format_action_invocation(action)
    text = formatter._expand_help(action) if action.help else ""
    return f"`{call}`\n: {' '.join(escaped(text).split())}"


def escaped(text: str) -> str:
    """Return help text as Markdown: options are code, stars and brackets mean themselves."""
    text = re.sub(r"(?<![\w`-])(--[a-z][\w-]*)(?![^`]*`(?:[^`]*`[^`]*`)*[^`]*$)", r"`\1`", text)
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(x if x.startswith("`") else re.sub(r"([*_<>\[\]$|])", r"\\\1", x) for x in parts)


def cause_pages() -> dict[str, str]:
    """Return the page of what `diagnose` can name."""
    rows = [
        [f"`{x.name}`", x.what, "<br>".join(parameters(x)), x.what_to_record] for x in registered()
    ]
    header = ["name", "what is wrong in the simulation", "parameters", "what shows it"]
    text = (
        "What `diagnose` can name, and how its parameters are called in `diagnosis.json`. "
        "[One of your own](../extending.md#a-cause) takes a class."
    )
    return {"causes.md": f"# Causes\n\n{text}\n\n{table_text(header, rows)}\n"}


def parameters(cause: Cause) -> Iterator[str]:
    """Return name and unit of each parameter of a cause."""
    for x in cause.parameters:
        yield f"`{x.name}` [{'–' if x.unit == '1' else x.unit}]"


def benchmark_pages() -> dict[str, str]:
    """Return a page for each page of the benchmarks, included as it is written."""
    pages, rows = {}, []
    for source in sorted(BENCHMARKS.rglob("*.md")):
        name = f"benchmarks/{source.relative_to(BENCHMARKS).as_posix()}"
        relative = os.path.relpath(source, (OUT / name).parent)
        pages[name] = f"```{{include}} {relative}\n:relative-images:\n```\n"
        title = source.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")
        rows.append([f"[{title}]({name})"])
    text = (
        "What was measured, with what, and where a target was missed. Each page is written by a "
        "program beside it in `benchmarks/`.\n\n" + table_text(["page"], rows)
    )
    names = (name.removesuffix(".md") for name in pages)
    return {**pages, "benchmarks.md": contents("Benchmarks", text, names)}
