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
# # The closed loop, and what the robot saw
#
# A plan for one image is not yet a robot that arrives. Here the whole loop runs, camera to torque: a noisy depth image
# 15 times a second, a remembered map, a path, footsteps, torques and contacts at 500 Hz, on the robot's own estimate of
# where it is. What it saw and remembered is kept and shown beside what was true.
#
# A success weighs the way that was walked (SPL, Anderson et al. 2018): $\text{SPL} = \frac1N\sum_i S_i\,\frac{l_i}
# {\max(l_i, p_i)}$, with $S_i$ whether episode $i$ stood at its goal, $p_i$ the way walked and $l_i$ the shortest one.

# %%
import iwalker_jax as iw

iw.configure_runtime()  # before JAX: compiler flags and the cache of compiled programs

# %%
import dataclasses

import matplotlib.pyplot as plt
import numpy as np

from iwalker_jax.evaluation.episodes import draw_episode
from iwalker_jax.navigation import MapMemoryParameters
from iwalker_jax.planning import MapCell
from iwalker_jax.tasks import named_task

# %% tags=["parameters"]
TASK = "office"  # or factory, corridor, test_office, room_gap_45, ...
TIME_LIMIT = None  # [s] the task's own
FRAMES = 4  # shown of what the robot saw

# %% [markdown]
# ## Run it
#
# `iw.run_episodes` takes names of tasks or a `Task` with a scene of your own, and several at once.

# %%
task = named_task(TASK)
if TIME_LIMIT is not None:
    task = dataclasses.replace(task, time_limit=TIME_LIMIT)
result = iw.run_episodes(task, images=True)
record, metrics = result.records[0], result.metrics[0]
print(f"{task.name}: {metrics.outcome.word} after {metrics.seconds:.1f} s and {metrics.walked:.2f} m")
print(
    f"least clearance {100 * metrics.clearance:.1f} cm, largest torque {100 * metrics.torque_peak:.0f} % of its limit"
)

# %% [markdown]
# ## The way
#
# Seen from above, the way coloured by time; feet are the small dots, the last path is light blue.

# %%
figure, axis = plt.subplots(figsize=(9, 4.6), layout="constrained")
line = draw_episode(axis, task, record, by_time=True)
axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title=f"{task.name}: {metrics.outcome.word}")
figure.colorbar(line, ax=axis, label="time [s]", shrink=0.7)
plt.show()

# %% [markdown]
# ## What it saw
#
# Above the depth image of a frame as the planner got it, below the remembered map around where the robot believed to
# be, with the planned path.

# %%
memory = MapMemoryParameters()
half = memory.resolution * memory.cells / 2  # [m] from the middle of the map's window to its side
shown = np.linspace(0, len(record.time) - 1, FRAMES).round().astype(int)
figure, axes = plt.subplots(2, FRAMES, figsize=(2.9 * FRAMES, 4.6), layout="constrained", squeeze=False)
for (above, below), frame in zip(axes.T, shown):
    depth = record.depth[frame].astype(float)
    style = {"cmap": plt.get_cmap("viridis_r", 24), "vmin": 0, "vmax": 6, "interpolation": "nearest"}
    drawn = above.imshow(np.where(depth > 0, depth, np.nan), **style)
    above.set(title=f"{record.time[frame]:.1f} s", xticks=[], yticks=[])
    cells, (x, y, yaw) = record.cells[frame], record.believed[frame]
    grey = np.select([cells == MapCell.OCCUPIED, cells == MapCell.FREE], [0.0, 1.0], 0.7)
    extent = (x - half, x + half, y - half, y + half)
    below.imshow(grey.T, origin="lower", extent=extent, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    below.plot(*record.path[frame].T, "C0", lw=2)
    below.plot(x, y, marker=(3, 0, np.degrees(yaw) - 90), color="C3", ms=9)
    below.set(xlim=(x - 2.5, x + 2.5), ylim=(y - 2.5, y + 2.5), xlabel="x [m]")
axes[1, 0].set(ylabel="y [m]")
figure.colorbar(drawn, ax=axes[0], label="depth [m]")
plt.show()

# %% [markdown]
# ## What it believed
#
# Visual odometry drifts with the distance walked, so the map and the robot drift together; what counts for walking is
# what lies near.

# %%
drift = np.linalg.norm(record.believed[:, :2] - record.base[:, :2], axis=1)
figure, axes = plt.subplots(3, 1, figsize=(9, 5), sharex=True, layout="constrained")
axes[0].plot(record.time, 100 * drift)
axes[0].set(ylabel="belief off by [cm]")
axes[1].plot(record.time, 100 * record.clearance)
axes[1].set(ylabel="clearance [cm]", ylim=(0, None))
axes[2].plot(record.time, 100 * record.torque_share)
axes[2].set(ylabel="largest torque [%]", xlabel="time [s]", ylim=(0, 100))
plt.show()

# %% [markdown]
# ## Try
#
# - `policy="classical"` or `"networks"`: the same task without the networks, or by them alone.
# - A list of tasks runs as one batch: `iw.run_episodes(["factory", "corridor", "office"])`.
# - `iwalker_jax.navigation.make_faults`: a camera that freezes, odometry that jumps.
# - A film of it: `iwalker_jax.evaluation.episodes.write_film("episode.webm", task, record)`.

# %%
print(f"{len(record.time)} frames, {int(record.qp_failures.sum())} ticks whose QP did not converge")
print(f"{100 * metrics.detours:.0f} % of the frames by the map's own route, SPL {metrics.spl:.2f}")
