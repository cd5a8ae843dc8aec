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
# # The QP and the whole-body controller, torque by torque
#
# 500 times a second the controller asks one question: which joint torques do best what feet, torso and COM shall do,
# given that feet neither slip nor pull and motors have limits? This notebook starts with the solver on a problem small
# enough to draw, lets it refuse one that has no answer, and then opens the whole-body program of a walking robot.
#
# The solver: $\min_x \tfrac12 x^TPx + q^Tx$ with $l \le Cx \le h$, and multipliers $y$ with $Px + q + C^Ty = 0$. The
# controller (iWalker, eq. 16): unknowns are the legs' accelerations and the contact forces $F$; from
# $M\ddot q + h = S^T\tau + J^TF$ the base's six rows give its acceleration, and the other rows the torques, so both are
# affine in the unknowns. Costs are weighted squares of task errors; constraints are friction pyramids
# $|F_x|, |F_y| \le \mu F_z$, $F_z \ge F_{min}$, and $|\tau| \le \tau_{max}$.

# %%
import iwalker_jax as iw

iw.configure_runtime()  # before JAX: compiler flags and the cache of compiled programs

# %%
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from iwalker_jax.control import control_step, make_plan, velocity_footsteps
from iwalker_jax.robot import rigid_body_terms
from iwalker_jax.walking import Disturbances, default_walker, sample_conditions, start_walk, walk_tick

# %% tags=["parameters"]
SPEED = 0.2  # [m/s] forward
STEPS = 8  # of the walk
SECONDS = 3.0  # simulated
TICK = 900  # at which the program is opened; 2 ms each

# %% [markdown]
# ## A QP that can be drawn
#
# The point of a box, below a line, that is nearest to a target; and how it moves with the target.

# %%
rows = jnp.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
high = jnp.array([1.0, 1.0, 1.5])
blocks = (("box", 2), ("line", 1))


def nearest(target, low=jnp.array([0.0, 0.0, -jnp.inf])):
    """The program of the nearest point."""
    return iw.QuadraticProgram(jnp.eye(2), -target, rows, low, high, blocks)


solve = jax.jit(iw.solve_qp)
targets = [jnp.array(t) for t in ((0.5, 0.3), (0.9, 1.4), (1.4, 0.8), (1.3, -0.2))]
slope = jax.jit(jax.jacobian(lambda target: iw.solve_qp(nearest(target)).value.x))
figure, axis = plt.subplots(figsize=(4.6, 4.2), layout="constrained")
axis.fill([0, 1, 1, 0.5, 0], [0, 0, 0.5, 1, 1], color="0.9")
for k, target in enumerate(targets):
    solution = solve(nearest(target))
    x = solution.value.x
    axis.annotate(
        "", xy=x, xytext=(float(target[0]), float(target[1])), arrowprops={"arrowstyle": "->", "color": f"C{k}"}
    )
    axis.plot(*target, "x", color=f"C{k}")
    axis.plot(*x, "o", color=f"C{k}", label=f"dx/dtarget of rank {np.linalg.matrix_rank(slope(target), tol=1e-3)}")
axis.set(xlabel="x₀", ylabel="x₁", aspect="equal", title="targets (x) and answers (o)")
axis.legend(fontsize=8)
axis.set(ylim=(-0.3, 2.1))
plt.show()

# %% [markdown]
# A program that nothing satisfies is not an exception inside `jit` but a status, and the answer is the least violating
# point. At the boundary, `iw.explain` says which rows are at odds.

# %%
crossed = iw.quadratic_program(jnp.eye(2), -targets[1], rows, jnp.array([0.0, 0.0, 2.5]), high.at[2].set(3.0), blocks)
print(iw.explain(crossed, iw.solve_qp(crossed)))

# %% [markdown]
# ## The whole-body program of one tick
#
# Let the robot walk for a while, and open the program in the middle of a step.

# %%
walker, model = default_walker()
robot, controller = walker.robot, walker.controller
calm = Disturbances(start_position=0.0, start_velocity=0.0, mass=0.0, friction=(0.8, 0.8))
conditions = jax.tree.map(lambda leaf: leaf[0], sample_conditions(robot, calm, 1, seed=0))
gait = controller.gait
plan = make_plan(*velocity_footsteps(SPEED, 0.0, 0.0, STEPS, float(gait.hlip.step_time), 0.1, 1), 1)


def tick(state, _):
    """One tick, and what is to be plotted of it."""
    after, sample = walk_tick(walker, conditions, plan, state)
    return after, (state, sample)


ticks = round(SECONDS / controller.time_step)
_, (states, samples) = jax.jit(lambda: jax.lax.scan(tick, start_walk(walker, conditions), None, length=ticks))()
state = jax.tree.map(lambda leaf: leaf[TICK], states)


