"""jax: the folding from the tip, compiled for whole arrays."""

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.peers.peer import Peer, offsets_mm
from traverse.arrays import Floats
from traverse.kinematics.model.geometry import Geometry


def peer(geometry: Geometry) -> Peer:
    """The folding v <- R(u_k, theta_k) (r_k + v), `jit(vmap(...))`, 64 bits."""
    jax.config.update("jax_enable_x64", True)
    axes, steps_mm = jnp.array(geometry.axes), jnp.array(offsets_mm(geometry))

    def centre(turns_rad: jax.Array) -> jax.Array:
        vector = jnp.zeros(3)
        for k in reversed(range(geometry.n_joints)):
            vector = vector + steps_mm[k + 1]
            u, sine, cosine = axes[k], jnp.sin(turns_rad[k]), jnp.cos(turns_rad[k])
            along = (1.0 - cosine) * (u @ vector)
            vector = cosine * vector + sine * jnp.cross(u, vector) + along * u
        return vector + steps_mm[0]

    compiled = jax.jit(jax.vmap(centre))

    def batch(turns_rad: Floats) -> Floats:
        return np.asarray(compiled(turns_rad))

    return Peer("jax", jax.__version__, batch=batch)
