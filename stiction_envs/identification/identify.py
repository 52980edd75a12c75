"""Dynamics identification from joint logs: base parameters with errors, and consistent links.

    from stiction_envs.identification.identify import identify

    found = identify("log.csv", "panda", torque="link")
    print(found)
    found.save("runs/links")
    arm = found.arm()          # for `SingleJointExperiment`, `friction.model.build`, …

Torques determine only sums of link parameters, the base parameters. QR with pivoting of pinocchio's
regressor finds them (`robots.regressor`), together with Coulomb, viscous and constant torque.
Unconstrained least squares does not determine single links: filled up to ten parameters per link it
gives negative masses (Table 4.1 of the thesis). So a second fit, that of a diagnosis without named
causes (`fits`), keeps links near the nominal ones and physically consistent.
"""

import dataclasses
import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError
from stiction_envs.friction.from_file import friction_note
from stiction_envs.friction.sticking import Robot, arm_of
from stiction_envs.gap.signals.dataset import assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.gap.signals.torque_sign import correct_sign
from stiction_envs.identification import fits
from stiction_envs.measured.logs.joint_names import Reading, naming_of
from stiction_envs.measured.logs.reader import JointLog, read_logs
from stiction_envs.measured.logs.sources import log_sources, torque_side
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.json_text import write_json
from stiction_envs.reporting.markdown import aligned, sentence, table_text
from stiction_envs.reporting.provenance import Provenance, provenance
from stiction_envs.reporting.result import Result
from stiction_envs.reporting.templates import write_md_and_html
from stiction_envs.robots import Arm
from stiction_envs.robots.inertias import with_inertias
from stiction_envs.robots.regressor import (
    PARAMETERS,
    BaseSet,
    pseudo_inertia,
    structural_base,
)
from stiction_envs.robots.stated import WITHOUT_FRICTION

