"""One stage of differential dynamic programming for the unicycle, on scalars.

The 4x4 and 2x2 algebra is written out: a compiled loop over 100 points pays for every small array operation, and
scalars become vectors over the batch under `jax.vmap`, with the batch as the fastest axis.
Indices: x, y, v (speed) and t (theta) are the state, w (omega) and a (acceleration) the controls.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from iwalker_jax.optimization.unicycle.model import UnicycleParameters


class ControlLaw(NamedTuple):
    """Affine control law around a trajectory, one entry a stage: u = u_nominal + step k + K dx.

    Names: `k`/`K`, then `w` (omega) or `a` (acceleration), then the state it answers to.
    """

    kw: Float[Array, " m *b"]
    ka: Float[Array, " m *b"]
    Kwx: Float[Array, " m *b"]
    Kwy: Float[Array, " m *b"]
    Kwv: Float[Array, " m *b"]
    Kwt: Float[Array, " m *b"]
    Kax: Float[Array, " m *b"]
    Kay: Float[Array, " m *b"]
    Kav: Float[Array, " m *b"]
    Kat: Float[Array, " m *b"]


class StageInverse(NamedTuple):
    """What implicit derivatives need of each stage beside the gains.

    Attributes:
        ww, wa, aa: inverse control Hessian, zero in the rows of controls held by a bound.
        curvature: smallest eigenvalue of the control Hessian over the control weights, before convexification.
        margin: how far the controls are from meeting or leaving a bound, over half the bounds' distance; infinite
            without bounds.
    """

    ww: Float[Array, " m *b"]
    wa: Float[Array, " m *b"]
    aa: Float[Array, " m *b"]
    curvature: Float[Array, " m *b"]
    margin: Float[Array, " m *b"]


class CostToGo(NamedTuple):
    """Quadratic model of the cost from a state on: Hessian and gradient by x, y, v (speed) and t (theta).

    `promised` is the decrease of the cost that the model promises from there on.
    """

    xx: Array
    xy: Array
    yy: Array
    xv: Array
    xt: Array
    yv: Array
    yt: Array
    vv: Array
    vt: Array
    tt: Array
    x: Array
    y: Array
    v: Array
    t: Array
    promised: Array


class Stage(NamedTuple):
    """One stage of the nominal motion.

    Attributes:
        x, y: gradient of the position cost.
        v, c, s: speed; dt times cosine and sine of the heading.
        w, a: controls.
        position, turn, acceleration: second derivatives of the cost.
        dt: length of the step.
    """

    x: Array
    y: Array
    v: Array
    c: Array
    s: Array
    w: Array
    a: Array
    position: Array
    turn: Array
    acceleration: Array
    dt: Array


class Expansion(NamedTuple):
    """Second-order model of a stage's cost and all after it: by the state, by state and controls w, a, by these."""

    xx: Array
    xy: Array
    yy: Array
    xv: Array
    xt: Array
    yv: Array
    yt: Array
    vv: Array
    vt: Array
    tt: Array
    x: Array
    y: Array
    v: Array
    t: Array
    wx: Array
    wy: Array
    wv: Array
    wt: Array
    ax: Array
    ay: Array
    av: Array
    at: Array
    ww: Array
    wa: Array
    aa: Array
    w: Array
    a: Array


class ControlChange(NamedTuple):
    """The best change of a stage's controls and whether the acceleration rides on the speed bound (0 or 1)."""

    w: Array
    a: Array
    on_speed_bound: Array


class StateGradient(NamedTuple):
    """Gradient of a cost to go by the state."""

    x: Array
    y: Array
    v: Array
    t: Array


