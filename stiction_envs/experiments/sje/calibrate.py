"""Identify an arm's friction from its measured base torques: anyone's Table 4.3.

Half the difference of the two directions is friction, half their sum an offset (gravity-model or
sensor error) that dither cannot remove (sources.md 1.6). Both are known in two poses per joint:

    stiction(L) = F_0 + k L          from the friction in the load and the no-load pose
    offset(G)   = o_0 + e G          from the offset there, G the signed load

The table's torques hold the slide to the 0.15 rad threshold too, so that F_0 is not read off but
found: simulate the experiment, compare half-sums and half-differences, correct, repeat. It begins
with the friction the arm has, or with the table's where that is far off.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import ExperimentError, StictionError
from stiction_envs.experiments.poses import Poses
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import DIRECTIONS, LOADS, POSES
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import FrictionParameters, dump_friction, friction_sources
from stiction_envs.measured.tables import BaseTable
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.markdown import aligned, joints, percent
from stiction_envs.reporting.provenance import Provenance
from stiction_envs.reporting.toml import toml_text
from stiction_envs.robots.arm_toml import read_toml

TOLERANCE = 0.002  # Rounds end when every base torque agrees this well, relative [-]; assumed
CONVERGED = 5.0  # Largest error of the best round, over the tolerance [-]; assumed
ROUNDS = 10  # Most rounds of simulate and correct [-]; assumed
FAR = 0.5
"""Above this relative error the table is a better start than the arm's friction [-]; assumed."""
LEAST_FRICTION = 0.05  # Least stiction over the table's friction [-]; assumed
SAME_LOAD = 1e-6
"""Loads of two poses that differ by less cannot explain different friction [N·m]; source: rounding
of float64."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Calibration:
    """Identified friction, and how well it reproduces the table."""

    parameters: FrictionParameters
    simulated: Array  # (n, 2, 2) base torques with these parameters, scatter off [N·m]
    measured: BaseTable
    error: float  # Largest |simulated − measured| / |measured| [-]
    rounds: int
    negative_load: tuple[int, ...]  # Joints (1..n) whose friction was *smaller* under load

    def to_json(self) -> dict[str, object]:
        """Return JSON values: every base torque measured and simulated."""
        return {
            "robot": self.measured.robot,
            "rounds": self.rounds,
            "largest_relative_error": self.error,
            "negative_load_coefficient": list(self.negative_load),
            "rows": [
                {
                    "joint": j + 1,
                    "load": LOADS[k],
                    "direction": DIRECTIONS[d],
                    "measured_nm": tau,
                    "simulated_nm": self.simulated[j, k, d],
                }
                for (j, k, d), tau in np.ndenumerate(self.measured.tau)
            ],
        }

    def write_toml(
        self,
        path: Path,
        *,
        base: str | Path | FrictionParameters | None,
        table: str,
        content: bytes,
        run: Provenance | None = None,
    ) -> None:
        """Write the friction TOML, provenance inside; its folder is made.

        What was not found keeps its sources, and servos are kept.

        Args:
            path: of the file.
            base: friction that the calibration began with.
            table: name of the file of the measured torques.
            content: bytes of that file.
            run: provenance of the command.
        """
        sources, meta = friction_sources(base)
        found = f"calibrated: `stiction calibrate` on {table}"
        for name in ("stiction", "load_low", "load_high", "offset", "gravity_error"):
            sources[name] = found
        sources["load_coefficient"] = found
        if self.negative_load:
            sources["load_coefficient"] += (
                f"; negative for joints {', '.join(map(str, self.negative_load))}: measured "
                "friction was smaller in the load pose, which load does not explain; kept so that "
                "both poses are met"
            )
        made = {} if run is None else _strings(run)
        made |= {
            "method": "stiction_envs.experiments.sje.calibrate: simulate, correct, repeat",
            "table": table,
            "table_sha256": hashlib.sha256(content).hexdigest(),
            "rounds": str(self.rounds),
            "largest_relative_error": repr(self.error),
            "scatter": "off",
        }
        text = dump_friction(self.parameters, sources=sources, meta=meta, provenance=made)
        if isinstance(base, str | Path) and Path(base).suffix == ".toml":
            servo = read_toml(Path(base)).get("servo")
            text += "" if servo is None else "\n" + toml_text({"servo": servo})
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text_atomic(path, text)

    def __repr__(self) -> str:
        error = f"largest error {100 * self.error:.2g} %"
        return f"<Calibration of {self.measured.robot}: {self.rounds} rounds, {error}>"

    def __str__(self) -> str:
        lines = []
        for (j, k, d), tau in np.ndenumerate(self.measured.tau):
            name = f"Joint {j + 1} {POSES[LOADS[k]]} ({DIRECTIONS[d]})"
            found = self.simulated[j, k, d]
            off = percent(100 * float(found / tau - 1), 2)
            lines.append([name, f"{tau:+.4f}", f"{found:+.4f}", off])
        header = ["configuration", "measured [N·m]", "simulated [N·m]", "off"]
        text = [aligned(header, lines)]
        if self.negative_load:
            text.append(
                f"{joints(self.negative_load)}: friction was smaller in the load pose, which load "
                "does not explain"
            )
        return "\n".join([*text, f"{self.rounds} rounds"])


def with_levels(
    parameters: FrictionParameters, poses: Poses, friction: Array, offset: Array
) -> FrictionParameters:
    """Return parameters of one arm whose law passes through both poses of every joint.

    ``friction`` and ``offset`` (n, 2) are those in the load and the no-load pose [N·m].
    """
    high, low = poses.load[:, 0], poses.load[:, 1]

    def line(values: Array, x: Array) -> tuple[Array, Array]:
        """Return slope and intercept through both poses; 0 and the mean where x is the same."""
        run = x[:, 0] - x[:, 1]
        flat = np.abs(run) < SAME_LOAD
        slope = np.where(flat, 0.0, (values[:, 0] - values[:, 1]) / np.where(flat, 1.0, run))
        return slope, np.where(flat, values.mean(axis=1), values[:, 1] - slope * x[:, 1])

    slope, level = line(friction, poses.load)
    gravity_error, bias = line(offset, poses.signed)
    return parameters.replace(
        stiction=np.repeat(level[:, None], 2, axis=1),
        load_coefficient=slope,
        load_low=low,
        load_high=high,
        offset=bias,
        gravity_error=gravity_error,
    )


def calibrate(
    table: BaseTable,
    experiment: SingleJointExperiment,
    *,
    progress: Callable[[int, float], None] | None = None,
    tolerance: float = TOLERANCE,
) -> Calibration:
    """Identify stiction, load coefficient, offset and gravity error of every joint.

    Args:
        table: measured base torques.
        experiment: the arm and the protocol it was measured with; its scatter is switched off.
        progress: called with (round, largest relative error so far) after each round.
        tolerance: rounds end when every base torque agrees this well, relative [-].

    Raises:
        StictionError: another number of joints, friction ≤ 0, or joints under position servos.
        ExperimentError: no convergence (the message names the worst cell).
    """
    n = experiment.n
    if table.n_joints != n:
        raise StictionError(f"base table of {table.n_joints} joints, but the arm has {n}")
    if experiment.servos is not None:
        raise StictionError("calibration under position servos: expected drive torque")
    if (table.friction <= 0).any():
        raise StictionError("base table: friction (half-difference of + and −) must be positive")
    poses = experiment.poses
    own = experiment.sticking.parameters
    friction = np.stack([own.stiction_at(load).mean(axis=1) for load in poses.load.T], axis=1)
    offset = own.offset[:, None] + own.gravity_error[:, None] * poses.signed
    best: Calibration | None = None
    for round_ in range(1, ROUNDS + 1):
        parameters = with_levels(own, poses, friction, offset)
        sticking = build(experiment.sticking.arm, parameters, timestep=experiment.sticking.timestep)
        trial = experiment.replace(sticking=sticking, scatter=False)
        simulated = trial.base_torques().tau
        error = np.abs(simulated - table.tau) / np.abs(table.tau)
        worst = float(np.nan_to_num(error, nan=np.inf).max())
        if best is None or worst < best.error:
            best = Calibration(
                parameters=parameters,
                simulated=simulated,
                measured=table,
                error=worst,
                rounds=round_,
                negative_load=tuple(
                    int(j) + 1 for j in np.flatnonzero(parameters.load_coefficient < 0)
                ),
            )
        if progress is not None:
            progress(round_, worst)
        if best.error <= tolerance:
            break
        if round_ == 1 and worst > FAR:
            friction, offset = table.friction.copy(), table.offset.copy()
            continue
        half_width = (simulated[..., 0] - simulated[..., 1]) / 2
        middle = (simulated[..., 0] + simulated[..., 1]) / 2
        # the slide to the threshold adds to the reading, for any friction
        friction = np.maximum(
            friction + table.friction - half_width, LEAST_FRICTION * table.friction
        )
        offset = offset + table.offset - middle
    assert best is not None
    if best.error > CONVERGED * tolerance:
        cell = np.unravel_index(
            np.argmax(np.abs(best.simulated - table.tau) / np.abs(table.tau)), table.tau.shape
        )
        raise ExperimentError(
            f"calibration did not converge: joint {cell[0] + 1}, "
            f"{LOADS[cell[1]]}, {DIRECTIONS[cell[2]]}: simulated "
            f"{best.simulated[cell]:.4f} N·m, measured {table.tau[cell]:.4f} N·m"
        )
    return best


def _strings(run: Provenance) -> dict[str, str]:
    """Return what a friction TOML keeps of a command's provenance."""
    inputs = {k: v["sha256"] for k, v in run["inputs"].items()}
    return {
        "arguments_sha256": run["arguments_sha256"],
        "git_commit": run["git_commit"] or "none: not run from a checkout",
        "seed": str(run["seed"]),
        **{f"{k}_sha256": inputs[k] for k in ("friction", "robot") if k in inputs},
        "versions": ", ".join(f"{k} {v}" for k, v in run["versions"].items()),
    }
