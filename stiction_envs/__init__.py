"""Robot joints that stick in MuJoCo, and the dither that frees them."""

from stiction_envs.envs.registration import register_all

register_all()

__version__ = "0.1.0"