TEMPLATE = Path(__file__).parent / "templates" / "report.md.j2"
MOST_SAMPLES = 20_000
"""Samples of all logs together; assumed. Longer logs are thinned out after the filter."""
POOR = 0.02
"""Largest error of torque over the torque limit of a well excited parameter [-]; assumed."""
MODELS = ("nominal", "nominal + friction", "base parameters", "consistent")
"""Models whose held-out residual is reported: the nominal arm; the same with fitted friction, which
is common practice; unconstrained base parameters and friction; consistent links and friction."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Identification(Result):
    """The result; arrays are float64."""

    nominal: Arm
    """Arm that the logs were compared with."""
    base: BaseSet
    """Which sums of parameters the torques show, friction among them."""
    values: Array
    """(r,) base parameters, unconstrained."""
    errors: Array
    """(r,) standard errors, for noise that neighbouring rows share."""
    nominal_values: Array
    """(r,) of the nominal arm without friction."""
    condition: float
    """Condition number of the weighted regressor with columns of unit length."""
    phi: Array
    """(n, 10) parameters of physically consistent links, about their joints."""
    coulomb: Array
    """(n,) of the same fit [N·m]."""
    viscous: Array
    """(n,) [N·m·s/rad]."""
    offset: Array
    """(n,) [N·m]."""
    rotor: Array | None
    """(n,) [kg·m²]; None where torque was measured behind the gear. Where the logs do not show one,
    it is that of the robot's file."""
    rms: dict[str, Array]
    """Held-out residual of each of `MODELS`, (n,) [N·m]."""
    noise: Array
    """(n,) noise floor of the torque, as of a diagnosis [N·m]."""
    unsure: tuple[int, ...]
    """Base parameters (from 0) that the logs hardly excite: their error changes torques over the
    range by more than `POOR`, or a joint does not move as its friction needs. The links follow the
    nominal there."""
    provenance: Provenance
    notes: tuple[str, ...] = ()
    """How the robot's file was read and the signals were made, and whether the torques had the
    opposite sign."""

    @property
    def names(self) -> tuple[str, ...]:
        """The base parameters in words."""
        return self.base.expressions()

    @property
    def on_bound(self) -> tuple[str, ...]:
        """Friction of the consistent fit that is on its bound of zero, where the logs excite it."""
        kinds = {"Fc": self.coulomb, "Fv": self.viscous}
        if self.rotor is not None:
            kinds["rotor"] = self.rotor
        zero = [f"{k}{j + 1}" for k, v in kinds.items() for j in np.flatnonzero(v == 0)]
        unsure = {self.names[i] for i in self.unsure}
        return tuple(x for x in zero if x not in unsure)

    @property
    def gain_percent(self) -> float:
        """Gain of the consistent fit over the nominal with friction, held out, mean of joints."""
        ratio = self.rms["consistent"] / self.rms["nominal + friction"]
        return float(100 * (1 - ratio.mean()))

    def arm(self) -> Arm:
        """Return the arm with the identified links; its file states rotors and friction, too."""
        arm = with_inertias(self.nominal, self.phi)
        none = np.zeros(arm.n)
        stated = dataclasses.replace(
            arm.stated,
            armature=arm.stated.armature if self.rotor is None else self.rotor,
            stiction=self.coulomb,
            coulomb=self.coulomb,
            stribeck=none,
            bristle=none,
            damping=self.viscous,
        )
        return dataclasses.replace(arm, stated=stated)

    def to_json(self) -> dict[str, object]:
        """Return JSON values."""
        least = np.linalg.eigvalsh(pseudo_inertia(self.phi))[:, 0]
        friction = {"coulomb_nm": self.coulomb, "viscous_nms": self.viscous}
        friction |= {"offset_nm": self.offset}
        if self.rotor is not None:
            friction["rotor_kgm2"] = self.rotor
        return {
            "robot": self.nominal.name,
            "condition": self.condition,
            "base": [
                {"parameter": name, "value": v, "standard_error": e, "nominal": x}
                for name, v, e, x in self._base_rows()
            ],
            "links": [
                dict(zip(PARAMETERS, row, strict=True)) | {"least_eigenvalue": float(e)}
                for row, e in zip(self.phi.tolist(), least, strict=True)
            ],
            "friction": {k: v.tolist() for k, v in friction.items()},
            "held_out_rms_nm": {k: v.tolist() for k, v in self.rms.items()},
            "noise_nm": self.noise.tolist(),
            "gain_percent": self.gain_percent,
            "hardly_excited": [self.names[i] for i in self.unsure],
            "on_bound": list(self.on_bound),
            "notes": list(self.notes),
        }

    def _base_rows(self) -> list[tuple[str, float, float, float]]:
        """Return name, value, standard error and nominal value of the base parameters."""
        numbers = (x.tolist() for x in (self.values, self.errors, self.nominal_values))
        return list(zip(self.names, *numbers, strict=True))

    def write(self, folder: Path) -> None:
        """Write ``identification.json``, ``report.md``, ``report.html``, ``model.xml``, a plot."""
        from stiction_envs.identification.plots import plot_identification

        name = self.nominal.name
        write_json(folder / "identification.json", self.to_json())
        write_text_atomic(folder / "model.xml", self.arm().carrying_xml())
        plot_identification(name, self.rms, self.noise, folder / "residual.png")
        excited = (
            f"{len(self.unsure)} of {len(self.names)} base parameters are hardly excited by these "
            "logs"
            if self.unsure
            else f"these logs excite all {len(self.names)} base parameters"
        )
        write_md_and_html(
            folder,
            TEMPLATE,
            f"{name}: links and friction from logs",
            note=friction_note(self.nominal, None),
            robot=name,
            gain=self.gain_percent,
            excited=excited,
            page=self.page(),
        )

    def __repr__(self) -> str:
        text = f"{len(self.values)} base parameters, {self.gain_percent:.1f} % below the nominal"
        return f"<Identification of {self.nominal.name}: {text}>"

    def __str__(self) -> str:
        header = ["held-out residual [N·m], joint", *map(str, range(1, self.nominal.n + 1))]
        rows = {**self.rms, "noise": self.noise}
        lines = [aligned(header, [[k, *(f"{x:.3g}" for x in v)] for k, v in rows.items()])]
        gain = f"{self.gain_percent:.1f} % below the nominal arm with friction"
        lines.append(f"physically consistent links: {gain}")
        if self.unsure:
            lines.append(
                f"hardly excited by these logs: {len(self.unsure)} of {len(self.names)} base "
                "parameters"
            )
        return "\n".join(lines)

    def page(self) -> str:
        """Return tables in Markdown: held-out residual by joint, links, base parameters."""
        n = self.nominal.n
        joints = [str(j) for j in range(1, n + 1)]
        errors = [[name, *(f"{x:.3g}" for x in rms)] for name, rms in self.rms.items()]
        links = []
        for j, p in enumerate(self.phi):
            com = ", ".join(f"{x:.3f}" for x in p[1:4] / p[0])
            friction = (self.coulomb[j], self.viscous[j], self.offset[j])
            links.append([str(j + 1), f"{p[0]:.3g}", com, *(f"{x:.3g}" for x in friction)])
        header = ["link", "mass [kg]", "centre of mass [m]"]
        friction_of_joint = ["Coulomb [N·m]", "viscous [N·m·s/rad]", "offset [N·m]"]
        base = ["base parameter [kg, kg·m, kg·m²]", "value", "standard error", "nominal"]
        rows = [[name, f"{v:.4g}", f"{e:.2g}", f"{x:.4g}"] for name, v, e, x in self._base_rows()]
        lines = [
            table_text(["held-out residual [N·m], joint", *joints], errors),
            table_text([*header, *friction_of_joint], links),
            table_text(base, rows),
        ]
        if self.unsure:
            which = "; ".join(self.names[i] for i in self.unsure)
            lines += [f"Hardly excited by these logs: {which}.", ""]
        if self.on_bound:
            lines += [f"On its bound of zero: {', '.join(self.on_bound)}.", ""]
        lines += [f"{sentence(note)}\n" for note in self.notes]
        return "\n".join(lines).rstrip("\n") + "\n"


