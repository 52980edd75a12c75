"""Soak: plant steps over random arms, frictions and dithers; a violation of physics is noted.

    python -m benchmarks.accuracy.soak [--steps 1e8] [--seed 0]

A round draws from its own seed an arm (a shipped one, or an MJCF of 2 to 9 hinges), a friction for
each of 64 simulations, and a dither for each, and takes them through `PHASES`. After every block of
50 ms states must be finite, speeds and bristles within bounds, and what nothing drives may not gain
mechanical energy; every `CONFORMANCE_EVERY`th arm is tested to stick. Exit code 1 if a row has a
violation, 130 if it was interrupted.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.soak_draws import NSIM, draw_arm, draw_dither, draw_friction, draw_model
from benchmarks.harness import Benchmark, Row
from stiction_envs.errors import ExperimentError
from stiction_envs.experiments.conformance import conformance
from stiction_envs.experiments.settings import experiment_settings
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.plant import CONTROL_DT, Plant
from stiction_envs.reporting.markdown import short, table_text

Array = NDArray[np.float64]
PLACES = (
    *("benchmarks/accuracy/soak.py", "benchmarks/accuracy/soak_draws.py", "stiction_envs/plant"),
    *("stiction_envs/friction", "stiction_envs/robots", "stiction_envs/dither"),
    "stiction_envs/experiments",
)
STUDY = Benchmark(__file__, __doc__, made_by=PLACES)
BLOCK = 50
"""Control steps between two checks; assumed."""
PHASES = {"rest": 120, "dither": 40, "shaken": 10, "let go": 30, "stops": 20}
"""Blocks of each phase, in order; assumed. Bristles take seconds at rest to balance all
joints' ripples."""
WATCHED = 20
"""Blocks at the end of rest in which nothing may creep; assumed."""
ROUND = NSIM * BLOCK * sum(PHASES.values())
"""Plant steps of a round."""
CONFORMANCE_EVERY = 16
"""Rounds; assumed, as are the tolerances below but for `STILL`."""
STILL = 1e-6
"""Largest motion of a joint in the watched part of rest [rad]: that of the conformance check."""
KINDS = ("speed", "bristle", "energy rise", "motion at rest", "creep")
"""What is measured against a bound."""
ENERGY = 0.01
"""Largest rise of energy that nothing drives, of that when first off the stops [-]; assumed."""
BRISTLE = 1e-3
"""Largest bristle deflection over stiction / stiffness, less one [-]; assumed."""
STROKES = 4.0
"""Strokes of all joints at their torque limit that bound an arm's kinetic energy [-];
assumed."""


