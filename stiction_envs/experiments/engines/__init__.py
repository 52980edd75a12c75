"""Physics engines in which an arm may stick: a registry, one file each."""

from stiction_envs.errors import StictionError, unknown
from stiction_envs.experiments.engines.base import Bare, Drive, Engine, MuJoCo, Refused
from stiction_envs.experiments.engines.mjx import Mjx
from stiction_envs.experiments.engines.newton import Newton
from stiction_envs.experiments.engines.warp import Warp

__all__ = ["ENGINES", "Bare", "Drive", "Engine", "Refused", "engine_named", "register_engine"]

ENGINES: dict[str, Engine] = {e.name: e for e in (MuJoCo(), Warp(), Mjx(), Newton())}


def register_engine(engine: Engine) -> None:
    """Add an engine by its name; raise a StictionError if the name is taken."""
    if engine.name in ENGINES:
        raise StictionError(f"engine {engine.name!r} is there already")
    ENGINES[engine.name] = engine


def engine_named(name: str) -> Engine:
    """Return an engine; raise a StictionError if it is unknown or lacks its packages."""
    if name not in ENGINES:
        raise unknown("engine", name, ENGINES)
    ENGINES[name].check()
    return ENGINES[name]
