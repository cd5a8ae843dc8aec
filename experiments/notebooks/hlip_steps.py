# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#   kernelspec:
#     display_name: Python 3 (ipykernel)
#     language: python
#     name: python3
# ---

# %% [markdown]
# # H-LIP: orbits, the step MPC, and a cost that loses the robot
#
# Between two touchdowns a walking robot is, to first order, a point that falls over its foot. The hybrid linear
# inverted pendulum keeps just that, and what remains of walking is a linear map from step to step: orbits, gains and
# an MPC come in closed form. This notebook draws the orbits, plans steps with the MPC, and shows what happens with a
# cost that speaks of footsteps alone.
#
# One plane at a time (Xiong and Ames, 2022; iWalker, eq. 11). With $\lambda = \sqrt{g/z_0}$, the state just before
# impact is $x = [c, p, v]$: COM, COM minus stance foot, COM velocity; the input $u$ is the step size:
#
# $$x_{k+1} = A x_k + B u_k,\qquad s_k = c_k - p_k \;\Rightarrow\; s_{k+1} = s_k + u_k.$$

# %%
import iwalker_jax as iw

iw.configure_runtime()  # before JAX: compiler flags and the cache of compiled programs

# %%
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from iwalker_jax.optimization import (
    deadbeat_gain,
    divergent_component,
    lqr_gain,
    orbit_p1,
    orbit_p2,
    pendulum_flow,
    step_matrices,
)

# %% tags=["parameters"]
SPEED = 0.3  # [m/s] forward
WIDTH = 0.1  # [m] between the tracks of the feet
STEPS = 12  # planned

# %% [markdown]
# ## Orbits
#
# Equal steps at speed $v_d$ (period one): $u^\star = v_d T,\; p^\star = u^\star / (2 + T_{DSP}\sigma_1),\; v^\star =
# \sigma_1 p^\star$ with $\sigma_1 = \lambda\coth(\lambda T_{SSP}/2)$. Sideways the feet take turns (period two), and
# $\sigma_2 = \lambda\tanh(\lambda T_{SSP}/2)$ takes the place of $\sigma_1$; dashed
# is the other foot.

# %%
pendulum = iw.HlipParameters()  # BRUCE: COM at 0.365 m, steps of 0.24 s
matrix, column = step_matrices(pendulum)
print(f"lambda {float(pendulum.rate):.3f} 1/s; A =\n{np.round(matrix, 3)}\nB = {np.round(column, 3)}")
print(f"eigenvalues of (p, v): {np.sort(np.linalg.eigvals(matrix[1:, 1:]).real).round(3)}")
forward_p, forward_v, forward_u = orbit_p1(pendulum, SPEED)
print(f"forward: p* {float(forward_p):.4f} m, v* {float(forward_v):.4f} m/s, u* {float(forward_u):.4f} m")

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
time = jnp.linspace(0.0, pendulum.single_support_time, 60)
for speed in (0.1, 0.2, 0.3):
    p, v, u = orbit_p1(pendulum, speed)
    left.plot(*pendulum_flow(pendulum.rate, p - u, v, time), label=f"{speed:g} m/s")
for width, colour in ((0.06, "C0"), (0.1, "C1"), (0.14, "C2")):
    for side, style in ((1.0, "-"), (-1.0, "--")):
        p, v = orbit_p2(pendulum, side * width, -side * width)
        label = f"{width:g} m wide" if side > 0 else None
        right.plot(*pendulum_flow(pendulum.rate, p - side * width, v, time), style, color=colour, label=label)
left.set(title="period one, forward", xlabel="COM minus stance foot p [m]", ylabel="velocity v [m/s]")
right.set(title="period two, sideways", xlabel="COM minus stance foot p [m]")
left.legend()
right.legend(loc="center", fontsize=8)
plt.show()

# %% [markdown]
# ## Feedback: two steps, or a few gentle ones
#
# $u = u^\star + K(x - x^\star)$. The deadbeat gain kills any deviation in two steps; LQR trades speed for shorter
# corrections.

# %%
GAINS = {"deadbeat": deadbeat_gain(pendulum), "LQR": lqr_gain(pendulum, jnp.array([1.0, 0.1]), jnp.asarray(1.0))}
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3), layout="constrained")
for name, gain in GAINS.items():
    errors, inputs = [np.array([0.0, 0.0, 0.2])], []  # pushed by 0.2 m/s
    for _ in range(6):
        inputs.append(float(gain @ errors[-1][1:]))
        errors.append(np.asarray(matrix @ errors[-1] + column * inputs[-1]))
    left.plot([error[2] for error in errors], "o-", label=name)
    right.plot(inputs, "o-", label=name)
left.set(xlabel="step", ylabel="velocity off the orbit [m/s]")
right.set(xlabel="step", ylabel="step size off the orbit [m]")
left.legend()
plt.show()

# %% [markdown]
# ## The step MPC
#
# Which steps near the wanted ones keep the pendulum walking (iWalker, eq. 9)? With weights on footsteps, on $p$ and
# $v$ about the orbit, and on the divergent component at the end, it is one linear solve, and linear in its inputs.
# Here the robot is 0.1 m/s too fast in both directions.

