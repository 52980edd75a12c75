"""FIGAROH as its documentation says: a subclass that loads data, a configuration, `solve`.

Thanh Nguyen et al., "FIGAROH: a Python toolbox for dynamic identification and geometric calibration
of robots and humans", Humanoids 2023; pip install figaroh.
"""

import logging
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from stiction_envs.robots import Arm

Array = np.ndarray
EDGE = 10
"""Samples on either side of a seam between two stretches that are not fitted; assumed."""


def urdf_of(arm: Arm) -> str:
    """Return an arm as a URDF: FIGAROH reads nothing else."""
    model = arm.pinocchio()
    work = model.createData()
    pin.computeJointJacobians(model, work, np.zeros(model.nq))
    text = ['<robot name="arm"><link name="link0"/>']
    for j in range(1, model.njoints):
        body, place = model.inertias[j], model.jointPlacements[j]
        xyz = " ".join(f"{x:.12g}" for x in place.translation)
        rpy = " ".join(f"{x:.12g}" for x in pin.rpy.matrixToRpy(place.rotation))
        com = " ".join(f"{x:.12g}" for x in body.lever)
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = body.inertia
        turns = pin.getJointJacobian(model, work, j, pin.ReferenceFrame.LOCAL)[3:, j - 1]
        axis = " ".join(f"{x:.12g}" for x in turns)
        text.append(
            f'<link name="link{j}"><inertial><origin xyz="{com}"/><mass value="{body.mass:.12g}"/>'
            f'<inertia ixx="{xx:.12g}" ixy="{xy:.12g}" ixz="{xz:.12g}" iyy="{yy:.12g}" '
            f'iyz="{yz:.12g}" izz="{zz:.12g}"/></inertial></link>'
            f'<joint name="joint{j}" type="revolute"><parent link="link{j - 1}"/>'
            f'<child link="link{j}"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
            '<limit lower="-6.3" upper="6.3" velocity="10" effort="500"/></joint>'
        )
    return "\n".join([*text, "</robot>"])


def _config(n: int, rate: float) -> str:
    names = "[" + ", ".join(f'"joint{j}"' for j in range(1, n + 1)) + "]"
    return f"""
robot:
  name: "arm"
  properties:
    joints:
      active_joints: {names}
    mechanics:
      reduction_ratios: {[1.0] * n}
      actuator_inertias: {[0.0] * n}
      joint_offsets: {[0.0] * n}
      friction_coefficients: {{viscous: {[0.0] * n}, static: {[0.0] * n}}}
tasks:
  identification:
    enabled: true
    problem:
      use_joint_torques: true
      include_external_forces: false
      qr_relative_tolerance: 1.0e-4
      model_components:
        friction: true
        actuator_inertia: true
        joint_offset: true
    signal_processing:
      sampling_frequency: {rate}
      cutoff_frequency: {0.4 * rate}
      filter_type: "butterworth"
      filter_order: 4
    data:
      validation_data_file: ""
"""


class Figaroh:
    """A model that FIGAROH identified, and what it says of it."""

    def __init__(self, arm: Arm, signals: list[Any], dt: float) -> None:
        """Identify from stretches of signals (q, dq, ddq, tau, each (K, n)) on even times."""
        from figaroh.data.trajectory import TrajectoryData
        from figaroh.identification.base_identification import BaseIdentification
        from figaroh.tools.load_robot import load_robot

        logging.getLogger("figaroh").setLevel(logging.ERROR)
        q, dq, ddq, tau = (
            np.concatenate([getattr(s, k) for s in signals]) for k in ("q", "dq", "ddq", "tau")
        )
        inner = np.concatenate([_inner(len(s.q)) for s in signals])

        class Identification(BaseIdentification):
            def load_trajectory_data(self, data_source: Any = None) -> Any:
                return TrajectoryData(
                    t=np.arange(len(q)) * dt,
                    joint_names=tuple(f"joint{j}" for j in range(1, q.shape[1] + 1)),
                    q=q,
                    dq=dq,
                    ddq=ddq,
                    effort=tau,
                    effort_kind="joint_torque",
                    effort_unit="N·m",
                    mask=inner,
                )

        with tempfile.TemporaryDirectory() as folder:
            urdf, config = Path(folder) / "arm.urdf", Path(folder) / "arm.yaml"
            urdf.write_text(urdf_of(arm))
            config.write_text(_config(q.shape[1], 1 / dt))
            robot = load_robot(str(urdf), load_by_urdf=True)
            self.found = Identification(robot, str(config))
            own = self.found.identif_config
            own["act_idxq"] = own["act_idxv"] = list(range(q.shape[1]))
            own["active_joints"] = [f"joint{j}" for j in range(1, q.shape[1] + 1)]
            self.found.initialize()
            self.found.solve(decimate=False, plotting=False, wls=True)

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return (T, n) torque of what it identified [N·m]."""
        from figaroh.tools.regressor import build_regressor_basic, build_regressor_reduced

        f = self.found
        whole = build_regressor_basic(f.robot, q, dq, ddq, f.identif_config)
        chosen = getattr(f, "selected", None)
        if chosen is not None and chosen.accepted:
            out = chosen.predict(whole)
        else:
            out = build_regressor_reduced(whole, f._idx_eliminated)[:, f._base_indices] @ f.phi_base
        return np.asarray(out).reshape(q.shape[1], -1).T

    def says(self) -> dict[str, str]:
        """Return what it says of causes and of trust."""
        f = self.found
        spread = np.abs(np.asarray(f.std_relative, dtype=float))
        verdict = f.verify(scope="execution")
        condition = f.result.get("condition number", float("nan"))
        passed = verdict.get("passed") if isinstance(verdict, dict) else verdict
        return {
            "causes": f"{len(f.phi_base)} base parameters, of which friction (viscous, dry), rotor "
            "inertia and offset of each joint; none is said to be a fault",
            "trust": f"{int((spread > 30).sum())} of {len(spread)} parameters with a standard "
            f"deviation above 30 %; condition number {condition:.0f}; `verify` (execution): "
            f"{'passed' if passed else 'not passed'}",
        }


def _inner(count: int) -> Array:
    out = np.ones(count, dtype=bool)
    out[:EDGE] = out[-EDGE:] = False
    return out
