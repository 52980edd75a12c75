"""Robot joints that stick in MuJoCo, and the dither that frees them.

    import stiction_envs as st

    d = st.diagnose("log.csv", robot="panda", torque="link")
    d.save("runs/why")
    arm = st.load_model("runs/why/model.toml")
    base = st.SingleJointExperiment(arm).base_torques()
    final = st.tune("panda", table="base.csv", out="runs/panda").final
    better = st.search("panda", objective="both", out="runs/search").final

Names are imported when they are first asked for; the environments are registered at once.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from stiction_envs.envs.registration import register_all
from stiction_envs.version import __version__

if TYPE_CHECKING:
    from stiction_envs.dither.dither import Dither
    from stiction_envs.errors import StictionError
    from stiction_envs.experiments.conformance import conformance
    from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
    from stiction_envs.experiments.sje.experiment import SingleJointExperiment
    from stiction_envs.gap.diagnose import diagnose
    from stiction_envs.gap.extended_model import load_model
    from stiction_envs.hidden.rehearsal.rehearse import rehearse
    from stiction_envs.identification.excitation import excite
    from stiction_envs.identification.identify import identify
    from stiction_envs.measured.checks.files import check
    from stiction_envs.robots import load_arm
    from tuning.protocol.tune import tune
    from tuning.search.search import search

_HOME = {
    "Dither": "stiction_envs.dither.dither",
    "GeneratedTrajectoryExperiment": "stiction_envs.experiments.gte.experiment",
    "SingleJointExperiment": "stiction_envs.experiments.sje.experiment",
    "StictionError": "stiction_envs.errors",
    "check": "stiction_envs.measured.checks.files",
    "conformance": "stiction_envs.experiments.conformance",
    "diagnose": "stiction_envs.gap.diagnose",
    "excite": "stiction_envs.identification.excitation",
    "identify": "stiction_envs.identification.identify",
    "load_arm": "stiction_envs.robots",
    "load_model": "stiction_envs.gap.extended_model",
    "rehearse": "stiction_envs.hidden.rehearsal.rehearse",
}
"""Where each name of the library is; other packages add some as entry points."""

__all__ = [
    "Dither",
    "GeneratedTrajectoryExperiment",
    "SingleJointExperiment",
    "StictionError",
    "__version__",
    "check",
    "conformance",
    "diagnose",
    "excite",
    "identify",
    "load_arm",
    "load_model",
    "rehearse",
    "search",
    "tune",
]

register_all()


def __getattr__(name: str) -> object:
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
    else:
        from importlib.metadata import entry_points

        points = entry_points(group="stiction_envs.api", name=name)
        if not points:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = next(iter(points)).load()
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
