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
# # Bring your own camera and recording
#
# The planner was trained for one camera: 160 x 90 pixels, a focal length of 80 px, 0.58 m above the floor. Yours has
# another lens, hangs elsewhere and leans. Nothing need be trained again: images are re-projected, the floor in them
# says where the camera is, and a folder of 16-bit PNGs with one small file is a data set. This notebook makes such a
# folder, as a camera of other make would, breaks a file in it, and goes from there to plans and training frames.
#
# A pixel $u$ of the planner's camera shows what pixel $u' = f'_x\,(u - c_x)/f_x + c'_x$ of yours saw (likewise $v$);
# z-depth stays the same, and nothing is averaged, which would invent surfaces in mid-air. On a floor with unit normal
# $n$ at height $h$ below the camera, $1/z = n^T r / h$ for a ray $r = [(u - c_x)/f_x, (v - c_y)/f_y, 1]^T$: linear, so
# height, pitch and roll come from linear least squares.

# %%
import iwalker_jax as iw

iw.configure_runtime()  # before JAX: compiler flags and the cache of compiled programs

# %%
import shutil
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from iwalker_jax.data import frames_from_recording, validate_recording
from iwalker_jax.perception import clean_depth, fit_floor
from iwalker_jax.scenes import DepthNoise, add_depth_noise, render_depth, world_camera_pose
from iwalker_jax.tasks import named_task

# %% tags=["parameters"]
IMAGES = 12  # of the recording
FOLDER = Path("runs/recording")

# %% [markdown]
# ## A camera of another make
#
# Pretend that this is yours: VGA, a narrower lens, mounted higher, pitched by 19 and rolled by 10 degrees, carried
# towards the goal of the office demonstration. With your own recording, skip this cell and point `FOLDER` at it.

# %%
yours = iw.Intrinsics(640, 480, 383.8, 383.8, 321.7, 236.8)
hung = iw.CameraMount(height=0.62, pitch=np.deg2rad(18.9), roll=np.deg2rad(10.4))
task = named_task("office")
ahead = np.array([np.cos(task.start[2]), np.sin(task.start[2])])


@jax.jit
def view(pose, key):
    """What your camera sees from a base pose (x, y, yaw), errors and all."""
    ideal = render_depth(task.scene.arrays(), yours, *world_camera_pose(pose, hung.as_array()))
    return add_depth_noise(key, ideal, DepthNoise(), yours)


shutil.rmtree(FOLDER, ignore_errors=True)
lines = []
for k in range(IMAGES):
    x, y = np.array(task.start[:2]) + 0.06 * k * ahead
    iw.write_depth(FOLDER / "depth" / f"{k:06d}.png", view(jnp.array([x, y, task.start[2]]), jax.random.key(k)))
    lines.append(f"{x:.4f} {y:.4f} {task.start[2]:.4f}")
(FOLDER / "poses.txt").write_text("\n".join(lines) + "\n")
(FOLDER / "recording.yaml").write_text(
    """\
intrinsics: {width: 640, height: 480, fx: 383.8, fy: 383.8, cx: 321.7, cy: 236.8}
depth_scale: 0.001   # metres per unit
poses: poses.txt     # x y yaw of every image [m, m, rad]; may be left out
"""
)
damaged = FOLDER / "depth" / "000001.png"
damaged.write_bytes(damaged.read_bytes()[:2000])  # a copy that broke off
print(*sorted(str(file.relative_to(FOLDER)) for file in FOLDER.rglob("*") if file.is_file())[:5], "...", sep="\n")

# %% [markdown]
# ## What is usable?
#
# `python -m experiments.validate_recording FOLDER` says the same. No mount is written down, so the floor is fitted in
# every image.

# %%
report = validate_recording(FOLDER)
print(f"{report.layout}: {len(report.usable)} of {report.found} images usable")
for problem in report.problems:
    print(f"problem: {problem.file} {problem.problem}")
for assumption in report.assumptions:
    print("assumed:", assumption)
