"""Pages written from the code before Sphinx reads: environments, commands, benchmarks.

They lie in ``docs/generated/``, which git ignores, so that no page can drift from its source.
"""

from __future__ import annotations

import argparse
import inspect
import os
from pathlib import Path

import gymnasium
from gymnasium.envs.registration import load_env_creator
from sphinx.application import Sphinx

import stiction_envs
from stiction_envs.cli.dispatch import build_parser

DOCS = Path(__file__).parents[1]
OUT = DOCS / "generated"
BENCHMARKS = DOCS.parent / "benchmarks"


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages when the builder starts."""
    app.connect("builder-inited", lambda app: write_all())
    return {"parallel_read_safe": True}


def write_all() -> None:
    """Write every page that has changed and remove those without a source."""
    pages = {**environment_pages(), **command_pages(), **benchmark_pages()}
    for name, text in pages.items():
        path = OUT / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
    for path in OUT.rglob("*.md"):
        if path.relative_to(OUT).as_posix() not in pages:
            path.unlink()


def environments() -> list[str]:
    """Return the names of our environments."""
    return [n for n, s in gymnasium.registry.items() if "stiction_envs" in str(s.entry_point)]


def environment_pages() -> dict[str, str]:
    """Return one page per environment: the docstring of its class, which is Markdown."""
    assert stiction_envs.__version__  # the import has registered them
    pages = {}
    for name in environments():
        single = load_env_creator(gymnasium.registry[name].entry_point)
        robot = gymnasium.registry[name].kwargs["robot"]
        pages[f"environments/{name}.md"] = (
            f'# {name}\n\n`{single.__name__}` with `robot="{robot}"`.\n\n{inspect.getdoc(single)}\n'
        )
    return pages


def subcommands() -> dict[str, argparse.ArgumentParser]:
    """Return the parser of each command."""
    for action in build_parser()._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    raise LookupError("the parser has no commands")


def command_pages() -> dict[str, str]:
    """Return one page per command, as `--help` prints it in a terminal of 100 columns."""
    os.environ["COLUMNS"] = "100"
    return {
        f"commands/{name}.md": f"# stiction {name}\n\n{parser.description}\n\n"
        f"```text\n{parser.format_help().rstrip()}\n```\n"
        for name, parser in subcommands().items()
    }


def benchmark_pages() -> dict[str, str]:
    """Return a page for each page of the benchmarks, included as it is written."""
    pages = {}
    for source in sorted(BENCHMARKS.rglob("*.md")):
        name = f"benchmarks/{source.relative_to(BENCHMARKS).as_posix()}"
        relative = os.path.relpath(source, (OUT / name).parent)
        pages[name] = f"```{{include}} {relative}\n:relative-images:\n```\n"
    return pages
