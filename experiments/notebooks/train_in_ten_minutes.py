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
# # Train the planner in ten minutes
#
# The planner that ships with the package was trained from nothing but generated scenes, and a small one trains on a
# laptop while coffee is made. No labels: the losses are what two optimisers say of the networks' proposals. This
# notebook makes frames, trains, reads the curves, and looks at plans for views that the training has not met.
#
# With the networks' path $\hat\phi$ and footsteps $\hat S$, and the optima $\phi^\star, S^\star$ of the unicycle MPC
# and the step MPC (iWalker, eqs. 1 to 17),
#
# $$U_{path} = w\,\|\hat\phi - \phi^\star\|^2 + \dots,\qquad U_{step} = w\,\|\hat S - S^\star\|^2 + U_{width} +
# U_{length} + U_{clearance} + \dots,\qquad U = U_{path} + U_{step},$$
#
# and one backward pass goes through both optima, footsteps and path into the vision network. What stands for the dots
# is in `iwalker_jax.training.LossWeights`.

# %%
import iwalker_jax as iw

iw.configure_runtime()  # before JAX: compiler flags and the cache of compiled programs

# %%
import dataclasses
import time
from pathlib import Path

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from iwalker_jax.data import generate_training_frames
from iwalker_jax.scenes import render_depth, world_camera_pose
from iwalker_jax.tasks import named_task
from iwalker_jax.training import TrainConfig, prepare, read_metrics, train

# %% tags=["parameters"]
FRAMES = 600  # depth images, over all families of scenes
EPOCHS = 24  # passes over them
BATCH = 16
RUN = Path("runs/ten_minutes")  # the run's folder

# %% [markdown]
# ## Frames
#
# A camera goes along routes through generated scenes; each frame is a noisy depth image, the camera's mount at that
# moment (it sways as the robot does), and goals that can be reached.

# %%
began = time.perf_counter()
frames = generate_training_frames(FRAMES)
config = dataclasses.replace(TrainConfig(), epochs=EPOCHS, batch_size=BATCH)
data = prepare(frames, config.models.traversal)  # maps and costs-to-go, once for all epochs
print(f"{len(frames)} frames of {len(frames.scene_names)} scenes")

figure, axes = plt.subplots(2, 4, figsize=(11, 3.6), layout="constrained")
for axis, index in zip(axes.flat, np.linspace(0, len(frames) - 1, 8).round().astype(int)):
    image = frames.depth_metres()[index]
    style = {"cmap": plt.get_cmap("viridis_r", 24), "vmin": 0, "vmax": 6, "interpolation": "nearest"}
    drawn = axis.imshow(np.where(image > 0, image, np.nan), **style)
    axis.set(title=frames.scene_names[frames.scene_index[index]], xticks=[], yticks=[])
figure.colorbar(drawn, ax=axes, label="depth [m]")
plt.show()

# %% [markdown]
# ## Train
#
# `train` is the loop behind `python -m experiments.train`: it writes checkpoints and goes on where it was stopped.

# %%
result = train(config, data, RUN, resume=False)
metrics = read_metrics(RUN / "metrics.jsonl")
minutes = (time.perf_counter() - began) / 60
print(f"{len(metrics)} steps of {BATCH} frames")

# %%
names = ("total", "U_path", "U_step")
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.2), width_ratios=(2, 1), layout="constrained")
window = max(1, len(metrics) // 40)
for name in names:
    values = np.array([line[name] for line in metrics])
    left.plot(values, lw=0.4, alpha=0.4, color=f"C{names.index(name)}")
    smooth = np.convolve(values, np.ones(window) / window, "valid")
    left.plot(np.arange(len(smooth)) + window / 2, smooth, color=f"C{names.index(name)}", label=name)
left.set(xlabel="step", ylabel="loss", yscale="log")
left.legend(ncols=3)
right.plot([100 * line["converged"] for line in metrics], lw=0.6)
right.set(xlabel="step", ylabel="rows whose optima converged [%]", ylim=(0, 105))
plt.show()

# %% [markdown]
# Only rows whose optima converged teach: an implicit gradient of an unconverged solve would be wrong without looking
# wrong.
#
# ## Plans for views it has not met
#
# The demonstrations are in no training stream. Beside the new planner, the one that ships with the package, which saw
# more frames for longer.

# %%
planners = {"ten minutes": iw.load_planner(RUN), "shipped": iw.load_planner()}
views = {}
for name in ("factory", "corridor", "office"):
    task = named_task(name)
    pose = world_camera_pose(jnp.asarray(task.start), iw.CameraMount().as_array())
    x, y = np.asarray(task.goals[0]) - task.start[:2]
    yaw = task.start[2]
    goal = np.array([np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x])
    views[name] = np.asarray(render_depth(task.scene.arrays(), iw.Intrinsics(), *pose)), goal

figure, axes = plt.subplots(1, 3, figsize=(11, 4), layout="constrained")
grid, ends = iw.GridSpec(), {}
for axis, (name, (depth, goal)) in zip(axes, views.items()):
    seen = iw.build_local_map(jnp.asarray(depth), iw.CameraMount().as_array(), iw.Intrinsics(), grid)
    kinds = np.where(seen.occupied, 0.0, np.where(seen.unknown, 0.7, 1.0))[::-1, ::-1]
    extent = (grid.y_max, grid.y_min, grid.x_min, grid.x_max)
    axis.imshow(kinds, cmap="gray", extent=extent, interpolation="nearest", vmin=0, vmax=1)
    for (label, planner), colour in zip(planners.items(), ("C1", "C0")):
        plan = planner(depth, goal)
        axis.plot(plan.path[:, 1], plan.path[:, 0], color=colour, lw=2, label=label)
        axis.plot(plan.footsteps[:, 1], plan.footsteps[:, 0], ".", color=colour, ms=4)
        ends[name, label] = np.asarray(plan.path[-1])
    axis.plot(goal[1], goal[0], "r*", ms=12, clip_on=True)
    axis.set(title=name, xlabel="y [m], left", ylabel="x [m], ahead", xlim=(2.5, -2.5), ylim=(-0.5, 5))
axes[0].legend(fontsize=8, loc="upper left")
plt.show()

# %% [markdown]
# ## Try
#
# - `gradient="stopped"` in the configuration: the paper's way. Compare the curves.
# - `iwalker_jax.data.frames_from_recording(folder)` in the place of the generated frames: your own camera.
# - Walk by it: `iw.run_episodes("corridor", run="runs/ten_minutes").outcomes`.
# - The real thing: `python -m experiments.train`, about 20 minutes on 2 cores, with evaluation in unseen scenes.

# %%
print({name: round(value, 3) for name, value in metrics[-1].items() if name in ("total", "U_path", "U_step")})
