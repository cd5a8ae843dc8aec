"""One second-order sweep of differential dynamic programming for the unicycle, on scalars.

The 4x4 and 2x2 algebra is written out: a compiled loop over 100 points pays for every small array operation, and
scalars become vectors over the batch under `jax.vmap`, with the batch as the fastest axis.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from iwalker_jax.optimization.unicycle.model import UnicycleParameters


class Trajectory(NamedTuple):
    """A motion as separate components: four states (N,) and two controls (N-1,)."""

    x: Float[Array, " n"]
    y: Float[Array, " n"]
    speed: Float[Array, " n"]
    theta: Float[Array, " n"]
    omega: Float[Array, " m"]
    acceleration: Float[Array, " m"]


class Grid(NamedTuple):
    """Time steps of a motion; arrays broadcast against a batch on a trailing axis.

    Attributes:
        dt: (N-1, ...) length of each step [samples].
        mass: (N, ...) points of the reference that each point stands for.
        span: (N-1, ...) controls that each step's controls stand for.
    """

    dt: Float[Array, " m"]
    mass: Float[Array, " n"]
    span: Float[Array, " m"]


def uniform_grid(like: Float[Array, " n"], dt: float) -> Grid:
    """Equal steps for a motion of as many points as `like`."""
    return Grid(jnp.full_like(like[1:], dt), jnp.ones_like(like), jnp.ones_like(like[1:]))


class Policy(NamedTuple):
    """Affine control law around a trajectory, one entry a stage: u = u_nominal + step k + K dx.

    Names: `k`/`K`, then `w` (omega) or `a` (acceleration), then the state it answers to.
    """

    kw: Float[Array, " m"]
    ka: Float[Array, " m"]
    Kwx: Float[Array, " m"]
    Kwy: Float[Array, " m"]
    Kwv: Float[Array, " m"]
    Kwt: Float[Array, " m"]
    Kax: Float[Array, " m"]
    Kay: Float[Array, " m"]
    Kav: Float[Array, " m"]
    Kat: Float[Array, " m"]


class StageInverse(NamedTuple):
    """What implicit derivatives need of each stage beside the gains.

    Attributes:
        ww, wa, aa: inverse control Hessian, zero in the rows of controls held by a bound.
        curvature: smallest eigenvalue of the control Hessian over the control weights, before convexification.
    """

    ww: Float[Array, " m"]
    wa: Float[Array, " m"]
    aa: Float[Array, " m"]
    curvature: Float[Array, " m"]


def control_limits(speed: Array, dt: Array, parameters: UnicycleParameters) -> tuple[Array, Array, Array, Array]:
    """Range of both controls at a speed: (omega low, omega high, a low, a high).

    A bound on the next speed is a bound on the acceleration that depends on the present speed; where it cannot be
    met the acceleration bound wins and the speed is brought back as fast as allowed.
    """
    turn = jnp.full_like(speed, jnp.inf if parameters.turn_bound is None else parameters.turn_bound)
    gain = jnp.full_like(speed, jnp.inf if parameters.acceleration_bound is None else parameters.acceleration_bound)
    low, high = -gain, gain
    if parameters.speed_bound is not None:
        room_up = (parameters.speed_bound - speed) / dt
        room_down = (-parameters.speed_bound - speed) / dt
        low = jnp.minimum(jnp.maximum(low, room_down), gain)
        high = jnp.maximum(jnp.minimum(high, room_up), -gain)
    return -turn, turn, low, high


def _bounded_step(A, B, C, gw, ga, box):
    """Minimise 1/2 d'Hd + g'd over a box, H = [[A, B], [B, C]]: the free minimiser, else the best edge's."""
    w_low, w_high, a_low, a_high = box
    inverse = 1 / (A * C - B * B)
    free_w, free_a = (B * ga - C * gw) * inverse, (B * gw - A * ga) * inverse
    inside = (free_w >= w_low) & (free_w <= w_high) & (free_a >= a_low) & (free_a <= a_high)
    edges = []
    for bound in (w_low, w_high):
        fixed = jnp.where(jnp.isfinite(bound), bound, 0.0)
        edges.append((bound, fixed, jnp.clip(-(ga + B * fixed) / C, a_low, a_high)))
    for bound in (a_low, a_high):
        fixed = jnp.where(jnp.isfinite(bound), bound, 0.0)
        edges.append((bound, jnp.clip(-(gw + B * fixed) / A, w_low, w_high), fixed))
    w, a, best = free_w, free_a, jnp.where(inside, -jnp.inf, jnp.inf)
    for bound, edge_w, edge_a in edges:
        value = 0.5 * (A * edge_w**2 + C * edge_a**2) + B * edge_w * edge_a + gw * edge_w + ga * edge_a
        better = jnp.isfinite(bound) & (value < best)
        w, a, best = jnp.where(better, edge_w, w), jnp.where(better, edge_a, a), jnp.where(better, value, best)
    return w, a, ~inside & ((w <= w_low) | (w >= w_high)), ~inside & ((a <= a_low) | (a >= a_high))


