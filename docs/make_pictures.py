"""Make the pictures of the site: `python docs/make_pictures.py [panda log policies so101]`.

They are what the commands of each page wrote.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import run_page

HERE = Path(__file__).parent


def run(page: str) -> None:
    """Run a page's commands and keep its pictures."""
    with tempfile.TemporaryDirectory() as folder:
        script = [sys.executable, HERE / "run_page.py", HERE / f"{page}.md", folder]
        done = subprocess.run(script, env={"MUJOCO_GL": "egl", **os.environ}, check=False)
        for name, source in run_page.PICTURES[page].items():
            shutil.copyfile(Path(folder) / source, HERE / name)
    if done.returncode:
        sys.exit(f"{page}.md does not show what its commands print")


if __name__ == "__main__":
    for wanted in sys.argv[1:] or run_page.PICTURES:
        run(wanted)
