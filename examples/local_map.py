"""Maps from one depth image: occupied, free, unknown, distance field: python examples/local_map.py [--out FOLDER]."""

from pathlib import Path

import iwalker_jax as iw

iw.configure_runtime()

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from matplotlib.figure import Figure

from iwalker_jax.scenes import render_depth, world_camera_pose
from iwalker_jax.tasks import named_task


def main(out: Path = Path("runs/examples")) -> None:
    """Build the map of the factory demonstration's first view and draw it."""
    task, mount, camera = named_task("factory"), iw.CameraMount().as_array(), iw.Intrinsics()
    depth = render_depth(task.scene.arrays(), camera, *world_camera_pose(jnp.asarray(task.start), mount))
    grid = iw.GridSpec()
    local_map = jax.jit(lambda image: iw.build_local_map(image, mount, camera, grid))(depth)
    for name in ("occupied", "known_free", "unknown"):
        print(f"{name}: {100 * float(getattr(local_map, name).mean()):.1f} % of {grid.rows} x {grid.columns} cells")
    print(f"clearance at the robot: {float(local_map.esdf[int(-grid.x_min / grid.resolution), 80]):.2f} m")

    figure = Figure(figsize=(14, 4.2), layout="compressed")
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.8, 1, 1))
    left.imshow(depth, cmap="viridis_r", vmin=0, vmax=6)
    left.set_title("depth [m]")
    kinds = np.where(local_map.occupied, 0.0, np.where(local_map.unknown, 0.6, 1.0))
    for axis, title, values, colours in (
        (middle, "occupied, unknown, free", kinds, "gray"),
        (right, "signed distance, up to 1 m", np.clip(local_map.esdf, -0.3, 1.0), "RdYlGn"),
    ):
        axis.imshow(values[::-1, ::-1], cmap=colours, extent=(grid.y_max, grid.y_min, grid.x_min, grid.x_max))
        axis.set_title(title)
        axis.set_xlabel("y [m], left")
        axis.set_ylabel("x [m], ahead")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "local_map.png", dpi=100)
    print(f"The picture is {out / 'local_map.png'}.")


if __name__ == "__main__":
    tyro.cli(main)
