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
# # From a depth image to a distance field, and back
#
# What stands in the way, and how far is it? A depth image says so pixel by pixel; a planner wants it on the floor, in
# metres. This notebook goes there in four steps (points, floor, cells, distances) and then the other way: with the
# soft map, a distance on the floor has a derivative in every depth pixel.
#
# A pixel $(u, v)$ of depth $z$ lies at $p_{base} = t + R_{base,camera}\,z\,[(u - c_x)/f_x,\,(v - c_y)/f_y,\,1]^T$. With
# $O$ the occupied cells, the signed distance of a cell is $d(x) = \min_{j \in O}\|x - x_j\|$ outside, and minus the
# distance to the nearest free cell inside, less half a cell each, so that it is zero on the border.

# %%
import iwalker_jax as iw

iw.configure_runtime()  # before JAX: compiler flags and the cache of compiled programs

# %%
import time

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from iwalker_jax.perception import backproject, clean_depth, fit_floor, sample_smooth
from iwalker_jax.scenes import DepthNoise, add_depth_noise, render_depth, world_camera_pose
from iwalker_jax.tasks import named_task

# %% tags=["parameters"]
SCENE = "factory"  # or corridor, office
DESCENT_STEPS = 600

# %% [markdown]
# ## A depth image
#
# Rendered from a generated scene, with the errors of a real stereo camera: lost pixels, false edges, disparity rounded
# to steps. `iw.read_depth(file, intrinsics)` gives the same from a 16-bit PNG of yours.

# %%
camera, mount = iw.Intrinsics(), iw.CameraMount().as_array()  # 160 x 90 px; height, pitch, roll, forward, left
task = named_task(SCENE)
pose = world_camera_pose(jnp.asarray(task.start), mount)
ideal = render_depth(task.scene.arrays(), camera, *pose)
noisy = add_depth_noise(jax.random.key(0), ideal, DepthNoise(), camera)
depth = clean_depth(noisy)  # 0: no return, too far, or a lone speckle

plt.rcParams.update({"figure.dpi": 80, "image.interpolation": "nearest"})
DEPTH, GREEN = plt.get_cmap("viridis_r", 24), plt.get_cmap("RdYlGn", 20)
figure, axes = plt.subplots(1, 3, figsize=(11, 2.4), layout="constrained")
for axis, title, image in zip(axes, ("ideal", "as the camera gives it", "cleaned"), (ideal, noisy, depth)):
    drawn = axis.imshow(np.where(np.asarray(image) > 0, image, np.nan), cmap=DEPTH, vmin=0, vmax=6)
    axis.set(title=title, xticks=[], yticks=[])
figure.colorbar(drawn, ax=axes, label="depth [m], white: none")
plt.show()

# %% [markdown]
# ## Points, and the floor they stand on
#
# Where the camera is mounted can be read off the floor: $1/z$ of a plane is linear in the pixel, so the fit is linear
# least squares.

# %%
floor = fit_floor(depth, camera)
print("        height [m]  pitch [deg]  roll [deg]")
for name, (height, pitch, roll) in (("true", mount[:3]), ("fitted", (floor.height, floor.pitch, floor.roll))):
    print(f"{name:8}{float(height):10.3f} {float(jnp.rad2deg(pitch)):12.2f} {float(jnp.rad2deg(roll)):11.2f}")
points = np.asarray(backproject(depth, camera, mount))[np.asarray(depth) > 0]

figure, (left, right) = plt.subplots(1, 2, figsize=(11, 3.2), layout="constrained")
shown = left.scatter(*points[:, [1, 0]].T, c=points[:, 2], s=2, cmap="coolwarm", vmin=-0.2, vmax=0.8)
left.set(xlabel="y [m], left", ylabel="x [m], ahead", xlim=(4, -4), ylim=(0, 6), aspect="equal", title="from above")
figure.colorbar(shown, ax=left, label="height [m]")
right.hist(points[:, 2], bins=np.arange(-0.3, 1.2, 0.02), color="grey")
right.set(xlabel="height above the floor [m]", ylabel="pixels", title="heights")
plt.show()

# %% [markdown]
# ## Cells and distances
#
# One call makes all maps. A cell is occupied, known free, or unknown (hidden, out of view, never measured); unknown
# space does not repel.

# %%
grid = iw.GridSpec()  # 8 m x 8 m, cells of 5 cm
build = jax.jit(lambda image: iw.build_local_map(image, mount, camera, grid))
hard = jax.block_until_ready(build(noisy))
began = time.perf_counter()
for _ in range(20):
    jax.block_until_ready(build(noisy))
print(f"{(time.perf_counter() - began) / 20 * 1e3:.1f} ms a map")


def draw(axis, values, title, **style):
    """A map seen from above, ahead up and left to the left."""
    extent = (grid.y_max, grid.y_min, grid.x_min, grid.x_max)
    drawn = axis.imshow(np.asarray(values)[::-1, ::-1], extent=extent, **style)
    axis.set(title=title, xlabel="y [m], left", ylabel="x [m], ahead")
    return drawn


figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
kinds = np.where(hard.occupied, 0.0, np.where(hard.unknown, 0.6, 1.0))
draw(left, kinds, "occupied (black), unknown, free", cmap="gray")
drawn = draw(right, hard.esdf, "signed distance", cmap=GREEN, vmin=-1, vmax=1)
figure.colorbar(drawn, ax=right, label="[m]", extend="both")
plt.show()

