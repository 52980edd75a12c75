"""Single Joint Experiment (thesis 3.2): the torque at which a joint breaks away.

experiment = SingleJointExperiment("panda")
base = experiment.base_torques()
print(base)
base.save("runs/base")
"""

import copy
import dataclasses
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.arrays import Index
from stiction_envs.control.position_servo import put_under_servos
from stiction_envs.control.sensing import SensingLike
from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.errors import StictionError, unknown
from stiction_envs.experiments.poses import Poses, find_poses
from stiction_envs.experiments.rig import Experiment
from stiction_envs.experiments.sje.protocol import (
    DIRECTIONS,
    LOADS,
    Job,
    Measurement,
    Protocol,
    configurations,
    load_protocol,
)
from stiction_envs.experiments.sje.results import BreakawayTorques, in_order
from stiction_envs.experiments.sje.rig import BLOCK, RAMP, SJERig
from stiction_envs.experiments.sje.servo_rig import ServoRig
from stiction_envs.friction.from_file import simulated_note
from stiction_envs.friction.servos import PositionServos
from stiction_envs.friction.sticking import Friction, Robot, sticking_model
from stiction_envs.measured.tables import AmplitudeRow, read_amplitudes
from stiction_envs.plant import CONTROL_DT
from stiction_envs.reporting.provenance import provenance

DitherTable = str | Path | Sequence[AmplitudeRow]  # An amplitude table, or its rows
MAX_SIMULATIONS = 384
"""Simulations run at once (assumed): more cost memory and gain nothing on a few cores."""


