"""Samples of the arms of a rig: poses, references, vibration of the tool point.

A `RunLog` keeps the samples of an experiment, a `Recorder` adds them up for the environment.

Vibration is of the position and of the orientation: turns of the hand, added up from control step
to control step and multiplied by a lever [m], go through the same high-pass as the position.
"""

from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.compiled import compiled
from stiction_envs.control.rotation import to_rpy
from stiction_envs.experiments.gte.measures import Accumulator
from stiction_envs.experiments.gte.protocol import FLAGS, Case, GTEProtocol, Run, pose_error
from stiction_envs.experiments.gte.rig import GTERig, blank_sampling
from stiction_envs.filters import butterworth, filter_sections
from stiction_envs.plant import CONTROL_DT


class Sampler:
    """Lets a rig follow for a block of samples at a time, and says what its arms did."""

    def __init__(
        self, rig: GTERig, protocol: GTEProtocol, steps: int, *, detailed: bool = False
    ) -> None:
        """Prepare for blocks of ``steps`` control steps, a multiple of those of a sample.

        All arms have just begun to follow. ``detailed`` is that of `Sampling`.
        """
        self._rig, nsim = rig, rig.nsim
        self.stride = round(1.0 / (protocol.sample_rate * CONTROL_DT))  # Control steps of a sample
        self.size = steps // self.stride  # Samples S of a block
        self._band = butterworth(2, protocol.vibration_low, 1.0 / CONTROL_DT, high=True)
        self._lever = protocol.vibration_lever
        self._state = np.zeros((len(self._band), nsim, 6, 2))
        self._rest = np.zeros((nsim, 3))
        self._before, self._turned = np.zeros((nsim, 4)), np.zeros((nsim, 3))
        self.recorded = blank_sampling(steps, self.stride, nsim, rig.n, detailed=detailed)
        """Record of a block, overwritten by the next block."""
        self.recorded.previous[:] = rig.applied
        self.start(np.arange(nsim))

    def start(self, ids: Index) -> None:
        """Restart the filter of arms ``ids`` as if they had rested at their present poses."""
        self._rest[ids] = self._rig.end_effector.position[ids]
        self._before[ids], self._turned[ids] = self._rig.end_effector.quaternion[ids], 0.0
        self._state[:, ids] = 0.0

    def advance(self) -> tuple[Array, Array]:
        """Let all arms follow for one block of S samples, and return fresh arrays.

        Returns:
            (2, N, S, 6) poses at the first control step of each sample, the arm's and the
            reference's: x, y, z of the tool point [m], roll, pitch, yaw of the hand's frame [rad].

            (N, 6, S) mean square, over the control steps of each sample, of what is above the
            protocol's `vibration_low`: the tool point's position, then the hand's turns about x, y,
            z times the protocol's `vibration_lever` [m²].
        """
        position, quaternion, reference = self.recorded[1:4]
        self._rig.advance(len(position), self.recorded)
        shaken = np.empty((self._rig.nsim, 6, len(position)))
        _add_motion(
            *(position, self._rest, quaternion, self._lever, self._before, self._turned, shaken)
        )
        # the filter's state runs on from block to block
        filter_sections(self._band, shaken, self._state)
        samples = shaken.reshape(*shaken.shape[:2], self.size, self.stride)
        actual = position[:: self.stride], quaternion[:: self.stride]
        both = np.stack([np.concatenate(actual, axis=-1), reference]).swapaxes(1, 2)
        poses = np.concatenate([both[..., :3], to_rpy(both[..., 3:])], axis=-1)
        return poses, np.mean(samples**2, axis=-1)


@compiled
def _add_motion(
    position: Array,
    rest: Array,
    quaternion: Array,
    lever: float,
    before: Array,
    turned: Array,
    moved: Array,
) -> None:
    """Write position from rest, and lever times the turns so far, into ``moved`` (N, 6, K) [m].

    Positions (K, N, 3) [m] and quaternions (K, N, 4) are those of K control steps. Turns (angle ·
    axis in the base frame) of single control steps are small, so their sum ``turned`` (N, 3) [rad],
    changed, is smooth wherever the path turns; ``before`` (N, 4) is the last orientation, changed.
    """
    for s in range(position.shape[0]):
        for i in range(position.shape[1]):
            w, x, y, z = quaternion[s, i]
            a, b, c, d = before[i]
            # quaternion ⊗ before⁻¹
            cosine = w * a + x * b + y * c + z * d
            side = 2.0 if cosine >= 0.0 else -2.0
            turn = (
                a * x - w * b + z * c - y * d,
                a * y - w * c + x * d - z * b,
                a * z - w * d + y * b - x * c,
            )
            sine = np.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
            if sine > 0.0:
                side *= np.arctan2(sine, abs(cosine)) / sine
            for k in range(3):
                turned[i, k] += side * turn[k]
                moved[i, k, s] = position[s, i, k] - rest[i, k]
                moved[i, 3 + k, s] = lever * turned[i, k]
            for k in range(4):
                before[i, k] = quaternion[s, i, k]