# %% [markdown]
# ## A derivative in the depth
#
# An occupied cell is a decision, so the derivative of `esdf` is zero. `soft=iw.SoftOccupancy()` makes every decision
# gradual: point $k$ counts with a weight $w_k(\text{height})$ that is shared among four cells; cell $j$ gets a mass,
# the mean place $q_j$ of what lies in it and a degree of occupancy $o_j$, and
#
# $$d(x) = \min_j \|x - q_j\| + \text{penalty}\,(1/o_j - 1) - \text{half a cell}.$$
#
# Which pixels say how far the nearest thing is from a place on the floor?


# %%
def clearance(image, place, soft=iw.SoftOccupancy()):
    """Distance [m] of the nearest obstacle from a place (x, y) [m]."""
    return sample_smooth(iw.build_local_map(image, mount, camera, grid, soft=soft).esdf, grid, place)


open_floor = np.where(np.asarray(hard.known_free), np.asarray(hard.esdf), -np.inf)
rows, columns = np.nonzero((open_floor > 0.3) & (open_floor < 0.5))
nearest = np.argmin((rows - 45) ** 2 + (columns - 80) ** 2)  # near 1.5 m ahead
place = jnp.array(
    [
        grid.x_min + grid.resolution * (rows[nearest] + 0.5),
        grid.y_min + grid.resolution * (columns[nearest] + 0.5),
    ]
)
slope = jax.jit(jax.grad(clearance))
sensitivity = slope(depth, place)
hard_slope = jax.grad(lambda image: clearance(image, place, None))(depth)
print(f"at {np.round(place, 2)} m: clearance {float(clearance(depth, place)):.3f} m")
print(f"hard map: largest derivative {float(jnp.abs(hard_slope).max()):g}")
print(f"soft map: {int((sensitivity != 0).sum())} pixels matter; all 1 m farther: {float(sensitivity.sum()):+.2f} m")

figure, (left, right) = plt.subplots(1, 2, figsize=(11, 3), layout="constrained")
left.imshow(np.where(np.asarray(depth) > 0, depth, np.nan), cmap=plt.get_cmap("gray_r", 24), vmin=0, vmax=6)
pixels = np.argwhere(np.asarray(sensitivity) != 0)
values = np.asarray(sensitivity)[tuple(pixels.T)]
most = np.abs(values).max()
style = {"cmap": "coolwarm", "vmin": -most, "vmax": most, "s": 14, "edgecolors": "k", "lw": 0.3}
shown = left.scatter(pixels[:, 1], pixels[:, 0], c=values, **style)
left.set(title="pixels that the clearance feels", xticks=[], yticks=[])
figure.colorbar(shown, ax=left, label="d clearance / d depth [m/m]")
draw(right, hard.esdf, "where", cmap=GREEN, vmin=-1, vmax=1)
right.plot(float(place[1]), float(place[0]), "k*", ms=12)
right.set(xlim=(2, -2), ylim=(0, 4))
plt.show()

# %% [markdown]
# Against central differences: move all these pixels together along the gradient.

# %%
direction = sensitivity / jnp.linalg.norm(sensitivity)
print("step [mm]   differences   derivative")
along = float(jnp.vdot(sensitivity, direction))
differences = {}
for size in (0.02, 0.005, 0.001):
    ahead, behind = (float(clearance(depth + sign * size * direction, place)) for sign in (1, -1))
    differences[size] = (ahead - behind) / (2 * size)
    print(f"{1e3 * size:9.0f} {differences[size]:13.4f} {along:12.4f}")

# %% [markdown]
# ## Pull a path off an obstacle
#
# The same field moves paths: descend a penalty on clearance below 0.7 m along a straight path.

# %%
soft = iw.build_local_map(depth, mount, camera, grid, soft=iw.SoftOccupancy())
straight = jnp.linspace(jnp.array([0.3, 0.0]), jnp.array([2.6, 0.0]), 40)


def path_cost(path):
    """Squared shortfall of clearance, and the path's own stiffness."""
    shortfall = jnp.maximum(0.7 - sample_smooth(soft.esdf, grid, path), 0.0)
    return jnp.sum(shortfall**2) + 0.5 * jnp.sum(jnp.diff(path, n=2, axis=0) ** 2)


def step(path, _):
    """One step of descent; the ends stay."""
    change = jax.grad(path_cost)(path)
    return path - 0.04 * change.at[jnp.array([0, -1])].set(0.0), path_cost(path)


path, costs = jax.jit(lambda: jax.lax.scan(step, straight, None, length=DESCENT_STEPS))()
figure, axis = plt.subplots(figsize=(5, 4), layout="constrained")
drawn = draw(axis, soft.esdf, f"cost {float(costs[0]):.3f} to {float(costs[-1]):.3f}", cmap=GREEN, vmin=-1, vmax=1)
axis.plot(straight[:, 1], straight[:, 0], "k--", label="straight")
axis.plot(path[:, 1], path[:, 0], "b", lw=2, label="descended")
axis.set(xlim=(2, -2), ylim=(0, 4))
axis.legend()
figure.colorbar(drawn, ax=axis, label="signed distance [m]", extend="both")
plt.show()

# %% [markdown]
# ## Try
#
# - `jax.grad` of the clearance in the *mount*: by how much does a camera pitched 1 degree wrong move the wall?
# - `iw.SoftOccupancy(height_ramp=0.005)`: what do smaller ramps do to the derivative?
# - `iw.cost_to_go` on the soft field, and its derivative in the depth image.


# %%
def clearance_by_mount(mount):
    """The same distance [m] for another mount."""
    return sample_smooth(iw.build_local_map(depth, mount, camera, grid, soft=iw.SoftOccupancy()).esdf, grid, place)


in_mount = jax.grad(clearance_by_mount)(mount)
print(f"{np.deg2rad(1.0) * 1e3 * float(in_mount[1]):+.1f} mm of clearance per degree of pitch")
