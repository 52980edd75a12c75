"""PyTorch files, as PACE writes its data: refused. To open one may run code that is in it."""

from __future__ import annotations

from typing import ClassVar, NoReturn

from stiction_envs.errors import StictionError
from stiction_envs.measured.logs.formats.base import LogFormat, RawLog, Wanted
from stiction_envs.measured.logs.joint_names import Naming


class PyTorchFile(LogFormat):
    """A pickle, which is not opened; the message says how its owner converts it.

    Keys of PACE. Source: leggedrobotics/pace-sim2real, scripts/pace/data_collection.py.
    """

    ends: ClassVar = (".pt", ".pth")
    is_read: ClassVar = False

    def read(self, where: str, wanted: Wanted) -> RawLog:
        """Refuse it."""
        _refuse(where)

    def count(self, where: str, naming: Naming) -> int:
        """Refuse it."""
        _refuse(where)

    def drives(self, where: str, naming: Naming) -> tuple[str, ...]:
        """Refuse it."""
        _refuse(where)


def _refuse(where: str) -> NoReturn:
    raise StictionError(
        f"{where}: a pickle, which can run code: expected .npz; of PACE's make it with d = torch."
        "load(FILE, weights_only=True); numpy.savez('log.npz', t=d['time'], q=d['dof_pos'], "
        "q_cmd=d['des_dof_pos'])"
    )