height, pitch, roll, *_ = report.mount or (np.nan,) * 5
print(f"fitted: {height:.3f} m high, pitched {np.rad2deg(pitch):.1f} deg, rolled {np.rad2deg(roll):.1f} deg")
print("true:   0.620 m high, pitched 18.9 deg, rolled 10.4 deg")

# %% [markdown]
# ## As the planner sees it

# %%
file = FOLDER / "depth" / "000000.png"
stored = iw.read_depth(file, camera=yours)  # in your camera's pixels
seen = iw.read_depth(file, yours)  # in the planner's
floor = fit_floor(clean_depth(seen), iw.Intrinsics())
print(
    f"from the re-projected image: {float(floor.height):.3f} m, {float(jnp.rad2deg(floor.pitch)):.1f} deg, "
    f"{float(jnp.rad2deg(floor.roll)):.1f} deg; {100 * float(floor.inlier_fraction):.0f} % of the pixels are floor"
)

style = {"cmap": plt.get_cmap("viridis_r", 24), "vmin": 0, "vmax": 6, "interpolation": "nearest"}
figure, axes = plt.subplots(1, 2, figsize=(10, 3.1), layout="constrained")
for axis, image, title in zip(axes, (stored, seen), ("yours, 640 x 480", "the planner's, 160 x 90: a wider view")):
    drawn = axis.imshow(np.where(image > 0, image, np.nan), **style)
    axis.set(title=title, xlabel="u [px]", ylabel="v [px]")
figure.colorbar(drawn, ax=axes, label="depth [m], white: none")
plt.show()

# %% [markdown]
# ## Plan
#
# The mount matters: with the nominal one the leaning floor looks like a ramp on one side, and the goal's bearing in the
# image is wrong.

# %%
planner = iw.load_planner()
goal = (2.5, 0.0)  # [m] ahead
plans = {"nominal mount": planner(seen, goal), "fitted mount": planner(seen, goal, mount=floor.mount())}
grid = iw.GridSpec()
figure, axes = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
for axis, (name, plan), mount in zip(axes, plans.items(), (iw.CameraMount().as_array(), floor.mount())):
    local_map = iw.build_local_map(seen, mount, iw.Intrinsics(), grid)
    kinds = np.where(local_map.occupied, 0.0, np.where(local_map.unknown, 0.7, 1.0))[::-1, ::-1]
    extent = (grid.y_max, grid.y_min, grid.x_min, grid.x_max)
    axis.imshow(kinds, cmap="gray", extent=extent, vmin=0, vmax=1, interpolation="nearest")
    axis.plot(plan.path[:, 1], plan.path[:, 0], lw=2, label="path")
    axis.plot(plan.footsteps[:, 1], plan.footsteps[:, 0], "C1.", label="footsteps")
    axis.plot(goal[1], goal[0], "r*", ms=12, label="goal")
    axis.set(title=name, xlabel="y [m], left", ylabel="x [m], ahead", xlim=(2.5, -2.5), ylim=(-0.5, 4))
axes[0].legend(fontsize=8, loc="upper left")
plt.show()

# %% [markdown]
# ## Train on it
#
# Frames of a recording are what the training takes. Goals are drawn where an image itself shows free ground that can be
# reached; with poses the first is where the recording ends.

# %%
said: list[str] = []
frames = frames_from_recording(FOLDER, say=said.append)
print(
    f"{len(frames)} frames of {frames.depth.shape[2]} x {frames.depth.shape[1]} px, {frames.goals.shape[1]} goals each"
)
(x, y), (x_last, y_last) = frames.goals[[0, -1], 0]
print(f"first goal [m]: ({x:.2f}, {y:.2f}) in the first frame, ({x_last:.2f}, {y_last:.2f}) in the last: it is there")

# %% [markdown]
# ## Try
#
# - `python -m experiments.train --data runs/recording --start-from runs/default --learning-rate 1e-4` fine-tunes on it.
# - TUM RGB-D and iPlanner folders are recognised as they are.
# - Write the wrong `depth_scale`. What does the validator say?

# %%
text = (FOLDER / "recording.yaml").read_text()
(FOLDER / "recording.yaml").write_text(text.replace("0.001", "0.0002"))
print(validate_recording(FOLDER).fatal)
