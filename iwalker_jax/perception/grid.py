"""The local map's grid: where its cells lie in the robot's ground frame."""

from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.checks import require_numbers, require_plain_numbers
from iwalker_jax.errors import InputError


@dataclass(frozen=True)
class GridSpec:
    """A regular grid in the `base` frame (origin on the floor below the robot, x forward, y left).

    Cell (i, j) has its centre at (x_min + (i + 1/2) resolution, y_min + (j + 1/2) resolution): the first map index
    runs forward, the second to the left.

    Attributes:
        x_min: [m] rear edge of the map.
        y_min: [m] right edge of the map.
        resolution: [m] side of a cell.
        rows: number of cells forward.
        columns: number of cells to the left.
    """

    x_min: float = -0.8
    y_min: float = -4.0
    resolution: float = 0.05
    rows: int = 160
    columns: int = 160

    def __post_init__(self) -> None:
        require_numbers(self)
        if not self.resolution > 0 or self.rows < 2 or self.columns < 2:
            raise InputError(
                f"GridSpec needs resolution > 0 and at least 2 x 2 cells, got {self.resolution} m and "
                f"{self.rows} x {self.columns}."
            )
        require_plain_numbers(self)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.rows, self.columns

    @property
    def x_max(self) -> float:
        """[m] front edge of the map."""
        return self.x_min + self.rows * self.resolution

    @property
    def y_max(self) -> float:
        """[m] left edge of the map."""
        return self.y_min + self.columns * self.resolution

    def cell_coordinates(self, points_xy: Float[Array, "*batch 2"]) -> Float[Array, "*batch 2"]:
        """Continuous cell coordinates of points [m]; a cell's centre has integer coordinates."""
        origin = jnp.asarray([self.x_min, self.y_min], points_xy.dtype)
        return (points_xy - origin) / self.resolution - 0.5

    def centres(self) -> Float[Array, "rows columns 2"]:
        """Cell centres [m] in the base frame."""
        x = self.x_min + (jnp.arange(self.rows) + 0.5) * self.resolution
        y = self.y_min + (jnp.arange(self.columns) + 0.5) * self.resolution
        return jnp.stack(jnp.meshgrid(x, y, indexing="ij"), axis=-1)


DEFAULT_GRID = GridSpec()
"""8 m x 8 m in 5 cm cells: the body is 0.25 m wide, so 10 cm cells would hide a third of a doorway."""

PUBLISHED_GRID = GridSpec(x_min=0.0, y_min=-5.0, resolution=0.1, rows=100, columns=100)
"""The paper's 10 m x 10 m grid in 10 cm cells with the robot at the bottom centre."""


def halved(grid: GridSpec) -> GridSpec:
    """The grid with cells twice as large, over the same ground (an odd last row or column is dropped)."""
    return GridSpec(grid.x_min, grid.y_min, 2 * grid.resolution, grid.rows // 2, grid.columns // 2)


def pool_2x2(field: Float[Array, "rows columns"]) -> Float[Array, "half_rows half_columns"]:
    """Mean of every 2 x 2 block: the field on the `halved` grid."""
    rows, columns = field.shape[0] // 2, field.shape[1] // 2
    return field[: 2 * rows, : 2 * columns].reshape(rows, 2, columns, 2).mean(axis=(1, 3))


def softened(field: Float[Array, "rows columns"]) -> Float[Array, "rows columns"]:
    """Mean of each cell and its eight neighbours: single unseen cells vanish, and borders become slopes."""
    padded = jnp.pad(field, 1, mode="edge")
    rows, columns = field.shape
    shifts = [padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)]
    return jnp.mean(jnp.stack(shifts), axis=0)
