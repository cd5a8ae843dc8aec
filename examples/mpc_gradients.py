"""Gradients of both MPCs, implicit, unrolled and stopped, beside each other: python examples/mpc_gradients.py.

The unicycle MPC tracks a path; the step MPC plans H-LIP footsteps beside it. Each is asked how its optimal cost changes
with what it is given. At convergence the implicit and the unrolled derivative agree; the stopped one takes the optimum
as a constant, which for the step MPC's footsteps leaves nothing.
"""

import iwalker_jax as iw

iw.configure_runtime()

import jax
import jax.numpy as jnp

MODES = ("implicit", "unrolled", "stopped")


def tracking_error(path: jax.Array, mode: iw.GradientMode) -> tuple[jax.Array, iw.Solution]:
    """Squared distance [m^2] of the tracked path's end from where the path ends."""
    start = iw.initial_state_from_reference(path)
    solution = iw.solve_unicycle(path, start, gradient=mode)
    return jnp.sum((solution.value.states[-1, :2] - path[-1]) ** 2), solution


def step_effort(footsteps: jax.Array, mode: iw.GradientMode) -> tuple[jax.Array, iw.Solution]:
    """Squared length [m^2] of the steps that the MPC makes of wanted footsteps."""
    standing = jnp.asarray([[0.0, 0.0, 0.0], [0.0, -0.05, 0.0]])
    solution = iw.solve_step_mpc(footsteps, standing, gradient=mode)
    return jnp.sum(solution.value.inputs**2), solution


def compare(name: str, function, argument: jax.Array) -> None:
    print(f"{name}:")
    for mode in MODES:
        (value, solution), gradient = jax.value_and_grad(function, has_aux=True)(argument, mode)
        trusted = "trusted" if bool(solution.gradient_valid) else "not trusted"
        print(f"  {mode:9} value {float(value):.6f}  |gradient| {float(jnp.linalg.norm(gradient)):.6f}  ({trusted})")


def main() -> None:
    along = jnp.linspace(0.0, 1.0, 100)
    path = jnp.stack([2.0 * along, 0.4 * jnp.sin(3.0 * along)], axis=1)
    compare("Unicycle MPC", tracking_error, path)
    k = jnp.arange(8)
    footsteps = jnp.stack([0.08 * (k + 1), jnp.where(k % 2 == 0, 0.05, -0.05)], axis=1)
    compare("Step MPC", step_effort, footsteps)


if __name__ == "__main__":
    main()