@dataclass(frozen=True, init=False, repr=False)
class SingleJointExperiment(Experiment):
    """One arm, its friction, its torque interface and the protocol: all that defines a result."""

    protocol: Protocol
    poses: Poses
    servos: PositionServos | None
    """Servos that drive the joints under gravity; None: torques, gravity compensated."""

    def __init__(
        self,
        robot: Robot,
        *,
        friction: Friction | None = None,
        drive: str | None = None,
        protocol: Protocol | None = None,
        interface: TorqueInterface | None = None,
        sensing: SensingLike = "ideal",
        scatter: bool = True,
        seed: int = 0,
        timestep: float | None = None,
        threads: int = 0,
    ) -> None:
        """Set the experiment up.

        Args:
            robot: name, model file, arm, or an arm with its friction (`load_model`).
            friction: of one arm, or its TOML; None for the robot's friction.
            drive: "torque", or "position": the joints' position servos of a friction TOML with a
                table ``[servo]``, which `diagnose` writes of servo logs. None: what the arm has.
            protocol: None for the robot's.
            interface: None for the robot's.
            sensing: what the controller sees, which says when a joint has broken away and gates
                dither: "ideal", "robot", a TOML, or `Sensing`.
            scatter: whether iterations differ.
            seed: of the scatter.
            timestep: physics step [s]; None for the model's step, or 1 ms.
            threads: threads, 0 for all processors.

        Raises:
            StictionError: anything wrong with the arm, its friction, its senses, its servos or its
                poses.
        """
        sticking = sticking_model(robot, friction, timestep=timestep)
        if drive not in (None, "torque", "position"):
            raise unknown("drive", drive, ("torque", "position"))
        servos = None if drive == "torque" else sticking.servos
        if drive == "position" and servos is None:
            raise StictionError(
                "drive position: expected a friction TOML with a table [servo], as a diagnosis of "
                "servo logs writes it"
            )
        if servos is not None:
            sticking = dataclasses.replace(sticking, model=copy.copy(sticking.model))
            put_under_servos(sticking, servos)
        super().__init__(
            sticking,
            interface=interface,
            sensing=sensing,
            scatter=scatter,
            seed=seed,
            threads=threads,
        )
        arm = sticking.arm
        if servos is not None:
            vars(self).update(interface=self.interface.unlimited())
        if protocol is None:
            protocol = load_protocol(arm.registered_name, position=servos is not None)
        vars(self).update(servos=servos, protocol=protocol, poses=find_poses(arm))

    def jobs(
        self,
        joints: Sequence[int] | None = None,
        *,
        loads: Sequence[str] = LOADS,
        directions: Sequence[str] = DIRECTIONS,
        dither: DitherTable | None = None,
    ) -> list[Job]:
        """Return undithered jobs, then those with the dither of a table.

        Args:
            joints: 1..n; None for all.
            loads: poses.
            directions: of the ramp.
            dither: each joint under test is dithered by its row; None for no dither.

        Raises:
            StictionError: a joint that the arm lacks; a table that cannot be read, dithers none of
                the joints, or exceeds the arm's limits.
        """
        base = [
            Job(c)
            for c in configurations(self.n, None if joints is None else list(joints))
            if c.load in loads and c.direction in directions
        ]
        if dither is None:
            return base
        rows = self._rows(dither, sorted({j.configuration.joint for j in base}))
        return base + [
            Job.of(job.configuration, row)
            for job in base
            if (row := rows.get(job.configuration.joint)) is not None
        ]

    def _rows(self, dither: DitherTable, tested: list[int]) -> dict[int, AmplitudeRow]:
        """Return the row of each joint that is dithered and tested."""
        where = "dither"
        if isinstance(dither, str | Path):
            arm, where = self.sticking.arm, str(dither)
            dither = read_amplitudes(
                dither,
                n_joints=arm.n,
                torque_limit=arm.limits.torque,
                controller_rate_hz=self.interface.controller_rate_hz,
            )
        for row in dither:
            if row.amplitude_nm == 0 and row.offset_nm != 0:
                raise StictionError(
                    f"{where}: joint {row.joint} has offset_nm {row.offset_nm:g} without "
                    "amplitude: expected an amplitude_nm above 0, or no offset"
                )
        dithered = {row.joint: row for row in dither if row.amplitude_nm > 0}
        chosen = {j: row for j, row in dithered.items() if j in tested}
        if not chosen:
            has = ", ".join(map(str, sorted(dithered))) or "no joint"
            asked = ", ".join(map(str, tested))
            raise StictionError(f"{where}: dithers {has}, but the joints tested are {asked}")
        return chosen

    def rig(self, nsim: int) -> SJERig:
        """Return the machine that runs ``nsim`` simulations of this experiment; see `SJERig`."""
        if self.servos is not None:
            return ServoRig(self, nsim, self.protocol, self.poses, self.servos)
        return SJERig(self, nsim, self.protocol, self.poses)

    @property
    def record(self) -> dict[str, object]:
        """Entries of a provenance for all but protocol and seed."""
        servos = None if self.servos is None else dataclasses.asdict(self.servos)
        return {**super().record, "servos": servos}

    def expected(self, job: Job) -> float:
        """Return the approximate size of a job's torque [N·m], to plan the work."""
        j, load, direction = job.configuration.index
        p = self.sticking.parameters
        stiction = p.stiction_at(self.poses.load[:, load])[j, direction]
        offset = p.offset[j] + p.gravity_error[j] * self.poses.signed[j, load]
        return float(abs(stiction * job.configuration.sign + offset))

    def expected_seconds(self, jobs: Sequence[Job], iterations: int | None = None) -> float:
        """Return the simulated time [s] that jobs take, roughly, for a progress bar."""
        p = self.protocol
        approach = p.return_time + p.settle_time
        # a joint under a position servo follows its command until the threshold
        follows = np.zeros(self.n) if self.servos is None else self.servos.stiffness * p.threshold
        ramps = sum(
            approach + (self.expected(job) + follows[job.configuration.joint - 1]) / p.ramp_rate
            for job in jobs
        )
        return float(ramps * (p.iterations if iterations is None else iterations))

    def measure(
        self,
        jobs: Sequence[Job],
        *,
        iterations: int | None = None,
        progress: Callable[[float], None] | None = None,
        file: str = "sje.csv",
    ) -> BreakawayTorques:
        """Run jobs to the end; see `run`. The result can be saved as ``file`` and plots."""
        measured = self.run(jobs, iterations=iterations, progress=progress)
        arm = self.sticking.arm
        return BreakawayTorques(
            robot=arm.name,
            n=self.n,
            protocol=self.protocol,
            measurements=tuple(in_order(measured)),
            note=simulated_note(arm, self.sticking.parameters),
            servo_stiffness=None if self.servos is None else self.servos.stiffness,
            provenance=provenance(
                "sje",
                {
                    **self.record,
                    "protocol": dataclasses.asdict(self.protocol),
                    "iterations": iterations,
                    "jobs": [dataclasses.asdict(job) for job in jobs],
                },
                seed=self.seed,
            ),
            file=file,
        )

    def base_torques(self) -> BreakawayTorques:
        """Measure the torque at which every joint breaks away without dither; see `measure`.

        The result has rows as in ``base.csv``, and (n, 2, 2) `BreakawayTorques.tau` [N·m].
        """
        return self.measure(self.jobs(), file="base.csv")

    def run(
        self,
        jobs: Sequence[Job],
        *,
        iterations: int | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Iterator[Measurement]:
        """Run jobs, yielding each as it is done: a simulation that is free takes the next job.

        Args:
            jobs: what to measure; the result of one does not depend on the others.
            iterations: repeats, None for the protocol's.
            progress: called with the simulated seconds of every block, summed over simulations.

        Raises:
            ExperimentError: an arm that cannot be held in its pose.
        """
        if not jobs:
            return
        repeats = int(self.protocol.iterations) if iterations is None else iterations
        # the longest first: the last to finish should not be the last to start
        queue = deque(sorted(jobs, key=self.expected, reverse=True))
        rig = self.rig(min(len(jobs), MAX_SIMULATIONS))
        logs: dict[int, RampLog] = {}
        while queue or logs:
            free = [i for i in range(rig.nsim) if i not in logs][: len(queue)]
            if free:
                logs |= {i: RampLog(queue.popleft()) for i in free}
                rig.place(np.array(free), [logs[i].job.configuration for i in free])
                self._begin(rig, np.array(free), logs)
            busy = np.array(sorted(logs))
            ended = rig.advance(busy)
            if progress is not None:
                progress(len(busy) * BLOCK * CONTROL_DT)
            self._trace(rig, busy, ended, logs)
            again = []
            for i in map(int, ended):
                logs[i].close(rig, i)
                if len(logs[i].ramps) < repeats:
                    again.append(i)
                else:
                    yield logs.pop(i).measurement()
            if again:
                self._begin(rig, np.array(again), logs)

    def _begin(self, rig: SJERig, ids: Index, logs: dict[int, "RampLog"]) -> None:
        jobs = [logs[int(i)].job for i in ids]
        keys = [
            (*j.configuration.index, len(logs[int(i)].ramps), j.replica)
            for i, j in zip(ids, jobs, strict=True)
        ]
        rig.approach(ids, keys)
        tested = np.eye(self.n)[rig.joint[ids]]
        rig.set_dither(
            ids,
            amplitude=tested * [[j.amplitude_nm] for j in jobs],
            frequency=[[j.frequency_hz] for j in jobs],
            waveform=[[j.waveform] for j in jobs],
            offset=tested * [[j.offset_nm] for j in jobs],
            gate_velocity=[[j.gate_velocity] for j in jobs],
        )

    @staticmethod
    def _trace(rig: SJERig, busy: Index, ended: Index, logs: dict[int, "RampLog"]) -> None:
        ramping = np.concatenate([busy[rig.stage[busy] == RAMP], ended])
        if not len(ramping):
            return
        joint = rig.joint[ramping]
        angle = rig.plant.position[ramping, joint] - rig.pose[ramping, joint]
        for i, a in zip(ramping.tolist(), angle.tolist(), strict=True):
            logs[i].trace.append(a)


class RampLog:
    """Results of the ramps of one job."""

    def __init__(self, job: Job) -> None:
        self.job = job
        self.ramps: list[tuple[float, float, float, float]] = []
        self.trace: list[float] = []
        self.traces: list[NDArray[np.float32]] = []

    def close(self, rig: SJERig, i: int) -> None:
        """End one iteration."""
        start = rig.start_angle[i] - rig.pose[i, rig.joint[i]]
        self.ramps.append((rig.tau[i], start, rig.start_torque[i], rig.shaken_speed[i]))
        self.traces.append(np.array(self.trace, dtype=np.float32))
        self.trace = []

    def measurement(self) -> Measurement:
        """Return the finished job."""
        tau, start, start_torque, shaken_speed = np.array(self.ramps).T.copy()
        return Measurement(
            job=self.job,
            tau=tau,
            start=start,
            start_torque=start_torque,
            shaken_speed=shaken_speed,
            traces=tuple(self.traces),
            trace_dt=BLOCK * CONTROL_DT,
        )