# %%
k = np.arange(1, STEPS + 1)
wanted = np.stack([float(forward_u) * k, np.where(k % 2, -WIDTH / 2, WIDTH / 2)], axis=1)
p_side, v_side = orbit_p2(pendulum, -WIDTH, WIDTH)  # on the left foot, about to step right
start = np.array(
    [
        [float(forward_p), float(forward_p), float(forward_v) + 0.1],
        [WIDTH / 2 + float(p_side), float(p_side), float(v_side) + 0.1],
    ]
)  # [c, p, v] of the x and the y plane; the stance foot stands at (0, WIDTH / 2)
ours = iw.solve_step_mpc(wanted, start)
published = iw.solve_step_mpc(wanted, start, weights=iw.StepMpcWeights.published())
bounded = iw.solve_bounded_step_mpc(wanted, start, jnp.asarray(1.0))
for name, solution in {"ours": ours, "published": published, "within reach": bounded}.items():
    print(f"{name:12} {iw.describe(solution.status)} residual {float(solution.residual):.0e}")

# %%
figure, axis = plt.subplots(figsize=(9, 2.8), layout="constrained")
axis.plot(*wanted.T, "ks", mfc="none", ms=10, label="wanted")
for name, solution, mark in (("MPC", ours, "o"), ("within a leg's reach", bounded, "x"), ("published", published, "+")):
    axis.plot(*solution.value.footsteps.T, mark, ms=8, label=name)
axis.plot(*ours.value.states[:, :, 0].T, ".-", lw=0.7, color="grey", label="COM before impact (MPC)")
axis.set(xlabel="x [m]", ylabel="y [m]", ylim=(-0.16, 0.3))
axis.legend(ncols=3, fontsize=8, loc="upper left")
plt.show()

# %% [markdown]
# ## The trap
#
# The published cost weighs footsteps and step sizes. But $s_{k+1} = s_k + u_k$ holds whatever the pendulum does, so
# such a cost does not contain the pendulum at all: its footsteps are the wanted ones, a little shortened, and the COM
# follows from them by a map with an eigenvalue of 3.5 a step. Footsteps look fine; the robot is long gone.


# %%
def com_of(inputs):
    """COM minus stance foot [m] under given step sizes, by nothing but the step map in double precision."""
    states, a, b = [start], np.asarray(matrix, np.float64), np.asarray(column, np.float64)
    for step in np.asarray(inputs, np.float64):
        states.append(states[-1] @ a.T + step[:, None] * b)
    return np.stack(states)[:, :, 1]


runaway = {
    name: com_of(s.value.inputs) for name, s in (("ours", ours), ("within reach", bounded), ("published", published))
}
figure, axis = plt.subplots(figsize=(7, 3.2), layout="constrained")
for name, positions in runaway.items():
    axis.semilogy(np.abs(positions[:, 0]), "o-", label=name)
axis.axhline(0.5, color="grey", lw=1, ls=":", label="a leg's length, about")
axis.set(xlabel="step", ylabel="|COM minus stance foot|, forward [m]")
axis.legend()
plt.show()

# %% [markdown]
# The same in one number: the divergent component $\xi = p + v/\lambda$ (for $T_{DSP} = 0$) grows by the pole at every
# step, $\xi_{k+1} = 3.5\,(\xi_k - u_k)$, and stays bounded only if the steps to come make up for it:
# $\xi_k = \sum_j 3.5^{-j} u_{k+j}$. And the published optimum does not feel the velocity at all (it feels
# $c$ and $p$ only because the stance foot is $c - p$): an iStepper taught by it cannot learn to catch a push.


# %%
def first_step(state, weights):
    """The first step forward [m] as a function of the robot's state."""
    return iw.solve_step_mpc(wanted, state, weights=weights).value.inputs[0, 0]


xi = {
    name: divergent_component(pendulum, s.value.states[..., 1], s.value.states[..., 2])
    for name, s in (("ours", ours), ("published", published))
}
print("largest divergent component [m]:", {name: f"{float(jnp.abs(value).max()):.3g}" for name, value in xi.items()})
slopes = {
    name: np.asarray(jax.grad(first_step)(jnp.asarray(start), weights))
    for name, weights in (("ours", iw.StepMpcWeights()), ("published", iw.StepMpcWeights.published()))
}
for name, slope in slopes.items():
    print(f"{name:10} d(first step)/d[c, p, v] = {slope[0].round(3)}")

# %% [markdown]
# ## Try
#
# - Weigh only the terminal divergent component. How far may `STEPS` shrink before the COM runs away again?
# - Compare the first step of the MPC with the deadbeat answer to the same push; which is nearer to the wanted one?
# - `jax.grad` through `iw.HlipParameters`: by how much does a COM 1 cm higher lengthen the first step?


# %%
def with_height(height):
    """Length of the first step [m] for a COM height [m]."""
    return iw.solve_step_mpc(wanted, start, iw.HlipParameters(com_height=height)).value.inputs[0, 0]


print(f"{float(jax.grad(with_height)(0.365)):+.3f} m of step per m of COM height")
