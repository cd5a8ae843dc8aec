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
# # The unicycle MPC and its three gradients
#
# A planner is trained here without labels: the network proposes a path, an optimiser finds the motion that tracks it
# best, and what the two differ by is the loss. Whether the network learns anything useful from that hangs on one
# question: what is the derivative of an *optimum*? This notebook solves the unicycle MPC, differentiates it in all
# three modes of the library, and holds each against central differences.
#
# The problem (iWalker, eqs. 5 to 7; one sample is the unit of time): for a reference $\hat\phi_0,\dots,\hat\phi_{N-1}$,
#
# $$\phi^\star = \arg\min_{\omega, a}\; \sum_{k} w_{pos}\,\|(x_k, y_k) - \hat\phi_k\|^2 + w_{turn}\,\omega_k^2 +
# w_{acc}\,a_k^2,$$
#
# $$x_{k+1} = x_k + v_k\cos\theta_k,\quad y_{k+1} = y_k + v_k\sin\theta_k,\quad v_{k+1} = v_k + a_k,\quad
# \theta_{k+1} = \theta_k + \omega_k.$$

# %%
import iwalker_jax as iw

iw.configure_runtime()  # before JAX: compiler flags and the cache of compiled programs

# %%
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from iwalker_jax.optimization import UnicycleParameters

# %% tags=["parameters"]
PROBES = 33  # points of the path at which central differences are taken
ITERATIONS = (1, 2)  # at which the solver is cut off
DESCENT_STEPS = 150

# %% [markdown]
# ## Solve it
#
# The reference turns sharper than a unicycle with these weights cares to. A `Solution` says whether it is one.

# %%
N = 100
along = jnp.linspace(0.0, 4.0, N)  # [m]
path = jnp.stack([along, 0.5 - jnp.abs(0.5 - (along / 2.0) % 1.0)], axis=1)  # [m] a zigzag of 45 degrees
start = iw.initial_state_from_reference(path)  # [x, y, v, theta]
solution = iw.solve_unicycle(path, start)
plan = solution.value
print(iw.describe(solution.status))
print(f"cost {float(plan.cost):.4f}, residual {float(solution.residual):.1e}, {int(solution.iterations)} iterations")
print(f"gradient may be trusted: {bool(solution.gradient_valid)}, margin {float(solution.margin):.3f}")

# %%
figure, (above, below) = plt.subplots(2, 1, figsize=(8, 4.6), layout="constrained")
above.plot(*path.T, "k--", lw=1, label="reference")
above.plot(*plan.path.T, lw=2, label="optimum")
above.set(xlabel="x [m]", ylabel="y [m]", ylim=(-0.05, 0.85), aspect="equal")
above.legend(ncols=2, loc="upper center")
below.plot(plan.controls[:, 0], label="turn rate ω [rad/sample]")
below.plot(10 * plan.controls[:, 1], label="acceleration a [0.1 m/sample²]")
below.set(xlabel="sample")
below.legend()
plt.show()

# %% [markdown]
# ## Three gradients of one number
#
# The tracking error $E(\hat\phi) = \frac1N\sum_k \|\phi^\star_k - \hat\phi_k\|^2$ depends on the reference twice:
# directly, and through the optimum. With the optimality conditions $g(z^\star, \hat\phi) = 0$,
#
# - `implicit` solves $\partial_z g\; dz^\star = -\partial_{\hat\phi} g\; d\hat\phi$ at the optimum: constant memory;
# - `unrolled` differentiates the iterations;
# - `stopped` takes $\phi^\star$ as a constant, as the paper does.
#
# All in double precision, so that differences mean something.


# %%
def tracking_error(reference, mode, parameters=UnicycleParameters(tolerance=1e-7)):
    """Mean squared distance [m^2] between a reference and what can be tracked of it; whether to trust its gradient."""
    solution = iw.solve_unicycle(reference, jnp.asarray(start, reference.dtype), parameters, gradient=mode)
    return jnp.mean(jnp.sum((solution.value.path - reference) ** 2, axis=1)), solution.gradient_valid


def central_difference(function, reference, index, step=1e-4):
    """dE/dy of one point [m^2/m]."""
    ahead, behind = (function(reference.at[index, 1].add(sign * step)) for sign in (1, -1))
    return (ahead - behind) / (2 * step)


