"""Quadratic programs with bounds on rotated inputs, solved in the space of the inverse Hessian.

Problem: min (u - u*)'H(u - u*) / 2 with low <= R u <= high, R orthonormal, given only M = H^-1 (H itself may be too
large to write down). With S = R M R' and w = R u the optimum is w = w* - S y, y the bounds' multipliers: y > 0 only at
an upper, y < 0 only at a lower bound. ADMM finds nearly the right active set, a primal-dual active-set step makes it
exact (Hintermueller, Ito, Kunisch 2002); rounds of both run until the set reproduces itself.

Why not `solve_qp`, which needs H? With the states eliminated H grows with the pendulum's unstable pole: its condition
is 1e9 for 8 steps and 1e23 for 20, and in single precision the footsteps are wrong by 0.1 m and 1 m. With the states
kept it is well conditioned but has 8 variables and 8 rows a step: 0.9 ms for 8 steps and 8.4 ms for 20 where this takes
0.27 ms, with errors of 0.03 and 0.08 mm where this has 1e-4 mm (two CPU cores; `python -m benchmarks.step_mpc` has it
as a row). The inverse M comes from the Riccati recursion, which no horizon spoils.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import cho_factor, cho_solve
from jaxtyping import Array, Bool, Float, Int

# One penalty does not serve all problems: cycling over four decades leaves about a tenth of the failures.
PENALTIES = (10.0, 1.0, 100.0, 0.1)
_ADMM_STEPS = 50
_ACTIVE_SET_STEPS = 6
_ROUNDS = 12
_RELAXATION = 1.6


class ActiveBounds(NamedTuple):
    """Outcome of the search.

    Attributes:
        sides: (m,) +1 at an upper bound, -1 at a lower one, 0 free.
        within: (m,) ADMM's last point: near the optimum and within the bounds even if the search failed.
        rounds: () rounds used.
    """

    sides: Int[Array, " m"]
    within: Float[Array, " m"]
    rounds: Int[Array, ""]


def _held_system(inverse: Float[Array, "m m"], active: Bool[Array, " m"]) -> Float[Array, "m m"]:
    """S of the active rows, the identity's size in the others."""
    both = active[:, None] & active[None, :]
    # The jitter keeps the Cholesky factor real when the active steps leave almost no freedom.
    jitter = 10 * jnp.finfo(inverse.dtype).eps
    diagonal = jnp.where(active, jitter, 1.0) * jnp.mean(jnp.diagonal(inverse))
    return jnp.where(both, inverse, 0) + jnp.diag(diagonal)


def distance_to_change(
    inverse: Float[Array, "m m"],
    sides: Int[Array, " m"],
    y: Float[Array, " m"],
    w: Float[Array, " m"],
    low: Float[Array, " m"],
    high: Float[Array, " m"],
) -> Float[Array, ""]:
    """Least distance of a free row from its bounds, and of what an active one would move by if it were released."""
    active = sides != 0
    alone = cho_solve(cho_factor(_held_system(inverse, active)), jnp.eye(y.shape[0], dtype=y.dtype))
    moved = y * sides / jnp.diagonal(alone)
    # Equal bounds hold a row whichever way it is pushed.
    moved = jnp.where(low == high, jnp.inf, moved)
    return jnp.maximum(jnp.min(jnp.where(active, moved, jnp.minimum(high - w, w - low))), 0)


def bound_solver(
    inverse: Float[Array, "m m"], sides: Int[Array, " m"]
) -> Callable[[Float[Array, " m"]], Float[Array, " m"]]:
    """Function from the active bounds' violation w - bound to the multipliers that remove it.

    Factorises once; derivatives follow the linear system and hold the set.

    Args:
        inverse: S.
    """
    active = sides != 0
    system = _held_system(inverse, active)
    factor = cho_factor(jax.lax.stop_gradient(system))

    def respond(violation: Float[Array, " m"]) -> Float[Array, " m"]:
        return jax.lax.custom_linear_solve(
            lambda y: system @ y,
            jnp.where(active, violation, 0),
            lambda _, b: cho_solve(factor, b),
            symmetric=True,
        )

    return respond


def find_active_bounds(
    relaxed: Callable[[Int[Array, ""]], Float[Array, "m m"]],
    inverse: Float[Array, "m m"],
    free: Float[Array, " m"],
    low: Float[Array, " m"],
    high: Float[Array, " m"],
) -> ActiveBounds:
    """Search the active set of the optimum.

    Args:
        relaxed: rho (R H R' + rho I)^-1, of ADMM's own quadratic problem, for an index into PENALTIES.
        inverse: S.
        free: w*.
    """
    eps = jnp.finfo(free.dtype).eps
    slack = 100 * eps * jnp.maximum(jnp.max(jnp.abs(free)), jnp.max(jnp.abs(high)))
    scale = jnp.mean(jnp.diagonal(inverse))

    def improve(sides: Int[Array, " m"]) -> tuple[Int[Array, " m"], Float[Array, ""]]:
        bound = jnp.where(sides > 0, high, low)
        y = bound_solver(inverse, sides)(free - bound)
        w = free - inverse @ y
        outside = jnp.where(w > high + slack, 1, jnp.where(w < low - slack, -1, 0))
        after = jnp.where(sides == 0, outside, jnp.where(y * sides > 0, sides, 0))
        violation = jnp.maximum(jnp.maximum(w - high, low - w), 0)
        sign_error = jnp.where(sides == 0, 0, jnp.maximum(-y * sides, 0) * scale)
        error = jnp.maximum(jnp.max(violation), jnp.max(sign_error))
        return after, jnp.where(jnp.isfinite(error), error, jnp.inf)

    def admm(_: Array | int, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        z, y, operator = state
        w = free + operator @ (z - y - free)
        w = _RELAXATION * w + (1 - _RELAXATION) * z
        after = jnp.clip(w + y, low, high)
        return after, y + w - after, operator

    def attempt(carry: tuple) -> tuple:
        sides, best, error, _, steps = carry
        after, size = improve(sides)
        better = size < error
        best, error = jnp.where(better, sides, best), jnp.where(better, size, error)
        return after, best, error, jnp.all(after == sides), steps + 1

    def run_round(carry: tuple) -> tuple:
        (z, y), best, error, _, rounds = carry
        ladder = jnp.asarray(PENALTIES, free.dtype)
        now, before = rounds % len(PENALTIES), (rounds - 1) % len(PENALTIES)
        y = y * ladder[before] / ladder[now]
        z, y, _ = jax.lax.fori_loop(0, _ADMM_STEPS, admm, (z, y, relaxed(now)))
        sides = jnp.where(y > slack, 1, jnp.where(y < -slack, -1, 0))
        start = (sides, best, error, jnp.asarray(False), 0)
        _, best, error, done, _ = jax.lax.while_loop(lambda c: ~c[3] & (c[4] < _ACTIVE_SET_STEPS), attempt, start)
        return (z, y), best, error, done, rounds + 1

    nothing = jnp.zeros(free.shape, int)
    error = jnp.max(jnp.maximum(jnp.maximum(free - high, low - free), 0))
    zero = jnp.asarray(0, jnp.int32)
    start = ((jnp.clip(free, low, high), jnp.zeros_like(free)), nothing, error, error <= slack, zero)
    state, best, _, _, rounds = jax.lax.while_loop(lambda c: ~c[3] & (c[4] < _ROUNDS), run_round, start)
    return ActiveBounds(best, state[0], rounds)
