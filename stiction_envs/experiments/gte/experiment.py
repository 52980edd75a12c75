"""Generated Trajectory Experiment (thesis 3.2, 4.2): paths under Cartesian impedance control.

experiment = GeneratedTrajectoryExperiment("panda")
errors = experiment.measure([Case(trajectory="triangle", stiffness=(200, 20, 0))])
print(errors)
errors.save("runs/triangle")
"""

import dataclasses
import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as File

import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array
from stiction_envs.control.compensation import Compensation
from stiction_envs.control.compensation_files import is_file, read_compensation
from stiction_envs.control.impedance import ImpedanceSettings
from stiction_envs.control.sensing import SensingLike
from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.control.trajectory import MotionLimits, Path, new_movements
from stiction_envs.control.trapezoid import plan
from stiction_envs.errors import StictionError, checked_array, unknown
from stiction_envs.experiments.gte.measures import Measures
from stiction_envs.experiments.gte.protocol import (
    PATHS,
    Case,
    GTEProtocol,
    Run,
    load_gte_protocol,
    start_angles,
)
from stiction_envs.experiments.gte.random_paths import RANDOM, path_number, random_paths
from stiction_envs.experiments.gte.results import TrackingErrors
from stiction_envs.experiments.gte.rig import GTERig, GTESetup
from stiction_envs.experiments.gte.sampling import RunLog
from stiction_envs.experiments.rig import dither_arrays
from stiction_envs.experiments.sje.protocol import load_protocol
from stiction_envs.friction.from_file import simulated_note
from stiction_envs.friction.parameters import FrictionParameters, stack_friction
from stiction_envs.friction.sticking import Friction, Robot, check_torque_driven, sticking_model
from stiction_envs.plant import CONTROL_DT, Plant
from stiction_envs.reporting.provenance import provenance
from stiction_envs.robots import Arm

MAX_SIMULATIONS = 128  # Simulations run at once (assumed)
_PART = 10  # samples of a block, after which it is checked whether all arms are done; assumed


