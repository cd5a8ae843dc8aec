"""Structured factorisation of the step MPC's KKT system, written on scalars in modal coordinates.

Notation: x = [s, xi, zeta] (footstep, divergent and convergent component) has the diagonal step map x' = a x + b u
with a = (1, m, 1/m), b = (1, -m, -1/m), m the unstable pole. Stages k = 0..N-1 hold u_k, x_{k+1} and the costate
nu_{k+1}; any trailing axes are independent right-hand sides (planes). The system, symmetric and indefinite:
    Q_{k+1} x_{k+1} + a nu_{k+2} - nu_{k+1} = q_{k+1}
    r u_k           + b'nu_{k+1}            = f_k
    a x_k + b u_k   - x_{k+1}               = e_k          (x_0 = 0: the initial state enters through e_0)
Backward and forward sweeps need no power of the pole, so long horizons stay accurate in float32.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Kkt = tuple[Float[Array, "n 3 *b"], Float[Array, " n *b"], Float[Array, "n 3 *b"]]
"""States, inputs and costates, or the three rows of the system."""


class StepCost(NamedTuple):
    """Quadratic cost of every stage in modal coordinates; all () and >= 0 but `cross`.

    Attributes:
        footstep: weight of s.
        divergent, convergent, cross: entries of the 2x2 weight of (xi, zeta).
        terminal: weight added to xi at the last stage.
        effort: weight r of the step size.
    """

    footstep: Float[Array, ""]
    divergent: Float[Array, ""]
    convergent: Float[Array, ""]
    cross: Float[Array, ""]
    terminal: Float[Array, ""]
    effort: Float[Array, ""]


class KktFactor(NamedTuple):
    """Riccati factorisation, one row a stage.

    Attributes:
        pole: () unstable pole m.
        gain: feedback u = kappa - gain'x.
        push: P b, with P the cost-to-go matrix of the next state.
        cost_to_go: upper triangle of P (ss, sx, sz, xx, xz, zz).
        curvature: r + b'P b.
    """

    pole: Float[Array, ""]
    gain: Float[Array, "n 3"]
    push: Float[Array, "n 3"]
    cost_to_go: Float[Array, "n 6"]
    curvature: Float[Array, " n"]


def pack(point: Kkt) -> Float[Array, "n 7 *b"]:
    """States, inputs and costates as one array, which is what a custom linear solve transposes safely."""
    states, inputs, costates = point
    return jnp.concatenate([states, inputs[:, None], costates], axis=1)


def unpack(packed: Float[Array, "n 7 *b"]) -> Kkt:
    """Inverse of `pack`."""
    return packed[:, :3], packed[:, 3], packed[:, 4:]


def weigh_states(cost: StepCost, states: Float[Array, "n 3 *b"]) -> Float[Array, "n 3 *b"]:
    """Q x of every stage."""
    footstep, divergent, convergent = states[:, 0], states[:, 1], states[:, 2]
    pull = (cost.divergent * divergent + cost.cross * convergent).at[-1].add(cost.terminal * divergent[-1])
    return jnp.stack([cost.footstep * footstep, pull, cost.cross * divergent + cost.convergent * convergent], axis=1)


def apply_kkt(cost: StepCost, pole: Float[Array, ""], point: Kkt) -> Kkt:
    """Left-hand side of the system at a point."""
    states, inputs, costates = point
    rest = (1,) * (states.ndim - 2)
    a = jnp.stack([jnp.ones_like(pole), pole, 1 / pole]).reshape(3, *rest)
    b = a.at[1:].multiply(-1)
    none = jnp.zeros_like(states[:1])
    return (
        weigh_states(cost, states) + a * jnp.concatenate([costates[1:], none]) - costates,
        cost.effort * inputs + jnp.sum(b * costates, axis=1),
        a * jnp.concatenate([none, states[:-1]]) + b * inputs[:, None] - states,
    )


def factorise_kkt(cost: StepCost, pole: Float[Array, ""], horizon: int) -> KktFactor:
    """Riccati recursion of the cost-to-go, backward from the last stage."""
    m, w = pole, 1 / pole

    def stage(p: tuple, _: None) -> tuple[tuple, tuple]:
        ss, sx, sz, xx, xz, zz = p
        gs = ss - m * sx - w * sz
        gx = sx - m * xx - w * xz
        gz = sz - m * xz - w * zz
        curvature = cost.effort + gs - m * gx - w * gz
        ks, kx, kz = gs / curvature, m * gx / curvature, w * gz / curvature
        before = (
            cost.footstep + ss - gs * ks,
            m * (sx - gx * ks),
            w * (sz - gz * ks),
            cost.divergent + m * m * (xx - gx * gx / curvature),
            cost.cross + xz - gx * gz / curvature,
            cost.convergent + w * w * (zz - gz * gz / curvature),
        )
        return before, (jnp.stack([ks, kx, kz]), jnp.stack([gs, gx, gz]), jnp.stack(p), curvature)

    zero = jnp.zeros_like(pole)
    last = (cost.footstep, zero, zero, cost.divergent + cost.terminal, cost.cross, cost.convergent)
    start = tuple(jnp.asarray(x, pole.dtype) for x in last)
    _, rows = jax.lax.scan(stage, start, None, length=horizon, reverse=True)
    return KktFactor(pole, *rows)


def solve_factorised(factor: KktFactor, rows: Kkt) -> Kkt:
    """Solution of the system for one right-hand side (q, f, e)."""
    m, w = factor.pole, 1 / factor.pole

    def back(linear: tuple, row: tuple) -> tuple[tuple, tuple]:
        ls, lx, lz = linear
        (push, p, curvature), q, f, e = row
        # h = linear - P d, with the drift d = -e; the cost-to-go is x'P x / 2 - linear'x.
        hs = ls + p[0] * e[0] + p[1] * e[1] + p[2] * e[2]
        hx = lx + p[1] * e[0] + p[3] * e[1] + p[4] * e[2]
        hz = lz + p[2] * e[0] + p[4] * e[1] + p[5] * e[2]
        kappa = (f + hs - m * hx - w * hz) / curvature
        before = (
            q[0] + hs - push[0] * kappa,
            q[1] + m * (hx - push[1] * kappa),
            q[2] + w * (hz - push[2] * kappa),
        )
        return before, (kappa, ls, lx, lz)

    def forth(state: tuple, row: tuple) -> tuple[tuple, tuple]:
        s, x, z = state
        (gain, p), (kappa, ls, lx, lz), e = row
        u = kappa - gain[0] * s - gain[1] * x - gain[2] * z
        after = s + u - e[0], m * (x - u) - e[1], w * (z - u) - e[2]
        s, x, z = after
        costate = (
            p[0] * s + p[1] * x + p[2] * z - ls,
            p[1] * s + p[3] * x + p[4] * z - lx,
            p[2] * s + p[4] * x + p[5] * z - lz,
        )
        return after, (jnp.stack(after), u, jnp.stack(costate))

    q, f, e = rows
    # The linear term of the cost-to-go of x_{k+1} contains q_{k+1}; the carry starts with the last one.
    shifted = jnp.concatenate([jnp.zeros_like(q[:1]), q[:-1]])
    parts = (factor.push, factor.cost_to_go, factor.curvature)
    _, linear = jax.lax.scan(back, tuple(q[-1]), (parts, shifted, f, e), reverse=True)
    start = (jnp.zeros_like(f[0]),) * 3
    _, solution = jax.lax.scan(forth, start, ((factor.gain, factor.cost_to_go), linear, e))
    return solution