def backward_sweep(
    trajectory: Trajectory,
    reference: tuple[Array, Array],
    weights: Float[Array, "3"],
    damping: Float[Array, ""],
    curvature_floor: float,
    grid: Grid,
    parameters: UnicycleParameters,
) -> tuple[Policy, StageInverse, Float[Array, ""]]:
    """Quadratic model of the cost to go from the last stage to the first, with the dynamics' second derivatives.

    Args:
        trajectory: nominal motion.
        reference: x and y of the reference, (N,) each [m].
        weights: (3,) position, turn, acceleration.
        damping: () Levenberg-Marquardt damping, relative to the control weights.
        curvature_floor: stages whose control Hessian has a smaller eigenvalue, relative to the control weights, are
            convexified up to it.
        grid: time steps.
        parameters: bounds.

    Returns:
        The policy, the stage inverses, and the decrease of the cost that the quadratic model promises.
    """
    x, y, speed, theta, omega, acceleration = trajectory
    mass = 2 * weights[0] * grid.mass
    turn_cost, gain_cost = 2 * weights[1] * grid.span, 2 * weights[2] * grid.span
    ex, ey = mass * (x - reference[0]), mass * (y - reference[1])

    def stage(value, nominal):
        Pxx, Pxy, Pyy, Pxv, Pxt, Pyv, Pyt, Pvv, Pvt, Ptt, px, py, pv, pt, promised = value
        lx, ly, v, c, s, w, a, W, Rw, Ra, dt = nominal
        d, e = -v * s, v * c
        Pcx, Pcy = Pxx * c + Pxy * s + Pxv, Pxy * c + Pyy * s + Pyv
        Pcv, Pct = Pxv * c + Pyv * s + Pvv, Pxt * c + Pyt * s + Pvt
        Pdx, Pdy = Pxx * d + Pxy * e + Pxt, Pxy * d + Pyy * e + Pyt
        Pdv, Pdt = Pxv * d + Pyv * e + Pvt, Pxt * d + Pyt * e + Ptt
        Qvv = c * Pcx + s * Pcy + Pcv
        Qvt = c * Pdx + s * Pdy + Pdv + (c * py - s * px)
        Qtt = d * Pdx + e * Pdy + Pdt - v * (c * px + s * py)
        gw, ga = Rw * w + dt * pt, Ra * a + dt * pv
        Qwx, Qwy, Qwv, Qwt = dt * Pxt, dt * Pyt, dt * Pct, dt * Pdt
        Qax, Qay, Qav, Qat = dt * Pxv, dt * Pyv, dt * Pcv, dt * Pdv
        A, B, C = Rw + dt * dt * Ptt, dt * dt * Pvt, Ra + dt * dt * Pvv
        mean, half = 0.5 * (A / Rw + C / Ra), 0.5 * (A / Rw - C / Ra)
        spread = jnp.sqrt(half * half + B * B / (Rw * Ra))
        curvature = mean - spread
        shift = lax.stop_gradient(damping + jnp.maximum(curvature_floor - curvature, 0.0))
        A, C = A + shift * Rw, C + shift * Ra
        inverse = 1 / (A * C - B * B)
        Iww, Iwa, Iaa = C * inverse, -B * inverse, A * inverse
        rides = jnp.zeros_like(v)
        if parameters.bounded:
            w_low, w_high, a_low, a_high = control_limits(v, dt, parameters)
            kw, ka, w_held, a_held = _bounded_step(A, B, C, gw, ga, (w_low - w, w_high - w, a_low - a, a_high - a))
            Iww = jnp.where(w_held, 0.0, jnp.where(a_held, 1 / A, Iww))
            Iaa = jnp.where(a_held, 0.0, jnp.where(w_held, 1 / C, Iaa))
            Iwa = jnp.where(w_held | a_held, 0.0, Iwa)
            # A held control has no say in whether the optimum is a minimum.
            free = jnp.minimum(jnp.where(w_held, jnp.inf, A / Rw), jnp.where(a_held, jnp.inf, C / Ra))
            curvature = jnp.where(w_held | a_held, free - shift, curvature)
            if parameters.speed_bound is not None:
                target = a + ka
                gain = jnp.inf if parameters.acceleration_bound is None else parameters.acceleration_bound
                rides = (a_held & (jnp.abs(target) < gain)).astype(v.dtype)
        else:
            kw, ka = -(Iww * gw + Iwa * ga), -(Iwa * gw + Iaa * ga)
        Kwx, Kax = -(Iww * Qwx + Iwa * Qax), -(Iwa * Qwx + Iaa * Qax)
        Kwy, Kay = -(Iww * Qwy + Iwa * Qay), -(Iwa * Qwy + Iaa * Qay)
        Kwv, Kav = -(Iww * Qwv + Iwa * Qav), -(Iwa * Qwv + Iaa * Qav)
        Kwt, Kat = -(Iww * Qwt + Iwa * Qat), -(Iwa * Qwt + Iaa * Qat)
        pv, pt = c * px + s * py + pv + Qwv * kw + Qav * ka, d * px + e * py + pt + Qwt * kw + Qat * ka
        px, py = px + lx + Qwx * kw + Qax * ka, py + ly + Qwy * kw + Qay * ka
        if parameters.speed_bound is not None:
            # On the speed bound a = (v_max - v) / dt: the acceleration answers the speed, and nothing else.
            ride = -rides / dt
            Kwv, Kav = Kwv - Iww * B * ride, Kav + ride
            Qvv = Qvv + ride * (Qav + B * Kwv + C * Kav)
            Qvt = Qvt + ride * (Qat + B * Kwt + C * Kat)
            pv = pv + ride * (ga + B * kw + C * ka)
        promised = promised - (gw * kw + ga * ka + 0.5 * (A * kw * kw + C * ka * ka) + B * kw * ka)
        value = (
            Pxx + W + Qwx * Kwx + Qax * Kax,
            Pxy + Qwx * Kwy + Qax * Kay,
            Pyy + W + Qwy * Kwy + Qay * Kay,
            Pcx + Qwx * Kwv + Qax * Kav,
            Pdx + Qwx * Kwt + Qax * Kat,
            Pcy + Qwy * Kwv + Qay * Kav,
            Pdy + Qwy * Kwt + Qay * Kat,
            Qvv + Qwv * Kwv + Qav * Kav,
            Qvt + Qwv * Kwt + Qav * Kat,
            Qtt + Qwt * Kwt + Qat * Kat,
            px,
            py,
            pv,
            pt,
            promised,
        )
        policy = Policy(kw, ka, Kwx, Kwy, Kwv, Kwt, Kax, Kay, Kav, Kat)
        return value, (policy, StageInverse(Iww, Iwa, Iaa, curvature))

    zero = jnp.zeros_like(ex[-1])
    hessian = (zero + mass[-1], zero, zero + mass[-1], zero, zero, zero, zero, zero, zero, zero)
    terminal = (*hessian, ex[-1], ey[-1], zero, zero, zero)
    c, s = grid.dt * jnp.cos(theta[:-1]), grid.dt * jnp.sin(theta[:-1])
    costs = (mass[:-1], turn_cost, gain_cost, grid.dt)
    nominal = (ex[:-1], ey[:-1], speed[:-1], c, s, omega, acceleration, *costs)
    value, (policy, inverse) = lax.scan(stage, terminal, nominal, reverse=True)
    return policy, inverse, value[-1]


