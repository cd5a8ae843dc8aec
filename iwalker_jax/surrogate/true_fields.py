"""What is true of generated scenes, once a scene: the distance to obstacles, and what it costs to walk to some goals.

A planner that is trained by these needs no labels, and no map of its own could judge it better: what it did not see
is as solid as what it saw.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float16

from iwalker_jax.checks import require_whole
from iwalker_jax.errors import InputError
from iwalker_jax.perception import GridSpec, TraversalParameters, cost_to_go, traversal_cost
from iwalker_jax.scenes import FAMILIES, SMALL, Scene, SceneArrays, generate_scene, obstacle_distance, stack_scenes

_ROWS = 16  # scenes measured at a time
_LARGEST = 6e4  # the largest cost that half precision holds


@dataclass(frozen=True)
class FieldParameters:
    """Grids and goals of the true fields.

    Attributes:
        extent: [m] side of the square that the grids cover; larger scenes are left out.
        resolution: [m] of the distances; cost_resolution: [m] of the costs.
        goals: of a scene.
        goal_clearance: [m] of every goal.
        traversal: cost of a metre; finite in obstacles, so that it leads out of them. Wider than the body: paths are
            followed to a few centimetres.
    """

    extent: float = 12.8
    resolution: float = 0.05
    cost_resolution: float = 0.1
    goals: int = 4
    goal_clearance: float = 0.3
    traversal: TraversalParameters = TraversalParameters(body_radius=0.22, comfort=0.50)

    def __post_init__(self) -> None:
        if not (0 < self.resolution <= self.cost_resolution < self.extent and self.extent <= SMALL.extent):
            raise InputError(f"FieldParameters needs 0 < resolution <= cost_resolution < extent <= {SMALL.extent} [m].")
        require_whole(self.goals, "FieldParameters.goals")
        if not 1 <= self.goals <= 1000 or not self.goal_clearance > 0:
            raise InputError("FieldParameters needs 1 to 1000 goals and a positive goal_clearance [m].")

    @property
    def grid(self) -> GridSpec:
        """Of the distances, from the lower corner of a scene's bounds."""
        return _square(self.extent, self.resolution)

    @property
    def cost_grid(self) -> GridSpec:
        """Of the costs, from the same corner."""
        return _square(self.extent, self.cost_resolution)


class TrueFields(NamedTuple):
    """Scenes and what is true of them; a pytree.

    Attributes:
        scenes: the scene axis first.
        clearance: (scenes, n, n) [m] in plan view to what stands in the way or ends the floor.
        goals: (scenes, goals, 2) [m] world.
        to_go: (scenes, goals, m, m) cost [m] of the best way to each goal.
    """

    scenes: SceneArrays
    clearance: Float16[Array, "scenes n n"]
    goals: Float[Array, "scenes goals 2"]
    to_go: Float16[Array, "scenes goals m m"]


def make_fields(count: int, seed: int, parameters: FieldParameters = FieldParameters()) -> TrueFields:
    """The fields of so many scenes of the training families; the same seed gives the same scenes.

    Raises:
        InputError: for a count below 1.
    """
    if count < 1:
        raise InputError(f"Ask for at least one scene, not {count}.")
    rng = np.random.default_rng(seed)
    parts = []
    for first in range(0, count, _ROWS):
        # Always as many scenes at a time: one compiled program.
        scenes = [_fitting_scene(rng, parameters.extent) for _ in range(_ROWS)]
        part = _fields_of(scenes, rng, parameters)
        parts.append(jax.tree.map(lambda leaf: leaf[: count - first], part))  # noqa: B023  # used at once
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *parts)


def sample_fields(
    fields: Float[Array, "fields n n"], index: Array, points: Float[Array, "*batch 2"], resolution: float
) -> Float[Array, "*batch"]:
    """Bilinear sample of one of many square fields; differentiable in the points.

    As `sample_bilinear` with `clamp`, but four cells of a point are gathered instead of a field a robot.

    Args:
        fields: the fields.
        index: () int32, which of them.
        points: [m] from the field's lower corner; outside, the border's values go on.
        resolution: [m] of its cells.
    """
    most = fields.shape[-1] - 1
    at = jnp.clip(points / resolution - 0.5, 0.0, most)
    low = jnp.clip(jnp.floor(at), 0, most - 1).astype(jnp.int32)
    share = at - low

    def corner(i: int, j: int) -> Array:
        return fields[index, low[..., 0] + i, low[..., 1] + j].astype(points.dtype)

    along, across = share[..., 0], share[..., 1]
    near = corner(0, 0) * (1 - along) + corner(1, 0) * along
    far = corner(0, 1) * (1 - along) + corner(1, 1) * along
    return near * (1 - across) + far * across


def _fitting_scene(rng: np.random.Generator, extent: float) -> Scene:
    while True:
        scene = generate_scene(FAMILIES[rng.integers(len(FAMILIES))], int(rng.integers(2**31)))
        x_min, y_min, x_max, y_max = scene.bounds
        if max(x_max - x_min, y_max - y_min) <= extent:
            return scene


def _fields_of(scenes: list[Scene], rng: np.random.Generator, parameters: FieldParameters) -> TrueFields:
    arrays = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), stack_scenes(scenes, SMALL))
    clearance = np.asarray(_clearances(arrays, parameters))
    corners = np.asarray(arrays.bounds)[:, :2]
    goals = np.zeros((len(scenes), parameters.goals, 2), np.float32)
    for row, corner in enumerate(corners):
        roomy = np.argwhere(clearance[row] > parameters.goal_clearance)
        goals[row] = corner + (roomy[rng.integers(len(roomy), size=parameters.goals)] + 0.5) * parameters.resolution
    costs = np.minimum(np.asarray(_costs(arrays, jnp.asarray(goals), parameters)), _LARGEST)
    half = (jnp.asarray(leaf, jnp.float16) for leaf in (clearance, costs))
    return TrueFields(arrays, next(half), jnp.asarray(goals), next(half))


def _clearance(scene: SceneArrays, grid: GridSpec) -> Float[Array, "rows columns"]:
    points = grid.centres() + scene.bounds[:2]
    to_edge = jnp.minimum(points - scene.bounds[:2], scene.bounds[2:] - points).min(axis=-1)
    return jnp.minimum(obstacle_distance(scene, points), to_edge)


@jax.jit(static_argnums=1)
def _clearances(scenes: SceneArrays, parameters: FieldParameters) -> Float[Array, "scenes n n"]:
    return jax.vmap(lambda scene: _clearance(scene, parameters.grid))(scenes)


@jax.jit(static_argnums=2)
def _costs(
    scenes: SceneArrays, goals: Float[Array, "scenes goals 2"], parameters: FieldParameters
) -> Float[Array, "scenes goals m m"]:
    grid = parameters.cost_grid

    def of_scene(scene: SceneArrays, goals: Float[Array, "goals 2"]) -> Array:
        clearance = _clearance(scene, grid)
        cost = traversal_cost(clearance, jnp.zeros_like(clearance), parameters.traversal)
        return jax.vmap(lambda goal: cost_to_go(cost, goal - scene.bounds[:2], grid).value.cost)(goals)

    return jax.vmap(of_scene)(scenes, goals)


def _square(extent: float, resolution: float) -> GridSpec:
    cells = round(extent / resolution)
    return GridSpec(0.0, 0.0, resolution, cells, cells)