class Checks:
    """What must hold of a plant after every block; what did not is in `violations`."""

    def __init__(self, plant: Plant, friction: FrictionParameters) -> None:
        self.plant, self.friction = plant, friction
        self.violations: dict[tuple[str, str], Row] = {}
        self.steps = 0
        self.largest = dict.fromkeys(KINDS, 0.0)
        self._level = np.zeros((plant.nsim, plant.n))
        self._data = mujoco.MjData(plant.sticking.model)
        limits = plant.sticking.arm.limits
        self._most = STROKES * float(limits.torque @ np.ptp(limits.position, axis=1))

    def judge(self, what: str, phase: str, value: Array, bound: float | Array) -> None:
        """Note the largest value over its bound (N,) or (N, n); NaN is over every bound."""
        ratio = (
            np.nan_to_num(value / bound, nan=np.inf, posinf=np.inf)
            .reshape(len(value), -1)
            .max(axis=1)
        )
        self.largest[what] = max(self.largest[what], float(ratio.max()))
        if ratio.max() > 1:
            self.note(what, phase, int(ratio.argmax()), float(ratio.max()))

    def note(self, what: str, phase: str, sim: int = -1, ratio: float = np.inf) -> None:
        """Note the worst violation of a kind and phase, and its simulation; −1 for all."""
        old = self.violations.get((what, phase))
        if old is None or old["over_bound"] < ratio:
            new = {"what": what, "phase": phase, "sim": sim, "over_bound": ratio}
            self.violations[what, phase] = new

    def state(self, phase: str) -> bool:
        """Check finite state, speed and bristles; whether the state is finite."""
        (qpos, qvel), z = self.plant.state, self.plant.bristle
        finite = np.isfinite(np.hstack([qpos, qvel, z])).all(axis=1)
        if not finite.all():
            self.note("not finite", phase, int(np.argmin(finite)))
            return False
        p = self.friction
        # a rotor's energy is no more than the arm's: J q̇² / 2 ≤ T
        motor = np.abs(qvel[:, self.plant.sticking.motor])
        self.judge("speed", phase, motor, np.sqrt(2 * self._most / p.rotor_inertia))
        # a bristle that was bent under more load may stay so until the joint moves
        level = p.stiction_at(self.plant.load[1]).max(axis=-1)
        self._level = np.maximum(self._level, np.maximum(level, self.plant.stiction))
        bound = (1 + BRISTLE) * self._level / p.bristle_stiffness
        self.judge("bristle", phase, np.abs(z), bound)
        return True

    def energy(self) -> tuple[Array, NDArray[np.bool_]]:
        """Return (N,) kinetic + spring + bristle + ripple energy [J], and which touch no stop.

        Gravity is compensated. A stop keeps energy while it is pressed in, so only arms off their
        stops can be compared.
        """
        model, data, p = self.plant.sticking.model, self._data, self.friction
        qpos, qvel = self.plant.state
        motor, kinetic = self.plant.sticking.motor, np.empty(self.plant.nsim)
        momentum, rotor = np.empty(model.nv), np.zeros_like(qvel)
        rotor[:, motor] = p.rotor_inertia - model.dof_armature[motor]
        for i in range(len(qpos)):  # a check once per block: the engine's batch has no energy
            data.qpos[:], data.qvel[:] = qpos[i], qvel[i]
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_mulM(model, data, momentum, qvel[i])
            kinetic[i] = qvel[i] @ (momentum + rotor[i] * qvel[i]) / 2
        q = qpos[:, motor]
        potential = p.bristle_stiffness * self.plant.bristle**2 / 2
        turn = p.ripple_periods * q + p.ripple_phase
        potential += p.ripple_amplitude / p.ripple_periods * np.cos(turn)
        spring = qpos**2 @ model.jnt_stiffness / 2
        low, high = model.jnt_range[model.dof_jntid[motor]].T
        free = ((q > low) & (q < high)).all(axis=1)
        return kinetic + spring + potential.sum(axis=1), free


def soak(plant: Plant, friction: FrictionParameters, rng: np.random.Generator) -> Checks:
    """Take a plant through the phases, up to the first state that is not finite."""
    checks, arm = Checks(plant, friction), plant.sticking.arm
    limit, dither = arm.limits.torque, draw_dither(rng, arm)
    low, high = arm.limits.position.T
    edge = 0.05 * (high - low)
    plant.reset(np.arange(NSIM), rng.uniform(low + edge, high - edge, (NSIM, arm.n)))
    slope = limit * rng.uniform(-0.5, 0.5, (NSIM, arm.n))
    push = limit * rng.choice([-1.0, 1.0], (NSIM, arm.n))
    k = 0
    for phase, blocks in PHASES.items():
        before = settled = plant.position.copy()
        energy, free = checks.energy()
        last = scale = np.where(free, energy, np.inf)
        for block in range(blocks):
            if block == blocks - WATCHED:
                settled = plant.position.copy()
            t = (np.arange(BLOCK) + k) * CONTROL_DT
            torque = np.zeros((NSIM, BLOCK, arm.n))
            if phase in ("dither", "shaken"):
                speed = plant.velocity.copy()
                torque += np.stack([dither.torque(float(now), speed) for now in t], axis=1)
            if phase == "dither":
                torque += (
                    slope[:, None] * (block + np.arange(1, BLOCK + 1)[:, None] / BLOCK) / blocks
                )
            if phase == "stops":
                torque += push[:, None] if block < blocks / 2 else -push[:, None]
            try:
                plant.run(np.clip(torque, -limit, limit))
            except ExperimentError as error:
                checks.note(f"engine: {error}", phase)
                return checks
            k += BLOCK
            checks.steps += NSIM * BLOCK
            if not checks.state(phase):
                return checks
            if phase == "let go":
                energy, free = checks.energy()
                rise = np.where(free & np.isfinite(last), energy - last, 0.0)
                scale = np.where(free & np.isinf(scale), energy, scale)
                checks.judge("energy rise", phase, rise, ENERGY * (1e-6 + np.abs(scale)))
                last = np.where(free, energy, last)
        if phase == "rest":
            # ripples bend the bristles of all joints, their neighbours' too: none may slide
            presliding = plant.stiction / friction.bristle_stiffness
            checks.judge("motion at rest", phase, np.abs(plant.position - before), presliding)
            if blocks > WATCHED:
                checks.judge("creep", phase, np.abs(plant.position - settled), STILL)
    return checks