def forward_sweep(
    trajectory: Trajectory,
    policy: Policy,
    step: Float[Array, ""],
    reference: tuple[Array, Array],
    weights: Float[Array, "3"],
    grid: Grid,
    parameters: UnicycleParameters,
) -> tuple[Trajectory, Float[Array, ""]]:
    """Follow a policy from the trajectory's initial state with the true motion; controls are kept in their bounds.

    Args:
        trajectory: the motion the policy was made around.
        policy: affine control law.
        step: () fraction of the policy's open-loop change to take.
        reference: x and y of the reference, (N,) each [m].
        weights: (3,) position, turn, acceleration.
        grid: time steps.
        parameters: bounds.

    Returns:
        The new motion and its cost.
    """

    def stage(state, nominal):
        x, y, v, t, cost = state
        x0, y0, v0, t0, w0, a0, rx, ry, gain, dt, mass, span = nominal
        dx, dy, dv, dth = x - x0, y - y0, v - v0, t - t0
        w = w0 + step * gain.kw + gain.Kwx * dx + gain.Kwy * dy + gain.Kwv * dv + gain.Kwt * dth
        a = a0 + step * gain.ka + gain.Kax * dx + gain.Kay * dy + gain.Kav * dv + gain.Kat * dth
        if parameters.bounded:
            w_low, w_high, a_low, a_high = control_limits(v, dt, parameters)
            w, a = jnp.clip(w, w_low, w_high), jnp.clip(a, a_low, a_high)
        cost = cost + mass * weights[0] * ((x - rx) ** 2 + (y - ry) ** 2)
        cost = cost + span * (weights[1] * w * w + weights[2] * a * a)
        moved = (x + dt * v * jnp.cos(t), y + dt * v * jnp.sin(t), v + dt * a, t + dt * w, cost)
        return moved, (x, y, v, t, w, a)

    start = (*(component[0] for component in trajectory[:4]), jnp.zeros_like(trajectory.x[0]))
    along = (
        *(c[:-1] for c in trajectory[:4]),
        *trajectory[4:],
        reference[0][:-1],
        reference[1][:-1],
        policy,
        grid.dt,
        grid.mass[:-1],
        grid.span,
    )
    last, passed = lax.scan(stage, start, along)
    states = (jnp.concatenate([values, end[None]]) for values, end in zip(passed[:4], last[:4]))
    miss = (last[0] - reference[0][-1]) ** 2 + (last[1] - reference[1][-1]) ** 2
    return Trajectory(*states, *passed[4:]), last[4] + grid.mass[-1] * weights[0] * miss
