"""Laws of friction compensation, a file each, by their names in `control.COMPENSATIONS`."""

from importlib import import_module

from stiction_envs.control import COMPENSATIONS
from stiction_envs.control.laws.base import Field, Law
from stiction_envs.errors import StictionError

__all__ = ["LAWS", "Field", "Law", "register_law"]

LAWS: dict[str, Law] = {name: import_module(f"{__name__}.{name}").LAW for name in COMPENSATIONS}


def register_law(law: Law) -> None:
    """Add a law; its name can be used wherever a compensation is named."""
    if law.name in LAWS:
        raise StictionError(f"friction compensation {law.name!r} is there already")
    LAWS[law.name] = law