@jax.jit
def open_program(state):
    """Torques, and everything that the controller decided, in a state of the walk."""
    qpos, qvel = state.physics.qpos, state.physics.qvel
    terms = rigid_body_terms(robot, qpos, qvel)
    arms = qpos[robot.arm_positions], qvel[robot.arm_velocities]
    memory = state.memory
    torques, _, info = control_step(controller, terms, arms, memory.touching, plan, memory.controller)
    return torques, info, terms


torques, info, terms = open_program(state)
print(info.program)
print(iw.describe(info.solution.status), f"{int(info.solution.iterations)} pivots from the last tick's answer")

# %%
forces = np.asarray(info.forces)
print(f"time {float(samples.time[TICK]):.2f} s, standing on the {('right', 'left')[int(samples.stance[TICK])]} foot")
print("contact force [N]       x       y       z   share of the friction pyramid")
for name, force in zip(("right toe", "right heel", "left toe", "left heel"), forces):
    share = np.abs(force[:2]).max() / (controller.tasks.friction * max(force[2], 1e-9))
    print(f"{name:16}  {force[0]:7.2f} {force[1]:7.2f} {force[2]:7.2f}   {share if force[2] > 0.1 else 0:.0%}")
print(f"weight {float(terms.mass) * 9.81:.1f} N, sum of vertical forces {forces[:, 2].sum():.1f} N")
limits = np.asarray(controller.actuation.limits)
figure, axis = plt.subplots(figsize=(9, 3), layout="constrained")
axis.bar(robot.motor_names, torques, color=["C0" if n.endswith("_r") else "C1" for n in robot.motor_names])
axis.plot(np.stack([limits, -limits], axis=1), "k_", ms=14)
axis.tick_params(axis="x", rotation=60)
axis.set(ylabel="motor torque [N m]", title="torques and limits")
plt.show()

# %% [markdown]
# ## Torque by torque through the walk

# %%
time = np.asarray(samples.time)
sizes = np.asarray(samples.torques)
figure, (above, below) = plt.subplots(2, 1, figsize=(9, 5.4), sharex=True, layout="constrained")
shares = sizes[:, :5] / limits[:5]
for k in range(5):
    above.plot(time, 100 * shares[:, k], lw=1, label=robot.motor_names[k])
above.set(ylabel="|torque|, share of the limit [%]", title="right leg")
above.set(ylim=(0, 55))
above.legend(ncols=5, fontsize=8)
vertical = np.asarray(samples.forces)[:, :, 2].reshape(-1, 2, 2).sum(2)
for foot, name in enumerate(("right", "left")):
    below.plot(time, vertical[:, foot], lw=1, label=f"{name} foot")
below.axhline(float(terms.mass) * 9.81, color="grey", ls=":", label="weight")
below.set(xlabel="time [s]", ylabel="vertical force [N]")
below.set(ylim=(0, 65))
below.legend(ncols=3, fontsize=8)
plt.show()

# %% [markdown]
# ## What a torque limit does
#
# Scale all limits of the program that was opened, from plenty to almost none, and watch the tasks give way. The program
# has an answer all the same, since a leg may always yield: what motors cannot do shows as cost, and the robot falls.


# %%
def limited(scale):
    """The solution with the torque limits scaled, and its cost."""
    p = info.program
    motors = jnp.arange(len(p.low)) >= dict(p.blocks)["contact force"]
    middle, half = (p.low + p.high) / 2, scale * (p.high - p.low) / 2
    low, high = jnp.where(motors, middle - half, p.low), jnp.where(motors, middle + half, p.high)
    solution = solve(iw.QuadraticProgram(p.P, p.q, p.C, low, high, p.blocks))
    x = solution.value.x
    return solution, float(x @ p.P @ x / 2 + p.q @ x)


scales = np.linspace(1.0, 0.02, 25)
answers, costs = zip(*map(limited, scales))
assert all(answer.status == iw.Status.CONVERGED for answer in answers)
figure, axis = plt.subplots(figsize=(7, 3), layout="constrained")
axis.plot(100 * scales, np.array(costs) - costs[0], "o-", ms=3)
axis.set(xlabel="share of the motors' limits [%]", ylabel="cost above the free optimum")
axis.invert_xaxis()
plt.show()

# %% [markdown]
# ## Try
#
# - Set `SPEED` to 0.35: which motor comes nearest to its limit, and when?
# - `iw.walk("straight", solver="admm")`: the same walk by another method; `sensors="nominal"` walks on the estimate.
# - Which rows press, and how hard? The multipliers say so; here with the limits at a fifth.

# %%
names = [
    f"{point} {row}"
    for point in ("right toe", "right heel", "left toe", "left heel")
    for row in ("+x", "-x", "+y", "-y", "z")
]
names += [f"limit of {name}" for name in robot.motor_names[:10]]
multipliers = np.asarray(limited(0.2)[0].value.y)
for row in np.flatnonzero(np.abs(multipliers) > 1e-3):
    print(f"{names[row]:20} {multipliers[row]:+9.2f}")
