"""Logs to try `stiction diagnose` with: ``python -m stiction_envs.hidden.examples panda``.

``panda``: a Panda with joint friction, rotors and a payload, none of which a rigid simulation has.
``log.csv`` (a Fourier series, 26 s at 500 Hz), ``other.csv`` (a faster one, 20 s).

``so101``: an SO-101 whose servos and friction are about those of a real one
(``benchmarks/servo/servo_friction.md``) and whose links are 5 % off. ``recording`` as lerobot makes
it (version 3, 30 Hz, degrees) with ``calibration.json``, another motion ``other.csv``, and the arm
as its user knows it, ``so101.urdf`` and ``so101.toml``.

Both are simulated; ``hidden.json`` beside them is the truth. ``python -m
tests.hidden.make_examples`` makes the files that are shipped.
"""

import argparse
import io
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError
from stiction_envs.reporting.atomic import write_text_atomic

SHIPPED = Path(__file__).parent
EXAMPLES = ("panda", "so101")
ANGLE, TORQUE, RATE_HZ = 5e-6, 0.01, 500
"""Steps of the Panda's angles [rad] and torques [N·m], and its rows per second."""


def log_csv(t: Array, *, digits: int = 6, **channels: Array) -> str:
    """Return time (T,) and channels (T, n) by name as columns: ``t,q1..qn,tau1..taun``."""
    names = [f"{k}{j + 1}" for k, x in channels.items() for j in range(x.shape[1])]
    text, header = io.StringIO(), ",".join(["t", *names])
    table = np.column_stack([t, *channels.values()])
    np.savetxt(text, table, fmt=f"%.{digits}f", delimiter=",", header=header, comments="")
    return text.getvalue()


def write_example(name: str, folder: Path) -> None:
    """Write an example of `EXAMPLES` into a new folder; one that is there already is refused."""
    if folder.exists():
        raise StictionError(f"{folder}: exists already: expected a new folder")
    folder.mkdir(parents=True)
    if name == "so101":
        with zipfile.ZipFile(SHIPPED / "so101.zip") as files:
            files.extractall(folder)
        return
    with np.load(SHIPPED / "panda.npz") as steps:
        for log in ("log", "other"):
            q = ANGLE * np.cumsum(steps[f"{log}_q"], axis=0)
            tau = TORQUE * steps[f"{log}_tau"]
            text = log_csv(np.arange(len(q)) / RATE_HZ, q=q, tau=tau)
            write_text_atomic(folder / f"{log}.csv", text)
    write_text_atomic(folder / "hidden.json", (SHIPPED / "panda.json").read_text("utf-8"))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command; bad input ends it with 2."""
    parser = argparse.ArgumentParser(
        prog="python -m stiction_envs.hidden.examples",
        description="Write simulated logs of an arm that a simulation gets wrong.",
    )
    parser.add_argument("name", choices=EXAMPLES)
    parser.add_argument(
        "folder", nargs="?", type=Path, default=Path("example"), help="default: example"
    )
    args = parser.parse_args(arguments)
    try:
        write_example(args.name, args.folder)
    except StictionError as error:
        parser.error(str(error))
    print(f"written to {args.folder}; the truth is in hidden.json")


if __name__ == "__main__":
    main()
