"""Results of a conformance test: numbers, table and file."""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.measured.csv_text import write_rows
from stiction_envs.reporting.markdown import aligned
from stiction_envs.reporting.provenance import Provenance
from stiction_envs.reporting.result import Result

_BREAKAWAY = "breakaway_nm_at_"  # how the column of a ramp rate begins


@dataclass(frozen=True, kw_only=True)
class ConformanceSettings:
    """Numbers of the test whether a simulated joint sticks; all assumed."""

    under: float = 0.9  # Load over stiction under which the joint must hold [-]
    over: float = 1.1  # Load over stiction under which it must move [-]
    hold_time: float = 60.0  # Length of a hold [s]
    watched_time: float = 30.0  # End of a hold in which the joint may not move [s]
    rise_time: float = 10.0  # Time in which the load of a hold rises [s]
    go_time: float = 20.0  # Longest time until the joint moves under the larger load [s]
    go_rise_time: float = 1.0  # Time in which that load rises [s]
    still: float = 1e-6  # Largest motion of a joint that holds [rad]; 1e-5 in an engine of float32
    gone: float = 0.1  # Least motion of a joint that moves away [rad]
    ramp_rates: tuple[float, ...] = (0.02, 0.07, 0.2, 1.0)  # Of breakaway torques [N·m/s]

    def __post_init__(self) -> None:
        if self.over <= 1 or self.watched_time >= self.hold_time:
            raise StictionError(
                f"ConformanceSettings: over is {self.over:g}, watched_time {self.watched_time:g} s "
                f"of {self.hold_time:g} s: expected more than 1, and less than hold_time"
            )


@dataclass(frozen=True, kw_only=True)
class JointResult:
    """Test of one joint, in the direction in which it sticks worse."""

    name: str  # Joint name
    stiction: float  # F_s the joint was tested against [N·m]
    presliding: float
    """Deflection that LuGre gives at a slow rise: −ln(1 − ``under``) F_s/σ0 [rad]; NaN where the
    joint has no bristle."""
    deflection: float  # Motion at the end of the hold, from its start [rad]
    still: float  # Largest excursion over the last seconds of the hold [rad]
    creep: float  # Speed over that time [rad/s]
    go_time: float  # Time in which the overloaded joint moved 0.1 rad [s]; NaN if it did not
    breakaway: tuple[float, ...]  # Torque per ramp rate, + direction [N·m]; NaN if stuck
    holds: bool  # Whether it held under the smaller load

    @property
    def goes(self) -> bool:
        """True if the joint moved under the larger load."""
        return bool(np.isfinite(self.go_time))

    @property
    def passed(self) -> bool:
        """True if the joint both holds and goes."""
        return self.holds and self.goes


@dataclass(frozen=True, kw_only=True, repr=False)
class Report(Result):
    """Results of all joints that carry friction."""

    joints: tuple[JointResult, ...]
    rates: tuple[float, ...]  # Ramp rates of the breakaway torques [N·m/s]
    settings: ConformanceSettings  # Numbers of the test
    engine: str = ""  # Name and version of another engine than stock MuJoCo
    refused: str = ""  # The engine's line if it does not take the model
    provenance: Provenance = field(compare=False)

    @property
    def passed(self) -> bool:
        """True if every joint sticks."""
        return all(j.passed for j in self.joints)

    def to_json(self) -> dict[str, Any]:
        """Return the rows of ``conformance.csv``, and what the joints were tested by."""
        return {
            "passed": self.passed,
            "settings": asdict(self.settings),
            **({"engine": self.engine, "refused": self.refused} if self.engine else {}),
            "rows": [self._row(j) for j in self.joints],
        }

    def _row(self, j: JointResult) -> dict[str, object]:
        row: dict[str, object] = {
            "joint": j.name,
            "stiction_nm": j.stiction,
            "holds": j.holds,
            "goes": j.goes,
            "deflection_rad": j.deflection,
            "presliding_rad": j.presliding,
            "motion_rad": j.still,
            "creep_rad_s": j.creep,
            "go_time_s": j.go_time,
        }
        row |= {f"{_BREAKAWAY}{r:g}_nm_s": b for r, b in zip(self.rates, j.breakaway, strict=True)}
        if self.engine:
            row |= {"engine": self.engine, "refused": self.refused}
        return row

    def write(self, folder: Path) -> None:
        """Write ``conformance.csv``: a joint in a row, what it did under both loads."""
        rows = [
            {k: ("no", "yes")[x] if isinstance(x, bool) else x for k, x in row.items()}
            for row in self.to_json()["rows"]
        ]
        write_rows(folder / "conformance.csv", rows)

    def __repr__(self) -> str:
        n = sum(j.passed for j in self.joints)
        return f"<conformance Report: {n} of {len(self.joints)} joints stick>"

    def __str__(self) -> str:
        if self.refused:
            return f"{self.engine} refused: {self.refused}"
        s = self.settings
        body = [
            [
                j.name,
                f"{j.stiction:.4f}",
                f"{1e3 * j.deflection:.3f}",
                f"{j.still:.1e}",
                f"{j.go_time:.2f}" if j.goes else "stuck",
                "yes" if j.passed else "NO",
            ]
            for j in self.joints
        ]
        n = sum(j.passed for j in self.joints)
        inside = f" in {self.engine}" if self.engine else ""
        head = ["joint", "F_s [N·m]", "deflection [mrad]", "motion [rad]", "go [s]", "sticks"]
        return (
            f"{aligned(head, body)}\n"
            f"{n} of {len(self.joints)} joints stick{inside}: under {s.under:.0%} of F_s they move "
            f"less than {s.still:g} rad in the last {s.watched_time:g} s of {s.hold_time:g} s, "
            f"under {s.over:.0%} more than {s.gone:g} rad in {s.go_time:g} s."
        )
