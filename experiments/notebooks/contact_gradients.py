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
# # Gradients through contact
#
# Feet that touch the floor are what makes a robot walk, and what makes gradients fail: differentiate the iterations of
# a contact solver and the answer is noise or NaN. Here every physics step is the minimum of a convex problem, solved
# exactly and differentiated at its solution, and so is the controller's QP. This notebook differentiates one step,
# then whole ticks of controller and physics, compares both with differences, and shows where a derivative ends: at
# a touchdown.
#
# The step (MuJoCo's contact model): with inertia $M$, smooth force $f$, rows $J$ of joint limits and friction pyramids,
# their stiffness $D$ and reference $a$, the acceleration is
#
# $$\ddot q = \arg\min_{\ddot q}\ \tfrac12\ddot q^TM\ddot q - \ddot q^Tf +
# \tfrac12\sum_i D_i\min(0,\ J_i\ddot q - a_i)^2, \qquad d\ddot q = (M + J_P^TDJ_P)^{-1}\,dr,$$
#
# where $P$ are the pressing rows and $r = f - M\ddot q + J_P^TD(a - J_P\ddot q)$ is the residual: which rows press is
# held fixed, and that is exact until it changes.

# %%
import iwalker_jax as iw

iw.configure_runtime()  # before JAX: compiler flags and the cache of compiled programs

# %%
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import mujoco
import numpy as np

from bruce_model import load_mujoco
from iwalker_jax.control import make_controller, make_plan, velocity_footsteps
from iwalker_jax.optimization import QpSettings
from iwalker_jax.robot import initial_state, load_leg_kinematics, load_robot_model, physics_step, vary
from iwalker_jax.walking import Disturbances, Walker, sample_conditions, start_walk, walk_tick

jax.config.update("jax_enable_x64", True)  # so that differences mean something

# %% tags=["parameters"]
HEIGHTS = 81  # in the sweep through a touchdown
WALK_TICKS = 700  # of 2 ms: 1.4 s, into the second step

# %% [markdown]
# ## One step, standing
#
# How do the velocities after a step feel the motor torques? Against central differences of our step, and of C MuJoCo,
# which knows nothing of our derivative.

# %%
model = load_mujoco()
robot = load_robot_model(model)
standing = np.array(model.key_qpos[0])
standing[2] -= 0.0005  # [m] pressed into the floor: clearly in contact
torques = np.random.default_rng(0).normal(scale=0.3, size=model.nu)  # [N m]


def velocities(torques, qpos=standing):
    """Velocities after one step from rest."""
    return physics_step(robot, initial_state(robot, jnp.asarray(qpos)), torques)[0].qvel


def mujoco_velocities(torques):
    """The same by C MuJoCo."""
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = standing, torques
    mujoco.mj_step(model, data)
    return data.qvel.copy()


def differences(function, point, size=1e-5):
    """Central differences, a column for each input."""
    columns = [(function(point + size * e) - function(point - size * e)) / (2 * size) for e in np.eye(len(point))]
    return np.stack([np.asarray(column) for column in columns], axis=1)


jacobian = np.asarray(jax.jit(jax.jacrev(velocities))(jnp.asarray(torques)))
ours, theirs = differences(jax.jit(velocities), torques), differences(mujoco_velocities, torques)
scale = np.abs(theirs).max()
errors = {"our differences": np.abs(jacobian - ours).max() / scale, "MuJoCo's": np.abs(jacobian - theirs).max() / scale}
for name, error in errors.items():
    print(f"off from {name}: {error:.1e} of the largest entry")

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
bound = np.abs(jacobian).max()
for axis, values, title in ((left, jacobian, "derivative"), (right, theirs, "differences by C MuJoCo")):
    shown = axis.imshow(values, cmap="coolwarm", vmin=-bound, vmax=bound, aspect="auto")
    axis.set(title=title, xlabel="motor", ylabel="velocity (base 6, legs 10, arms 6)")
figure.colorbar(shown, ax=(left, right), label="d velocity / d torque [(m/s or rad/s) / N m]")
plt.show()

# %% [markdown]
# ## Whole ticks: state and footsteps to motion, through QP and contact
#
# A robot in mid-step. The outcome is its state some ticks later; the inputs are all velocities and all footsteps to
# come. One random direction each, forward mode against central differences.

# %%
walker = Walker(robot, make_controller(robot, solver=QpSettings()), load_leg_kinematics(model))
calm = Disturbances(start_position=0.0, start_velocity=0.0, mass=0.0, friction=(0.8, 0.8))
conditions = jax.tree.map(lambda leaf: leaf[0], sample_conditions(robot, calm, 1, seed=0))
table = make_plan(*velocity_footsteps(0.15, 0.0, 0.0, 20, 0.24, 0.1, 1), 1)
plan = jax.tree.map(lambda leaf: leaf.astype(float) if leaf.dtype == jnp.float32 else leaf, table)