def identify(
    logs: str | Path | JointLog | Sequence[str | Path | JointLog],
    robot: Robot,
    *,
    torque: str | None = None,
    cutoff_hz: float | None = None,
    progress: Callable[[str, float], None] | None = None,
    **reading: Unpack[Reading],
) -> Identification:
    """Identify an arm's links and friction from measured joint logs.

    Args:
        logs: a file or several, or logs that were read.
        robot: name, model file or arm; its links are the nominal ones.
        torque: side of the gear on which torque was measured, "motor" or "link"; behind the gear
            (link) it does not show rotors. None: as the logs say, else motor.
        cutoff_hz: bandwidth of the zero-phase filter; None chooses it from the data.
        progress: called with a stage and its part done.
        reading: ``joints``, ``topic``, ``units``, ``calibration``, ``columns``; see
            `measured.logs.joint_names.Naming`.

    Raises:
        StictionError: logs that cannot be read, do not fit the robot, or
            are too short.
    """
    say = progress or (lambda *_: None)
    arm = arm_of(robot)
    torque_side(torque, ())  # an unknown side is an error before any log is read
    given = [logs] if isinstance(logs, str | Path | JointLog) else list(logs)
    if not given:
        raise StictionError("no logs: expected one or more")
    sources = log_sources(given)
    naming = naming_of(arm, reading)
    read: list[JointLog] = []
    for log in given:
        read += read_logs([log], arm.n, limits=arm.limits, naming=naming)
        say("reading", len(read) / len(given))
    side = torque_side(torque, read)
    made = provenance(
        "identify",
        {
            "robot": arm.name,
            "arm_sha256": hashlib.sha256(arm.xml.encode()).hexdigest(),
            "torque": side,
            **naming.record,
            "cutoff": cutoff_hz,
            "logs": sources.in_memory,
        },
        seed=0,
        inputs=sources.files | naming.files,
    )
    signals = prepare(read, cutoff_hz=cutoff_hz, most_samples=MOST_SAMPLES)
    turned, signals = correct_sign(read, signals, arm)
    data = assemble(arm, signals, torque=side)
    base, unit_torque = structural_base(arm, fits.kinds_of(side))
    # neighbours within half a period of the filter depend on each other
    independent = np.nanmin([1.0, 2 * data.recording.cutoff * data.dt])
    seen = int(data.n * np.count_nonzero(data.block >= 0) * independent)
    if seen < 2 * base.size:
        raise StictionError(
            f"{seen} independent torques after the filter for {base.size} parameters: expected "
            f"{2 * base.size} or more; record for longer"
        )
    predictor = fits.fit_predictor(data)
    terms, stacked = fits.terms_of(predictor), fits.all_columns(predictor)
    to_fit = fits.torque_to_fit(predictor.data)
    found = fits.fit_base(predictor, stacked[:, :, base.kept], to_fit)
    say("fitting", 0.2)
    consistent = fits.parameters(predictor, terms)
    say("held-out", 0.5)
    nominal = fits.parameters(predictor, [])
    free = np.zeros_like(nominal)
    free[:, base.kept] = found.values
    models = (nominal, fits.parameters(predictor, predictor.candidates), free, consistent)
    hidden = np.isin(np.array(base.names)[base.kept], fits.not_shown(predictor))
    links, friction = np.split(consistent[0], [10 * data.n])
    *rotor, coulomb, viscous, offset = friction.reshape(-1, data.n)
    # torques are turned in all logs or none
    sign = [c.text for log in turned[:1] for c in log.corrections if c.kind == "sign"]
    source = [c.text for log in turned for c in log.corrections if c.kind == "source"]
    return Identification(
        nominal=arm,
        base=base,
        values=found.values[0],
        errors=found.errors,
        nominal_values=base.values(nominal[0]),
        condition=found.condition,
        phi=links.reshape(-1, 10),
        coulomb=coulomb,
        viscous=viscous,
        offset=offset,
        rotor=rotor[0] if rotor else None,
        rms={
            k: fits.held_out(predictor, stacked, x, to_fit)
            for k, x in zip(MODELS, models, strict=True)
        },
        noise=np.array(predictor.data.noise),
        provenance=made,
        unsure=tuple(np.flatnonzero((found.errors * unit_torque > POOR) | hidden).tolist()),
        notes=(*arm.notes(WITHOUT_FRICTION), *signals.notes, *source, *sign),
    )