@dataclass(frozen=True, init=False, repr=False)
class GeneratedTrajectoryExperiment(GTESetup):
    """One arm, its friction, its controller and the protocol: all that defines a result."""

    paths: Mapping[str, Path]
    """Paths other than the triangle and the pentagon, by name."""

    def __init__(
        self,
        robot: Robot,
        *,
        friction: Friction | None = None,
        protocol: GTEProtocol | None = None,
        settings: ImpedanceSettings | None = None,
        motion: MotionLimits | None = None,
        interface: TorqueInterface | None = None,
        sensing: SensingLike = "ideal",
        start: ArrayLike | None = None,
        tool: ArrayLike | None = None,
        paths: Mapping[str, Path] | None = None,
        controller_model: Arm | None = None,
        scatter: bool = True,
        seed: int = 0,
        timestep: float | None = None,
        threads: int = 0,
    ) -> None:
        """Set the experiment up.

        Args:
            robot: name, model file, arm, or an arm with its friction (`load_model`).
            friction: of one arm, or its TOML; None for the robot's friction.
            protocol: None for the default.
            settings: of the controller; None for the defaults.
            motion: of the trajectory generator.
            interface: None for the robot's.
            sensing: what the controller sees: "ideal", "robot", a TOML, or `Sensing`. Errors and
                vibration that are reported are always the true ones.
            start: (n,) joint angles at the start [rad]; None for the robot's.
            tool: (3,) the controlled and measured point from the flange, in the hand's frame [m];
                None for the flange. The Panda's hand has (0, 0, 0.1034).
            paths: own paths by name.
            controller_model: the controller's model of the arm; None for the true model.
            scatter: whether iterations differ.
            seed: of the scatter.
            timestep: physics step [s]; None for the model's step, or 1 ms.
            threads: threads, 0 for all processors.

        Raises:
            StictionError: anything wrong with the arm, its friction or senses, the start or the
                tool point; an arm under position servos.
        """
        sticking = sticking_model(robot, friction, timestep=timestep)
        check_torque_driven(sticking, "Cartesian impedance controllers")
        super().__init__(
            sticking,
            interface=interface,
            sensing=sensing,
            scatter=scatter,
            seed=seed,
            threads=threads,
        )
        arm, point = sticking.arm, "three finite numbers, x y z in m"
        if controller_model is not None and controller_model.joint_names != arm.joint_names:
            raise StictionError("the controller's model must have the joints of the arm")
        vars(self).update(
            protocol=load_gte_protocol() if protocol is None else protocol,
            approach=load_protocol(arm.registered_name),
            settings=ImpedanceSettings() if settings is None else settings,
            motion=MotionLimits() if motion is None else motion,
            start=start_angles(arm, start),
            tool=checked_array((0, 0, 0) if tool is None else tool, "tool", (3,), expected=point),
            paths=dict(paths or {}),
            controller_model=controller_model,
        )

    def path(self, name: str) -> Path:
        """Return a path by name; ``random-17`` is number 17 of `random_paths`."""
        if name in self.paths:
            return self.paths[name]
        if (number := path_number(name)) is not None:
            return random_paths(self.sticking, self.start, self.tool, [number])[number].path
        if name not in PATHS:
            raise unknown("trajectory", name, [*PATHS, *self.paths, f"{RANDOM}-0, 1, …"])
        return PATHS[name]()

    def rig(self, nsim: int, capacity: int, parameters: FrictionParameters | None = None) -> GTERig:
        """Return the machine that runs ``nsim`` arms on paths of at most ``capacity`` goals.

        ``parameters`` is their true friction, of one arm or of each; None for the model's.
        """
        return GTERig(self, nsim, capacity, parameters)

    def compensation(
        self, kind: str | File, factor: float = 1.0, *, table: str | File | None = None
    ) -> Compensation:
        """Return friction compensation whose model of the friction is the nominal one.

        Args:
            kind: one of `control.laws.LAWS`, or a file with kind and gains:
                ``compensation.csv``, or a ``final.yaml``.
            factor: of the friction that is compensated [-].
            table: of gains; None for those of the friction at the start's load.
        """
        if is_file(kind):
            return read_compensation(kind, None, self.n, factor)
        kind = str(kind)
        if table is not None:
            return read_compensation(File(table), kind, self.n, factor)
        return Compensation.from_friction(
            kind, self.sticking.parameters, factor, load=self.start_load()
        )

    def start_load(self) -> Array:
        """Return the torque (n,) that each joint transmits at the start, its magnitude [N·m]."""
        plant = Plant(self.sticking, 1, threads=1)
        plant.reset(np.array([0]), self.start[None])
        return plant.load[1][0]

    def nominal_duration(self, path: Path) -> float:
        """Return the time a path takes an arm that follows exactly [s]."""
        position = np.concatenate([np.zeros((1, 3)), path.position])
        quaternion = np.concatenate([[[1.0, 0.0, 0.0, 0.0]], path.quaternion])
        movement = new_movements(len(path.position), self.motion)
        movement.asked[:] = path.pace
        for k in range(len(path.position)):
            plan(k, position[k], quaternion[k], position[k + 1], quaternion[k + 1], movement)
        return float(movement.duration.sum())

    def expected_seconds(self, cases: Sequence[Case], iterations: int | None = None) -> float:
        """Return the simulated time [s] that cases take an arm that follows exactly."""
        repeats = self.protocol.iterations if iterations is None else iterations
        tail = self.protocol.tail
        return repeats * sum(self.nominal_duration(self.path(c.trajectory)) + tail for c in cases)

    def measure(
        self,
        cases: Sequence[Case],
        *,
        iterations: int | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> TrackingErrors:
        """Run cases to the end; see `run`. The result can be saved as tables and plots."""
        runs = self.run(cases, iterations=iterations, progress=progress)
        arm = self.sticking.arm
        model = self.controller_model
        model_hash = None if model is None else hashlib.sha256(model.xml.encode()).hexdigest()
        return TrackingErrors(
            robot=arm.name,
            runs=tuple((r, Measures(r, self.protocol, self.motion)) for r in runs),
            note=simulated_note(arm, self.sticking.parameters),
            provenance=provenance(
                "gte",
                {
                    **self.record,
                    "protocol": dataclasses.asdict(self.protocol),
                    "settings": dataclasses.asdict(self.settings),
                    "motion": dataclasses.asdict(self.motion),
                    "start": self.start,
                    "tool": self.tool,
                    "paths": {k: dataclasses.asdict(p) for k, p in self.paths.items()},
                    "controller_model_sha256": model_hash,
                    "iterations": iterations,
                    "cases": [dataclasses.asdict(c) for c in cases],
                },
                seed=self.seed,
            ),
        )

    def run(
        self,
        cases: Sequence[Case],
        *,
        parameters: Sequence[FrictionParameters | None] | None = None,
        iterations: int | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> list[Run]:
        """Run all iterations of all cases; a case's result does not depend on the others.

        Args:
            cases: what to run.
            parameters: true friction of each case, of one arm; None for the model's. Which joints
                are elastic, and the controller's own model, remain the nominal ones.
            iterations: None for the protocol's.
            progress: called with the simulated seconds of every part, summed over arms.

        Raises:
            StictionError: a case, friction or compensation that does not fit.
            ExperimentError: a simulation that the engine stopped.
        """
        repeats = self.protocol.iterations if iterations is None else iterations
        out: list[Run] = []
        most = max(1, MAX_SIMULATIONS // repeats)
        true = [None] * len(cases) if parameters is None else list(parameters)
        if len(true) != len(cases):
            raise StictionError(f"friction of {len(true)} cases: expected {len(cases)}")
        for k in range(0, len(cases), most):
            part = slice(k, k + most)
            out += self._run_together(cases[part], true[part], repeats, progress)
        return out

    def _run_together(
        self,
        cases: Sequence[Case],
        parameters: Sequence[FrictionParameters | None],
        repeats: int,
        progress: Callable[[float], None] | None,
    ) -> list[Run]:
        paths = [self.path(c.trajectory) for c in cases]
        nsim = len(cases) * repeats
        ids = np.arange(nsim)
        of = [int(i) // repeats for i in ids]
        friction = None
        if any(p is not None for p in parameters):
            own = self.sticking.parameters
            friction = stack_friction([parameters[i] or own for i in of])
            if friction.n != self.n:
                raise StictionError(f"friction of {friction.n} joints: expected {self.n}")
        rig = self.rig(nsim, max(len(p.position) for p in paths), friction)
        # the same iteration starts alike in every case: what differs is the case
        rig.begin(
            ids,
            [paths[i] for i in of],
            np.array([cases[i].stiffness for i in of]),
            [(int(i % repeats),) for i in ids],
        )
        dither = [dither_arrays(c.dither, self.n) for c in cases]
        rig.set_dither(ids, **{k: np.stack([dither[i][k] for i in of]) for k in dither[0]})
        rig.compensator.set_rows(ids, [cases[i].compensation for i in of])
        block = _PART * round(1.0 / self.protocol.sample_rate / CONTROL_DT)
        log = RunLog(rig, self.protocol, block)
        while log.time < np.max(log.end):
            log.advance()
            if progress is not None:
                progress(nsim * block * CONTROL_DT)
        return [
            log.run(case, np.array(of) == i, len(paths[i].position)) for i, case in enumerate(cases)
        ]
