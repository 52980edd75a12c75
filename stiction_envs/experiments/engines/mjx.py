"""MJX, MuJoCo in JAX: the engine of MuJoCo Playground and Brax."""

import copy
from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from stiction_envs.experiments.engines.base import Array, Drive, Engine, Refused, silent

ITERATIONS, LINE_SEARCH = 5, 8
"""Most iterations of the solver and of its line search [-], assumed: MJX makes all of a line search
in each step, and MuJoCo's 100 and 50 take too long on a CPU."""


class Mjx(Engine):
    """MJX on its JAX backend, float32. It has no ``dcmotor``."""

    name: ClassVar = "mjx"
    packages: ClassVar = (("mujoco.mjx", "mujoco-mjx"), ("jax", "jax"))
    motor: ClassVar = None
    keep: ClassVar = (
        "export with `--friction frictionloss`; then "
        '`mjx.put_model(mujoco.MjModel.from_xml_path("scene.xml"))`'
    )

    def simulate(self, drive: Drive) -> Iterator[dict[str, Array]]:
        """See `Engine.simulate`."""
        import jax
        from jax import numpy as jnp
        from mujoco import mjx

        host = silent(copy.copy(drive.bare.model))
        host.opt.iterations = min(host.opt.iterations, ITERATIONS)
        host.opt.ls_iterations = min(host.opt.ls_iterations, LINE_SEARCH)
        try:
            model = mjx.put_model(host)
        except (NotImplementedError, ValueError) as error:
            raise Refused(error) from None
        blank = mjx.make_data(model)
        state = jax.vmap(lambda q: blank.replace(qpos=q))(jnp.asarray(drive.qpos, jnp.float32))

        @jax.jit
        def run(state: mjx.Data, applied: jax.Array) -> tuple[mjx.Data, dict[str, jax.Array]]:
            def one(state: mjx.Data, now: jax.Array) -> tuple[mjx.Data, dict[str, jax.Array]]:
                go = jax.vmap(lambda d, f: mjx.step(model, d.replace(qfrc_applied=f)))
                state = go(state, now)
                return state, {name: getattr(state, name) for name in drive.record}

            return jax.lax.scan(one, state, applied)

        for time in drive.chunks():
            applied = jnp.asarray(drive.torque(time).swapaxes(0, 1), jnp.float32)
            state, out = run(state, applied)
            yield {
                "time": time,
                **{k: np.asarray(v, np.float64).swapaxes(0, 1) for k, v in out.items()},
            }