def one_round(seed: int, number: int) -> Row:
    """Return the row of a round; an error in it does not end the soak."""
    rng = np.random.default_rng([seed, number])
    row: Row = {"seed": seed, "round": number, "steps": 0, "violations": []}
    try:
        arm = draw_arm(rng)
        model = draw_model(rng, arm)
        friction = draw_friction(rng, model)
        row |= {"arm": arm.name, "joints": arm.n, "elastic": int(friction.elastic.sum())}
        checks = soak(Plant(model, NSIM, parameters=friction, threads=1), friction, rng)
        row |= {"largest": checks.largest, "steps": checks.steps}
        if number % CONFORMANCE_EVERY == 0:
            s = experiment_settings().conformance
            s = dataclasses.replace(s, hold_time=20.0, watched_time=5.0)
            row["conformance"] = bool(
                conformance(model, rates=(1.0,), threads=1, settings=s).passed
            )
            if not row["conformance"]:
                checks.note("conformance", "90 % and 110 %")
        row["violations"] = list(checks.violations.values())
    except Exception as error:  # a row, never the end of the soak
        what = f"{type(error).__name__}: {error}"
        row["violations"] = [{"what": what, "phase": "", "sim": -1, "over_bound": np.inf}]
    return row


def page(rows: Sequence[Row]) -> dict[str, Any]:
    """Return what the page's template asks for."""
    violations = [
        [
            *map(
                str,
                (r["round"], r.get("arm", ""), v["what"], v["phase"], v["sim"], v["over_bound"]),
            )
        ]
        for r in rows
        for v in r["violations"]
    ]
    largest = [
        [n, short(max((r["largest"][n] for r in rows if "largest" in r), default=0.0))]
        for n in KINDS
    ]
    header = ["round", "arm", "what", "phase", "simulation", "times its bound"]
    return {
        "steps": sum(r["steps"] for r in rows),
        "arms": len(rows),
        "own": sum(r.get("arm") == "own" for r in rows),
        "elastic": sum(r.get("elastic", 0) > 0 for r in rows),
        "tested": sum("conformance" in r for r in rows),
        "rate": sum(r["steps"] for r in rows) / max(sum(r["seconds"] for r in rows), 1e-9),
        "seed": rows[0]["seed"] if rows else 0,
        "found": len(violations),
        "violations": table_text(header, violations),
        "largest": table_text(["check", "largest, of its bound"], largest),
        "tolerance": ENERGY,
        "bristle": BRISTLE,
        "strokes": STROKES,
        "still": STILL,
        "rest": PHASES["rest"] * BLOCK * CONTROL_DT,
        "watched": WATCHED * BLOCK * CONTROL_DT,
    }


def main(argv: Sequence[str] | None = None) -> int:
    parser = STUDY.parser()
    parser.add_argument("--steps", type=float, default=1e8, help="plant steps in all")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(argv)
    rounds = {f"{options.seed} {k}": k for k in range(math.ceil(options.steps / ROUND))}
    kept, stopped = STUDY.rows(options), False
    try:
        kept.fill(rounds, lambda k: one_round(options.seed, k), minutes=options.minutes)
    except KeyboardInterrupt:
        stopped = True
    rows = list(kept.known(rounds).values())
    STUDY.write_page(options, **page(rows))
    return 130 if stopped else int(any(row["violations"] for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