def control_limits(
    speed: Float[Array, "*b"], dt: Float[Array, "*g"], parameters: UnicycleParameters
) -> tuple[Float[Array, "*b"], Float[Array, "*b"], Float[Array, "*b"], Float[Array, "*b"]]:
    """Range of both controls at a speed [m/sample]: (omega low, omega high, a low, a high).

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


def _bounded_step(
    q: Expansion, box: tuple[Array, Array, Array, Array]
) -> tuple[Float[Array, "*b"], Float[Array, "*b"], Bool[Array, "*b"], Bool[Array, "*b"]]:
    """Minimise the model over the controls' box: the free minimiser, else the best edge's; and which are held."""
    A, B, C, gw, ga = q.ww, q.wa, q.aa, q.w, q.a
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


def expand(after: CostToGo, stage: Stage, second_order: bool) -> Expansion:
    """Carry the cost to go back over a stage, with the second derivatives of the motion or without (Gauss-Newton).

    The motion's Jacobian adds (c, s, 1) times the speed's and (-v s, v c, 1) times the heading's change.
    """
    P, c, s, v, dt = after, stage.c, stage.s, stage.v, stage.dt
    d, e = -v * s, v * c
    Pcx, Pcy = P.xx * c + P.xy * s + P.xv, P.xy * c + P.yy * s + P.yv
    Pcv, Pct = P.xv * c + P.yv * s + P.vv, P.xt * c + P.yt * s + P.vt
    Pdx, Pdy = P.xx * d + P.xy * e + P.xt, P.xy * d + P.yy * e + P.yt
    Pdv, Pdt = P.xv * d + P.yv * e + P.vt, P.xt * d + P.yt * e + P.tt
    vt, tt = c * Pdx + s * Pdy + Pdv, d * Pdx + e * Pdy + Pdt
    if second_order:
        vt, tt = vt + (c * P.y - s * P.x), tt - v * (c * P.x + s * P.y)
    return Expansion(
        vv=c * Pcx + s * Pcy + Pcv,
        vt=vt,
        tt=tt,
        w=stage.turn * stage.w + dt * P.t,
        a=stage.acceleration * stage.a + dt * P.v,
        wx=dt * P.xt,
        wy=dt * P.yt,
        wv=dt * Pct,
        wt=dt * Pdt,
        ax=dt * P.xv,
        ay=dt * P.yv,
        av=dt * Pcv,
        at=dt * Pdv,
        ww=stage.turn + dt * dt * P.tt,
        wa=dt * dt * P.vt,
        aa=stage.acceleration + dt * dt * P.vv,
        v=c * P.x + s * P.y + P.v,
        t=d * P.x + e * P.y + P.t,
        x=P.x + stage.x,
        y=P.y + stage.y,
        xx=P.xx + stage.position,
        xy=P.xy,
        yy=P.yy + stage.position,
        xv=Pcx,
        xt=Pdx,
        yv=Pcy,
        yt=Pdy,
    )


def convexified(
    q: Expansion, stage: Stage, damping: Float[Array, "*b"], curvature_floor: float
) -> tuple[Expansion, Float[Array, "*b"], Float[Array, "*b"]]:
    """The model with its control Hessian damped and lifted to the floor; its curvature before, and what was added."""
    A, B, C, Rw, Ra = q.ww, q.wa, q.aa, stage.turn, stage.acceleration
    mean, half = 0.5 * (A / Rw + C / Ra), 0.5 * (A / Rw - C / Ra)
    spread = jnp.sqrt(half * half + B * B / (Rw * Ra))
    curvature = mean - spread
    shift = lax.stop_gradient(damping + jnp.maximum(curvature_floor - curvature, 0.0))
    return q._replace(ww=A + shift * Rw, aa=C + shift * Ra), curvature, shift


def best_controls(
    q: Expansion,
    curvature: Float[Array, "*b"],
    shift: Float[Array, "*b"],
    stage: Stage,
    parameters: UnicycleParameters,
) -> tuple[ControlChange, StageInverse]:
    """The controls' change that minimises the model within their bounds, and the inverse Hessian of the free ones."""
    A, B, C = q.ww, q.wa, q.aa
    inverse = 1 / (A * C - B * B)
    Iww, Iwa, Iaa = C * inverse, -B * inverse, A * inverse
    rides = jnp.zeros_like(stage.v)
    if not parameters.bounded:
        controls = ControlChange(-(Iww * q.w + Iwa * q.a), -(Iwa * q.w + Iaa * q.a), rides)
        return controls, StageInverse(Iww, Iwa, Iaa, curvature, jnp.full_like(curvature, jnp.inf))
    w_low, w_high, a_low, a_high = control_limits(stage.v, stage.dt, parameters)
    box = (w_low - stage.w, w_high - stage.w, a_low - stage.a, a_high - stage.a)
    kw, ka, w_held, a_held = _bounded_step(q, box)
    Iww = jnp.where(w_held, 0.0, jnp.where(a_held, 1 / A, Iww))
    Iaa = jnp.where(a_held, 0.0, jnp.where(w_held, 1 / C, Iaa))
    Iwa = jnp.where(w_held | a_held, 0.0, Iwa)
    # A held control has no say in whether the optimum is a minimum.
    free = jnp.minimum(jnp.where(w_held, jnp.inf, A / stage.turn), jnp.where(a_held, jnp.inf, C / stage.acceleration))
    curvature = jnp.where(w_held | a_held, free - shift, curvature)
    if parameters.speed_bound is not None:
        target = stage.a + ka
        gain = jnp.inf if parameters.acceleration_bound is None else parameters.acceleration_bound
        rides = (a_held & (jnp.abs(target) < gain)).astype(stage.v.dtype)
    pull_w, pull_a = q.w + A * kw + B * ka, q.a + B * kw + C * ka
    margin = jnp.minimum(
        _distance_to_change(stage.w + kw, w_low, w_high, w_held, pull_w / A),
        _distance_to_change(stage.a + ka, a_low, a_high, a_held, pull_a / C),
    )
    if parameters.speed_bound is not None and parameters.acceleration_bound is not None:
        # Where both bounds meet, either may be the one that holds.
        towards = jnp.where(ka >= box[3], stage.v, -stage.v)
        corner = jnp.abs((parameters.speed_bound - towards) / stage.dt - gain) / gain
        margin = jnp.where(a_held, jnp.minimum(margin, corner), margin)
    return ControlChange(kw, ka, rides), StageInverse(Iww, Iwa, Iaa, curvature, lax.stop_gradient(margin))


