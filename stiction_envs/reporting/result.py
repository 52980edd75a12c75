"""Base class of the library's results: short to print; `save` writes what the command writes."""

import abc
import os
from collections.abc import Mapping
from pathlib import Path

from stiction_envs.reporting.output_folder import OutputFolder
from stiction_envs.reporting.provenance import Provenance


class Result(abc.ABC):
    """A result that can be saved."""

    provenance: Provenance
    """Versions, commit, seed, arguments and hashes of inputs that made it."""

    @abc.abstractmethod
    def write(self, folder: Path) -> None:
        """Write the files to an existing folder; `save` makes one."""

    @abc.abstractmethod
    def to_json(self) -> Mapping[str, object]:
        """Return the JSON that the command prints with ``--json``."""

    def save(
        self, folder: str | os.PathLike[str], *, force: bool = False, **options: object
    ) -> Path:
        """Write the files of the result's command and ``provenance.json``; return the folder.

        The folder is made where it is missing; ``force`` replaces the files of another run in it;
        ``options`` are those of `write`.

        Raises:
            StictionError: the folder holds files, or cannot be one; nothing was written.
        """
        with OutputFolder(Path(folder), self.provenance, force=force) as out:
            self.write(out.path, **options)
        return out.path
