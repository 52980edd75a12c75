"""Robot joints that stick in MuJoCo, and the dither that frees them."""

from stiction_envs.envs.registration import register_all
from stiction_envs.version import __version__

register_all()

__all__ = ["__version__"]
