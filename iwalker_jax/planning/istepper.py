"""iStepper: the three-layer network that turns a path and the robot's state into footsteps."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Float

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import arc_length, interpolate_along
from iwalker_jax.planning.footsteps import nominal_footsteps
from iwalker_jax.planning.robot_state import RobotState, StepGeometry


@dataclass(frozen=True)
class IStepperConfig:
    """Size of the iStepper network.

    Attributes:
        hidden: units of each of the two hidden layers.
        path_points: points of the path ahead that the network sees, evenly spaced by arc length.
        correction: [m] largest departure from the nominal footstep along each axis of the path frame.
    """

    hidden: int = 256
    path_points: int = 16
    correction: float = 0.15

    def __post_init__(self) -> None:
        if not (1 <= self.hidden <= 65_536 and 2 <= self.path_points <= 1000 and 0 < self.correction <= 1):
            raise InputError("iStepper needs 1 to 65536 hidden units, 2 to 1000 path points, a correction in (0, 1] m.")


class IStepper(nnx.Module):
    """Path + robot state -> footsteps, as corrections of the nominal footsteps in the path's own frame."""

    def __init__(self, config: IStepperConfig, geometry: StepGeometry, rngs: nnx.Rngs) -> None:
        self.config, self.geometry = config, geometry
        features = 2 * config.path_points + 1 + 5
        self.layer1 = nnx.Linear(features, config.hidden, rngs=rngs)
        self.layer2 = nnx.Linear(config.hidden, config.hidden, rngs=rngs)
        self.layer3 = nnx.Linear(config.hidden, 2 * geometry.count, rngs=rngs)

    def __call__(self, path: Float[Array, "batch n 2"], state: RobotState) -> Float[Array, "batch m 2"]:
        """Footsteps [m] in the base frame; `footstep_signs` says which are left.

        Args:
            path: points [m] in the base frame, starting at the robot.
            state: robot states with a leading batch axis.
        """
        return jax.vmap(self._one)(path, state)

    def _one(self, path: Float[Array, "n 2"], state: RobotState) -> Float[Array, "m 2"]:
        footsteps, tangents = nominal_footsteps(path, state.stance_sign, self.geometry)
        hidden = jax.nn.relu(self.layer1(self._features(path, state)))
        hidden = jax.nn.relu(self.layer2(hidden))
        correction = jnp.tanh(self.layer3(hidden)).reshape(-1, 2) * self.config.correction
        outward = state.stance_sign * jnp.stack([-tangents[:, 1], tangents[:, 0]], axis=-1)
        return footsteps + correction[:, :1] * tangents + correction[:, 1:] * outward

    def _features(self, path: Float[Array, "n 2"], state: RobotState) -> Float[Array, " features"]:
        """Path ahead [m] and the state, each scaled to order one; lateral values from the stance foot's view.

        Multiplying every lateral quantity by the stance side makes left and right stance one problem: the network is
        exactly mirror-equivariant.
        """
        lengths = arc_length(path)
        reach = self.geometry.length * self.geometry.count
        ahead = interpolate_along(lengths, path, jnp.linspace(0.0, reach, self.config.path_points, dtype=path.dtype))
        view = jnp.stack([jnp.ones_like(state.stance_sign), state.stance_sign])
        return jnp.concatenate(
            [
                (ahead * view).reshape(-1),
                jnp.minimum(lengths[-1:], reach),
                state.com_from_stance * view * 10.0,
                state.com_velocity * view * 3.0,
                state.time_in_step[None] * 4.0,
            ]
        )