class RunLog(Sampler):
    """All samples of a rig's arms, with what dither and controller did to the joints."""

    def __init__(self, rig: GTERig, protocol: GTEProtocol, steps: int) -> None:
        """Log blocks of ``steps`` control steps; the arms have just begun to follow."""
        super().__init__(rig, protocol, steps, detailed=True)
        self._protocol, self._sequencer = protocol, rig.sequencer
        self._blocks: defaultdict[str, list[NDArray[np.generic]]] = defaultdict(list)

    @property
    def time(self) -> float:
        """Simulated since the first goal [s]."""
        return len(self._blocks["actual"]) * self.size / self._protocol.sample_rate

    def advance(self) -> tuple[Array, Array]:
        """Let all arms follow for one block, and keep its samples."""
        details = self.recorded.power, self.recorded.rate, self.recorded.flags
        for array in details:
            array[:] = 0
        poses, mean_square = super().advance()
        power, rate, flags = (array.swapaxes(0, 1).copy() for array in details)
        new = {
            "actual": poses[0],
            "reference": poses[1],
            "mean_square": mean_square.transpose(0, 2, 1),
            "power": power / self.stride,
            "rate": rate,
            "flags": flags,
        }
        for name, values in new.items():
            self._blocks[name].append(values)
        return poses, mean_square

    @property
    def end(self) -> Array:
        """(N,) when a simulation's record may end, ∞ where that is not known yet [s]."""
        last = np.fmax.reduce(self._sequencer.arrays.reached, axis=1, initial=0.0)
        return np.where(self._sequencer.finished, last + self._protocol.tail, np.inf)

    def run(self, case: Case, mine: Bools, goals: int) -> Run:
        """Return the run of simulations ``mine``: cut at its own end, whatever else was run."""
        rate, times = self._protocol.sample_rate, self._sequencer.arrays
        count = int(np.ceil(float(self.end[mine].max()) * rate - 1e-6))

        def samples(name: str) -> NDArray[Any]:
            return np.concatenate([x[mine] for x in self._blocks[name]], axis=1)[:, :count]

        flags = np.any(samples("flags"), axis=1)
        return Run(
            case=case,
            time=np.arange(count) / rate,
            reference=samples("reference"),
            actual=samples("actual"),
            accepted=times.accepted[mine, :goals],
            reached=times.reached[mine, :goals],
            mean_square=samples("mean_square"),
            dither_power=samples("power"),
            torque_rate=samples("rate").max(axis=1),
            flags={name: flags[:, k] for k, name in enumerate(FLAGS)},
        )


class Recorder(Accumulator):
    """Advances a rig by environment steps and adds up what each of its N arms does."""

    def __init__(self, rig: GTERig, protocol: GTEProtocol, *, steps: int, capacity: int) -> None:
        """Prepare for environment steps of ``steps`` control steps, a multiple of a sample's.

        Paths have at most ``capacity`` goals.
        """
        super().__init__(
            rig.nsim,
            capacity,
            rate=protocol.sample_rate,
            window=protocol.window,
            tail=protocol.tail,
        )
        self._rig, self._sampler = rig, Sampler(rig, protocol, steps)
        self.step_vibration = np.zeros(rig.nsim)
        """(N,) root mean square of the vibration in the last step [m]."""
        self.step_left = np.zeros((rig.nsim, capacity, 2))
        """(N, G, 2) error left at the goals whose time was over in the last step, else 0 [m,
        rad]."""

    def start(self, ids: Index, goals: Index) -> None:
        """Restart arms ``ids``, which have just begun to follow ``goals`` (M,) goals."""
        super().start(ids, goals)
        self._sampler.start(ids)
        self.step_vibration[ids] = self.step_left[ids] = 0.0

    def advance(self) -> None:
        """Let all arms follow for one environment step."""
        poses, mean_square = self._sampler.advance()
        goals, before = self._rig.sequencer.arrays, np.isfinite(self.settling[..., 0])
        self.feed(pose_error(*poses), mean_square, goals.accepted, goals.reached)
        new = np.isfinite(self.settling[..., 0]) & ~before
        self.step_left[:] = 0.0
        if new.any():
            self.step_left[new] = self.left[new]
        self.step_vibration = np.sqrt(mean_square.mean(axis=-1).sum(axis=-1))
