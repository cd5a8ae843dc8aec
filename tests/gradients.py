"""One check for every gradient: forward mode = reverse mode = central differences."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np


def assert_gradients_agree(
    function: Callable, *inputs: jax.Array, tolerance: float = 1e-5, step: float = 1e-6, seed: int = 0
) -> None:
    """Compare directional derivatives of `function` with respect to every input, alone and in random directions.

    The output is contracted with a random cotangent; errors are relative to the largest derivative met.
    Call it in double precision.
    """
    rng = np.random.default_rng(seed)
    output = function(*inputs)
    assert output.dtype == jnp.float64, "gradients are checked in double precision"
    cotangent = jnp.asarray(rng.normal(size=output.shape))
    _, pull_back = jax.vjp(function, *inputs)
    reverse = pull_back(cotangent)
    for k, value in enumerate(inputs):
        for _ in range(3):
            direction = jnp.asarray(rng.normal(size=value.shape))

            def along(amount, k=k, direction=direction):
                moved = [*inputs]
                moved[k] = moved[k] + amount * direction
                return jnp.vdot(cotangent, function(*moved))

            _, forward = jax.jvp(along, (jnp.zeros(()),), (jnp.ones(()),))
            backward = jnp.vdot(reverse[k], direction)
            numeric = (along(step) - along(-step)) / (2 * step)
            scale = max(abs(float(numeric)), float(jnp.linalg.norm(reverse[k])), 1e-8)
            assert abs(float(forward - backward)) <= 1e-9 * scale, f"input {k}: forward {forward}, reverse {backward}"
            assert abs(float(backward - numeric)) <= tolerance * scale, (
                f"input {k}: reverse {backward}, central differences {numeric}"
            )
