"""Two logs to try `stiction diagnose` with: ``python -m stiction_envs.hidden.example_logs``.

A Panda with joint friction, rotors and a payload, none of which a rigid simulation has. Writes
``log.csv`` (a Fourier series, 26 s at 500 Hz), ``other.csv`` (a faster one, 20 s) and the truth,
``hidden.json``, into a new folder.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from stiction_envs.errors import StictionError
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.hidden.example_command import log_csv, run_writer
from stiction_envs.hidden.hidden_logs import make_case
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.json_text import write_json

SEED = 7


def write_example(folder: Path, *, seconds: float = 26.0, second: float = 20.0) -> None:
    """Write both logs and what is hidden in them.

    Args:
        folder: that is not there yet.
        seconds: length of ``log.csv`` [s].
        second: length of ``other.csv`` [s].

    Raises:
        StictionError: the folder is there already; it might hold somebody's logs.
    """
    if folder.exists():
        raise StictionError(f"{folder}: exists already: expected a new folder")
    case = make_case(
        SEED, ("payload",), motion="fourier", seconds=seconds, known=True, size=0.6, second=second
    )
    known = case.nominal
    assert isinstance(known, FrictionParameters)
    (payload,) = case.hidden
    truth: dict[str, object] = {
        "payload": payload.values,
        "coulomb_friction": {"coulomb_nm": known.stiction[:, 0].tolist()},
        "viscous_friction": {"viscous_nms": known.viscous[:, 0].tolist()},
        "link_inertia": {"armature_kgm2": known.rotor_inertia.tolist()},
    }
    folder.mkdir(parents=True)
    for name, (log,) in (("log.csv", case.logs), ("other.csv", case.second)):
        write_text_atomic(folder / name, log_csv(log.t, q=log.q, tau=log.tau))
    write_json(folder / "hidden.json", truth)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code: 0 done, 2 bad input."""
    return run_writer(
        "stiction_envs.hidden.example_logs",
        "Write two simulated logs of a Panda that a rigid simulation gets wrong.",
        write_example,
        "log.csv, other.csv; the truth is in hidden.json",
        arguments,
    )


if __name__ == "__main__":
    sys.exit(main())