def advance(state, plan, ticks):
    """A walk some ticks later."""
    return jax.lax.fori_loop(0, ticks, lambda _, s: walk_tick(walker, conditions, plan, s)[0], state)


middle = jax.jit(advance)(start_walk(walker, conditions), plan, WALK_TICKS)
print(f"time {float(middle.physics.time):.2f} s, fallen: {bool(middle.fallen)}")

# %%
rng = np.random.default_rng(1)
directions = {
    "velocities": {"velocity": jnp.asarray(rng.normal(size=model.nv)), "footsteps": jnp.zeros(plan.positions.shape)},
    "footsteps": {"velocity": jnp.zeros(model.nv), "footsteps": jnp.asarray(rng.normal(size=plan.positions.shape))},
}


def later(change, ticks):
    """Velocities after some ticks, from a changed state on changed footsteps."""
    physics = middle.physics._replace(qvel=middle.physics.qvel + change["velocity"])
    moved = plan._replace(positions=plan.positions + change["footsteps"])
    end = advance(middle._replace(physics=physics), moved, ticks)
    return end.physics.qvel


@jax.jit
def value_and_slope(change, direction, ticks):
    """`later`, and its derivative along a direction."""
    return jax.jvp(lambda c: later(c, ticks), (change,), (direction,))


nothing = jax.tree.map(jnp.zeros_like, directions["velocities"])
ticks_errors = {}
print("inputs       ticks   largest derivative   off from differences")
for name, direction in directions.items():
    for ticks in (1, 10, 50):
        _, slope = value_and_slope(nothing, direction, ticks)
        ahead, behind = (
            value_and_slope(jax.tree.map(lambda d, s=s: s * d, direction), direction, ticks) for s in (1e-7, -1e-7)
        )
        numeric = (ahead[0] - behind[0]) / 2e-7
        ticks_errors[f"{name}, {ticks}"] = float(jnp.abs(slope - numeric).max() / jnp.abs(numeric).max())
        size = float(jnp.abs(slope).max())
        print(f"{name:12} {ticks:5} {size:20.3f} {ticks_errors[f'{name}, {ticks}']:22.1e}")

# %% [markdown]
# A tenth of a second of QPs and contacts in a row, and the derivative is still that of the differences. Through a
# landing there would be a jump, since the step clock counts whole ticks.
#
# ## Where a derivative ends
#
# Let the standing robot begin a little above or in the floor, sinking at 0.1 m/s. A foot's contact begins in this step
# or it does not, and the velocity afterwards jumps between the two. No derivative can say so: JAX returns that of the
# side where one is, which is right there, and blind to the other.

# %%
heights = jnp.linspace(-1e-3, 1e-3, HEIGHTS)  # [m] of the soles above the floor


def after(height):
    """Vertical velocity [m/s] of the base after a step, sinking at 0.1 m/s before."""
    qpos = jnp.asarray(model.key_qpos[0]).at[2].add(height)
    qvel = jnp.zeros(model.nv).at[2].set(-0.1)
    return physics_step(robot, initial_state(robot, qpos, qvel), jnp.zeros(model.nu))[0].qvel[2]


values, slopes = jax.jit(jax.vmap(lambda height: jax.jvp(after, (height,), (1.0,))))(heights)
middles = (heights[1:] + heights[:-1]) / 2
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.2), layout="constrained")
left.plot(1e3 * heights, values, ".-")
left.set(xlabel="height of the soles [mm]", ylabel="vertical velocity after a step [m/s]")
right.plot(1e3 * middles, jnp.diff(values) / jnp.diff(heights), "k.", label="differences of neighbours")
right.plot(1e3 * heights, slopes, lw=1, label="derivative")
right.set(xlabel="height of the soles [mm]", ylabel="d velocity / d height [1/s]", ylim=(-10, 5))
right.legend(title="the jump itself is out of view")
plt.show()

# %% [markdown]
# ## Try
#
# - Repeat the sweep with one foot higher than the other: two kinks.
# - Reverse mode through many ticks: `jax.lax.scan` over `jax.checkpoint(walk_tick)`, as
#   `python -m benchmarks.walking_gradients` does for 120 ticks.
# - Identify a parameter: the derivative of a step in the friction, by `iwalker_jax.robot.vary`.

# %%
pushed = jnp.zeros(model.nv).at[0].set(0.5)  # sliding forward at 0.5 m/s


def slowed(friction):
    """Forward velocity [m/s] after a step."""
    slippery = vary(robot, friction=friction)
    return physics_step(slippery, initial_state(robot, jnp.asarray(standing), pushed), jnp.zeros(model.nu))[0].qvel[0]


change = jax.jit(lambda friction: jax.jvp(slowed, (friction,), (1.0,))[1])(0.4)
print(f"{float(change):+.4f} m/s after 2 ms for one more of friction")
