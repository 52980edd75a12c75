"""Functions of MuJoCo's library for compiled code, which calls them without Python's lock."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
from llvmlite import binding
from numba import types

_InC = Callable[..., None]

# compiled code finds the library's functions by their names, and can be cached
binding.load_library_permanently(str(next(Path(mujoco.__file__).parent.glob("*mujoco.*"))))
_pointer = types.intp
_of_two = types.void(_pointer, _pointer)
_of_state = types.void(_pointer, _pointer, _pointer, types.intc)
step1: _InC = types.ExternalFunction("mj_step1", _of_two)
step2: _InC = types.ExternalFunction("mj_step2", _of_two)
fwd_position: _InC = types.ExternalFunction("mj_fwdPosition", _of_two)
fwd_velocity: _InC = types.ExternalFunction("mj_fwdVelocity", _of_two)
set_state: _InC = types.ExternalFunction("mj_setState", _of_state)
get_state: _InC = types.ExternalFunction("mj_getState", _of_state)
copy: _InC = types.ExternalFunction("memcpy", _pointer(_pointer, _pointer, _pointer))