def _distance_to_change(
    value: Float[Array, "*b"],
    low: Float[Array, "*b"],
    high: Float[Array, "*b"],
    held: Bool[Array, "*b"],
    released: Float[Array, "*b"],
) -> Float[Array, "*b"]:
    """Of a free control the distance to its bounds, of a held one how far it would move, over half their distance."""
    half = (high - low) / 2
    moved = jnp.where(held, jnp.abs(released), jnp.minimum(high - value, value - low))
    bounded = jnp.isfinite(half) & (half > 0)
    return jnp.where(bounded, jnp.maximum(moved, 0) / jnp.where(bounded, half, 1), jnp.inf)


def control_law(q: Expansion, controls: ControlChange, inverse: StageInverse) -> ControlLaw:
    """The controls' change and its answer to the state."""
    Iww, Iwa, Iaa = inverse.ww, inverse.wa, inverse.aa
    return ControlLaw(
        kw=controls.w,
        ka=controls.a,
        Kwx=-(Iww * q.wx + Iwa * q.ax),
        Kax=-(Iwa * q.wx + Iaa * q.ax),
        Kwy=-(Iww * q.wy + Iwa * q.ay),
        Kay=-(Iwa * q.wy + Iaa * q.ay),
        Kwv=-(Iww * q.wv + Iwa * q.av),
        Kav=-(Iwa * q.wv + Iaa * q.av),
        Kwt=-(Iww * q.wt + Iwa * q.at),
        Kat=-(Iwa * q.wt + Iaa * q.at),
    )


def gradient_before(q: Expansion, law: ControlLaw) -> StateGradient:
    """Gradient of the cost to go of the stage under its control law."""
    return StateGradient(
        v=q.v + q.wv * law.kw + q.av * law.ka,
        t=q.t + q.wt * law.kw + q.at * law.ka,
        x=q.x + q.wx * law.kw + q.ax * law.ka,
        y=q.y + q.wy * law.kw + q.ay * law.ka,
    )


def follow_speed_bound(
    q: Expansion, law: ControlLaw, gradient: StateGradient, inverse: StageInverse, ride: Float[Array, "*b"]
) -> tuple[Expansion, ControlLaw, StateGradient]:
    """On the speed bound a = (v_max - v) / dt: the acceleration answers the speed by `ride` = -1/dt, and nothing else.

    `ride` is zero where the acceleration is not held by that bound.
    """
    law = law._replace(Kwv=law.Kwv - inverse.ww * q.wa * ride, Kav=law.Kav + ride)
    q = q._replace(
        vv=q.vv + ride * (q.av + q.wa * law.Kwv + q.aa * law.Kav),
        vt=q.vt + ride * (q.at + q.wa * law.Kwt + q.aa * law.Kat),
    )
    return q, law, gradient._replace(v=gradient.v + ride * (q.a + q.wa * law.kw + q.aa * law.ka))


def cost_before(q: Expansion, law: ControlLaw, gradient: StateGradient, promised: Float[Array, "*b"]) -> CostToGo:
    """Cost to go of the stage under its control law; `promised` is the decrease promised after it."""
    kw, ka = law.kw, law.ka
    promised = promised - (q.w * kw + q.a * ka + 0.5 * (q.ww * kw * kw + q.aa * ka * ka) + q.wa * kw * ka)
    return CostToGo(
        xx=q.xx + q.wx * law.Kwx + q.ax * law.Kax,
        xy=q.xy + q.wx * law.Kwy + q.ax * law.Kay,
        yy=q.yy + q.wy * law.Kwy + q.ay * law.Kay,
        xv=q.xv + q.wx * law.Kwv + q.ax * law.Kav,
        xt=q.xt + q.wx * law.Kwt + q.ax * law.Kat,
        yv=q.yv + q.wy * law.Kwv + q.ay * law.Kav,
        yt=q.yt + q.wy * law.Kwt + q.ay * law.Kat,
        vv=q.vv + q.wv * law.Kwv + q.av * law.Kav,
        vt=q.vt + q.wv * law.Kwt + q.av * law.Kat,
        tt=q.tt + q.wt * law.Kwt + q.at * law.Kat,
        x=gradient.x,
        y=gradient.y,
        v=gradient.v,
        t=gradient.t,
        promised=promised,
    )
