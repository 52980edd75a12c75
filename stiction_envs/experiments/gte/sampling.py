"""What the arms of a rig do, sample by sample: poses, references, vibration of the flange."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.control.rotation import to_rpy
from stiction_envs.experiments.gte.highpass import butterworth_highpass, filter_sections
from stiction_envs.experiments.gte.protocol import GTEProtocol, pose_error
from stiction_envs.experiments.gte.rig import GTERig
from stiction_envs.plant import CONTROL_DT

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """S samples of N arms, one after the other; fresh arrays."""

    actual: Array
    """(N, S, 6) pose of the flange at the first control step of each sample: x, y, z [m], roll,
    pitch, yaw [rad]."""
    error: Array
    """(N, S, 6) that pose less the reference's, angles in (−π, π] [m, rad]."""
    reference: Array
    """(N, S, 6) pose of the reference then."""
    mean_square: Array
    """(N, 3, S) mean square, over the control steps of each sample, of the flange's position above
    the protocol's `vibration_low` [m²]."""


class Sampler:
    """Lets a rig follow for a block of samples at a time, and says what its arms did."""

    def __init__(self, rig: GTERig, protocol: GTEProtocol, steps: int) -> None:
        """Prepare for blocks of ``steps`` control steps, a multiple of those of a sample.

        All arms have just begun to follow; `start` says so of some.
        """
        self._rig, nsim = rig, rig.nsim
        self.stride = round(1.0 / (protocol.sample_rate * CONTROL_DT))
        """Control steps of a sample."""
        self.size = steps // self.stride
        """Samples S of a block."""
        self._band = butterworth_highpass(protocol.vibration_low, 1.0 / CONTROL_DT)
        self._state = np.zeros((len(self._band), nsim, 3, 2))
        self._rest = np.zeros((nsim, 3))
        self._moved = np.zeros((steps, nsim, 3))
        self._poses = np.zeros((2, nsim, self.size, 7))
        self._tick = 0
        self.start(np.arange(nsim))

    def start(self, ids: Index) -> None:
        """Begin anew with arms ``ids``: they have rested where they are, the filter is settled."""
        self._rest[ids] = self._rig.flange.position[ids]
        self._state[:, ids] = 0.0

    def advance(self) -> Samples:
        """Let all arms follow for one block."""
        self._tick = 0
        self._rig.advance(len(self._moved), self._watch)
        shaken = np.ascontiguousarray(self._moved.transpose(1, 2, 0))
        # the filter's state runs on from block to block
        filter_sections(self._band, shaken, self._state)
        shaken = shaken.reshape(*shaken.shape[:2], self.size, self.stride)
        poses = np.concatenate([self._poses[..., :3], to_rpy(self._poses[..., 3:])], axis=-1)
        return Samples(
            actual=poses[0],
            error=pose_error(poses[0], poses[1]),
            reference=poses[1],
            mean_square=np.mean(shaken**2, axis=-1),
        )

    def _watch(self) -> None:
        """One control step, before the arms move."""
        rig, k = self._rig, self._tick
        np.subtract(rig.flange.position, self._rest, out=self._moved[k])
        if k % self.stride == 0:
            actual, reference = self._poses[:, :, k // self.stride]
            actual[:, :3], actual[:, 3:] = rig.flange.position, rig.flange.quaternion
            reference[:, :3], reference[:, 3:] = rig.controller.reference
        self._tick = k + 1
