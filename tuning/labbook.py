"""The lab book of `reproduce`: a line per finished measurement, so that none is made twice.

JSON lines, appended and flushed one by one. The first line says which experiment this is; a torn
last line (the power went out) is dropped. Floats are written so that they read back exactly.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job, Measurement
from stiction_envs.reporting.atomic import naming
from tuning.measurements import as_data, from_data


class LabBook:
    """Measurements of one experiment by (series, job); reads what is there, appends what is new."""

    def __init__(self, path: Path, fingerprint: dict[str, Any]) -> None:
        """Open or start the book.

        Args:
            path: the file.
            fingerprint: what defines the experiment; another one's book is not continued.

        Raises:
            StictionError: the book is of another experiment.
        """
        self.path = path
        self._pages: dict[tuple[str, Job], Measurement] = {}
        text = json.dumps(fingerprint, sort_keys=True)
        self.fingerprint = hashlib.sha256(text.encode()).hexdigest()
        if path.exists():
            self._read()
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._append({"fingerprint": self.fingerprint})

    def _read(self) -> None:
        data = self.path.read_bytes()
        end = data.rfind(b"\n") + 1
        if end != len(data):  # cut the torn line off, or the next one would be glued to it
            with self.path.open("r+b") as file:
                file.truncate(end)
        lines = data[:end].decode().splitlines()
        if not lines:
            self._append({"fingerprint": self.fingerprint})
            return
        if json.loads(lines[0]).get("fingerprint") != self.fingerprint:
            raise StictionError(
                f"{self.path.parent} holds another run (other robot, table, options or version): "
                "choose another --out, or --force"
            )
        for line in lines[1:]:
            self._page(json.loads(line))

    def _page(self, entry: dict[str, Any]) -> None:
        job = Job(Configuration(*entry["configuration"]), **entry["dither"])
        self._pages[entry["series"], job] = from_data(job, entry)

    def _append(self, entry: dict[str, Any]) -> None:
        with naming(self.path), self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(entry) + "\n")
            file.flush()
            os.fsync(file.fileno())

    def write(self, series: str, m: Measurement) -> None:
        """Add a measurement; its traces are thinned, for plots only."""
        c, job = m.job.configuration, m.job
        dither = {
            "frequency_hz": job.frequency_hz,
            "amplitude_nm": job.amplitude_nm,
            "waveform": job.waveform,
            "offset_nm": job.offset_nm,
            "gate_velocity": job.gate_velocity,
        }
        entry = {
            "series": series,
            "configuration": [c.joint, c.load, c.direction],
            "dither": dither,
            **as_data(m),
        }
        self._append(entry)
        # what a resumed run would read, so that both give the same report
        self._page(entry)

    def get(self, series: str, job: Job) -> Measurement | None:
        """Return a measurement, None if it was not made."""
        return self._pages.get((series, job))

    def measure(
        self,
        series: str,
        experiment: SingleJointExperiment,
        jobs: Sequence[Job],
        *,
        iterations: int | None,
        progress: Callable[[float], None] | None = None,
    ) -> dict[Job, Measurement]:
        """Return all ``jobs`` of a series, measuring those that are not in the book."""
        missing = [j for j in dict.fromkeys(jobs) if (series, j) not in self._pages]
        for m in experiment.run(missing, iterations=iterations, progress=progress):
            self.write(series, m)
        return {j: self._pages[series, j] for j in jobs}
