"""A quadratic program, its gradient, and one that nothing satisfies: python examples/quadratic_program.py.

The point of a box and a half-plane that is nearest to a target; and how it moves with the target.
"""

import iwalker_jax as iw

iw.configure_runtime()

import jax
import jax.numpy as jnp

ROWS = jnp.asarray([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
BLOCKS = (("box", 2), ("half-plane", 1))


def nearest(target: jax.Array) -> jax.Array:
    """The point x with 0 <= x <= 1 and x_0 + x_1 <= 1.5 that is nearest to the target."""
    low, high = jnp.asarray([0.0, 0.0, -jnp.inf]), jnp.asarray([1.0, 1.0, 1.5])
    problem = iw.QuadraticProgram(jnp.eye(2), -target, ROWS, low, high, BLOCKS)
    return iw.solve_qp(problem).value.x


def main() -> None:
    target = jnp.asarray([0.9, 1.4])
    low, high = [0.0, 0.0, -jnp.inf], [1.0, 1.0, 1.5]
    problem = iw.quadratic_program(jnp.eye(2), -target, ROWS, jnp.asarray(low), jnp.asarray(high), BLOCKS)
    print(problem)
    solution = iw.solve_qp(problem)
    print(f"x = {solution.value.x}, multipliers {solution.value.y}: {iw.describe(int(solution.status))}")
    print(f"dx/dtarget = {jax.jacobian(nearest)(target).tolist()}")
    print(f"dx/dtarget inside the bounds = {jax.jacobian(nearest)(jnp.asarray([0.3, 0.4])).tolist()}")

    crossed = iw.quadratic_program(
        jnp.eye(2), -target, ROWS, jnp.asarray([0.0, 0.0, 2.5]), jnp.asarray([1.0, 1.0, 3.0]), BLOCKS
    )
    print(iw.explain(crossed, iw.solve_qp(crossed)))


if __name__ == "__main__":
    main()