MODES = ("implicit", "unrolled", "stopped")
slope = jax.jit(jax.grad(tracking_error, has_aux=True), static_argnums=(1, 2))
with jax.enable_x64(True):
    path64 = jnp.asarray(np.asarray(path, np.float64))
    gradients = {mode: np.asarray(slope(path64, mode)[0]) for mode in MODES}
    value = jax.jit(lambda reference: tracking_error(reference, "stopped")[0])
    probes = np.linspace(0, N - 1, PROBES).round().astype(int)
    differences = np.array([float(central_difference(value, path64, k)) for k in probes])
scale = np.abs(differences).max()
errors = {mode: np.abs(gradient[probes, 1] - differences).max() / scale for mode, gradient in gradients.items()}
for mode, error in errors.items():
    print(f"{mode:9} off by {error:.1e} of the largest difference")

# %%
figure, axis = plt.subplots(figsize=(11, 3.4), layout="constrained")
for mode, style in zip(MODES, ("-", "--", ":")):
    axis.plot(1e3 * gradients[mode][:, 1], style, lw=2, label=mode)
axis.plot(probes, 1e3 * differences, "ko", ms=4, label="central differences")
axis.set(xlabel="point k of the reference", ylabel=r"$\partial E/\partial \hat y_k$ [$10^{-3}$ m²/m]")
axis.legend(ncols=4)
plt.show()

# %% [markdown]
# The implicit and the unrolled gradient lie on the differences. The stopped one does not know that the optimum moves
# along with the reference: it is off by a third of the largest slope, most of all towards the end of the path.
#
# ## A gradient that looks right
#
# Cut the solver off early. The implicit gradient then belongs to an optimum that has not been reached, and nothing in
# its values tells so; the unrolled one is that of the point that is really returned. Errors are against the
# differences at the true optimum, and `gradient_valid` says which to believe. (The first of these iterations starts
# from a search on a coarser grid, so that few are needed.)


# %%
print("iterations   implicit off by   unrolled off by   gradient_valid")
with jax.enable_x64(True):
    for count in ITERATIONS:
        early = UnicycleParameters(max_iterations=count, unrolled_iterations=count, tolerance=1e-7)
        (implicit, trusted), (unrolled, _) = (slope(path64, mode, early) for mode in ("implicit", "unrolled"))
        off = [np.abs(np.asarray(g)[probes, 1] - differences).max() / scale for g in (implicit, unrolled)]
        print(f"{count:10} {off[0]:17.1e} {off[1]:17.1e}   {bool(trusted)}")

# %% [markdown]
# ## Imperative learning in one cell
#
# Let the reference itself be what is learned: descend $E$ with a term that keeps it near the zigzag. This is what
# training does to the network's path, without the network.


# %%
def loss(reference, mode):
    """Tracking error, and a pull to where the reference began [m^2]."""
    return tracking_error(reference, mode, UnicycleParameters())[0] + 0.02 * jnp.mean((reference - path) ** 2)


def descend(mode):
    """References and losses of plain gradient descent; the ends of the path stay."""
    inner = jnp.ones((N, 1)).at[jnp.array([0, -1])].set(0.0)

    def step(reference, _):
        error, slope = jax.value_and_grad(loss)(reference, mode)
        return reference - 5.0 * inner * slope, error

    return jax.jit(lambda: jax.lax.scan(step, path, None, length=DESCENT_STEPS))()


learned = {mode: descend(mode) for mode in ("implicit", "stopped")}

# %%
figure, (above, below) = plt.subplots(2, 1, figsize=(8, 5), layout="constrained")
above.plot(*path.T, "k--", lw=1, label="zigzag")
for mode, (reference, losses) in learned.items():
    above.plot(*reference.T, lw=2, label=f"learned, {mode}")
    below.semilogy(losses, label=mode)
above.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", ylim=(-0.05, 1.4))
below.set(xlabel="step of descent", ylabel="loss [m²]")
above.legend(ncols=3, loc="upper center")
below.legend()
plt.show()

# %% [markdown]
# Whoever takes the optimum for a constant pulls the reference towards it, and the optimum moves on: the loss falls at
# first and then grows, because the stopped gradient is that of no function at all.
#
# ## Try
#
# - `UnicycleParameters.published()` bounds both controls tightly. Is the gradient still valid, and what does `margin`
#   say?
# - `jax.jacfwd` of `plan.states[-1]` in the weights: `iw.solve_unicycle(..., weights=...)`.
# - `method="ilqr"`: the same answer by other iterations.

# %%
bounded = iw.solve_unicycle(path, start, UnicycleParameters.published())
print(
    iw.describe(bounded.status), f"Gradient valid: {bool(bounded.gradient_valid)}, margin {float(bounded.margin):.1e}"
)
