"""Run a page as a reader would: `python docs/run_page.py docs/log.md FOLDER`.

Its `console` and `python` blocks run one after the other in the folder, and Python keeps its names
from block to block. What the page prints of a command (lines of a `console` block without `$`, and
`text` blocks) must have been printed by then; "…" at either end stands for more of the line.
"""

import contextlib
import io
import os
import re
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
PICTURES = {
    "panda": {
        "panda.png": "runs/panda/verification.png",
        "panda_frequency.png": "runs/panda/frequency.png",
        "sje.png": "runs/joint7/torques.png",
    },
    "log": {
        "log.png": "runs/why/plots/summary.png",
        "log_payload.png": "runs/why/plots/cause_payload.png",
    },
    "policies": {"policies.png": "frame.png"},
    "so101": {"so101.png": "runs/so101/plots/joint_3.png"},
}
"""Pictures of each page, and the file of the page's run that each picture is."""
STICTION = "import sys; from stiction_envs.cli import main; sys.exit(main(sys.argv[1:]))"


def blocks(page: Path) -> list[tuple[str, str]]:
    """Return language and text of every fenced block of a page."""
    text = page.read_text(encoding="utf-8")
    return re.findall(r"^```(console|python|text)\n(.*?)^```", text, re.M | re.S)


def commands(page: Path) -> list[str]:
    """Return every command of a page."""
    lines = [line for kind, text in blocks(page) if kind == "console" for line in joined(text)]
    return [line[2:] for line in lines if line.startswith("$ ")]


def joined(text: str) -> list[str]:
    """Return the lines of a block, those that end with a backslash with the next."""
    return re.sub(r" *\\\n *", " ", text).splitlines()


def run_command(command: str) -> str:
    """Return what a command prints on standard output.

    Raises:
        RuntimeError: it failed.
    """
    program, *words = command.split()
    start = {"stiction": [sys.executable, "-c", STICTION], "python": [sys.executable]}[program]
    done = subprocess.run(
        [*start, *words],
        env=dict(os.environ, PYTHONPATH=str(ROOT)),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{command}\n{done.stdout}\n{done.stderr}")
    return done.stdout


def was_printed(line: str, printed: set[str]) -> bool:
    """Return whether a line, or the part of it that is shown, is among those printed."""
    part = line.strip("…").strip()
    return line in printed or (part != line and any(part in other for other in printed))


def main(page: Path, folder: Path) -> int:
    """Run a page; returns 1 where it shows what was not printed."""
    page = page.resolve()
    os.chdir(folder)
    sys.path.insert(0, str(ROOT))
    printed: set[str] = set()
    missing: list[str] = []
    names: dict[str, object] = {"__name__": "__page__"}

    def keep(what: str, output: str, began: float) -> None:
        print(f"# {time.perf_counter() - began:.1f} s: {what}\n{output}", flush=True)
        printed.update(line.strip() for line in output.splitlines())

    for kind, text in blocks(page):
        if kind == "python":
            began, output = time.perf_counter(), io.StringIO()
            with contextlib.redirect_stdout(output):
                exec(compile(text, f"{page.name}, python", "exec"), names)
            keep(text.splitlines()[0], output.getvalue(), began)
            continue
        for line in joined(text):
            if kind == "console" and line.startswith("$ "):
                began = time.perf_counter()
                keep(line, run_command(line[2:]), began)
            elif line.strip() and not was_printed(line.strip(), printed):
                missing.append(line)
    for line in missing:
        print(f"{page.name} shows what was not printed: {line}", file=sys.stderr)
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
