"""iStepper: the three-layer network that turns a path, and by default the robot's state, into footsteps."""

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
        hidden: units of the first hidden layer.
        second_hidden: units of the second one; None: as many as the first has.
        path_points: points of the path ahead that the network sees, evenly spaced by arc length.
        robot_state: the network sees where the COM is and how it moves, and corrects nominal footsteps. Without, it
            sees the path's points alone and predicts the footsteps themselves, as published.
        correction: [m] largest departure from the nominal footstep along each axis of the path frame; a network
            without the robot's state starts from no nominal footsteps and has none.
    """

    hidden: int = 256
    second_hidden: int | None = None
    path_points: int = 16
    robot_state: bool = True
    correction: float = 0.15

    def __post_init__(self) -> None:
        second = self.hidden if self.second_hidden is None else self.second_hidden
        units = 1 <= self.hidden <= 65_536 and 1 <= second <= 65_536
        if not (units and 2 <= self.path_points <= 1000 and 0 < self.correction <= 1):
            raise InputError("iStepper needs 1 to 65536 hidden units, 2 to 1000 path points, a correction in (0, 1] m.")

    @classmethod
    def published(cls) -> "IStepperConfig":
        """2N -> 256 -> 512 -> 2N for N = 150 points of the path and as many footsteps (`StepGeometry.published`)."""
        return cls(hidden=256, second_hidden=512, path_points=StepGeometry.published().count, robot_state=False)


class IStepper(nnx.Module):
    """Path + robot state -> footsteps, as corrections of the nominal footsteps in the path's own frame; or, without
    the state, path -> footsteps."""

    def __init__(self, config: IStepperConfig, geometry: StepGeometry, rngs: nnx.Rngs) -> None:
        self.config, self.geometry = config, geometry
        features = 2 * config.path_points + (1 + 5 if config.robot_state else 0)
        second = config.hidden if config.second_hidden is None else config.second_hidden
        self.layer1 = nnx.Linear(features, config.hidden, rngs=rngs)
        self.layer2 = nnx.Linear(config.hidden, second, rngs=rngs)
        self.layer3 = nnx.Linear(second, 2 * geometry.count, rngs=rngs)

    def __call__(self, path: Float[Array, "batch n 2"], state: RobotState) -> Float[Array, "batch m 2"]:
        """Footsteps [m] in the base frame; `footstep_signs` says which are left.

        Args:
            path: points [m] in the base frame, starting at the robot.
            state: robot states with a leading batch axis; a network without the robot's state heeds its stance side
                alone, by which path and footsteps are mirrored.
        """
        return jax.vmap(self._one)(path, state)

    def _one(self, path: Float[Array, "n 2"], state: RobotState) -> Float[Array, "m 2"]:
        if not self.config.robot_state:
            view = _view(state.stance_sign)
            return self._layers((self._ahead(path, arc_length(path)) * view).reshape(-1)).reshape(-1, 2) * view
        footsteps, tangents = nominal_footsteps(path, state.stance_sign, self.geometry)
        correction = jnp.tanh(self._layers(self._features(path, state))).reshape(-1, 2) * self.config.correction
        outward = state.stance_sign * jnp.stack([-tangents[:, 1], tangents[:, 0]], axis=-1)
        return footsteps + correction[:, :1] * tangents + correction[:, 1:] * outward

    def _layers(self, features: Float[Array, " features"]) -> Float[Array, " outputs"]:
        hidden = jax.nn.relu(self.layer1(features))
        return self.layer3(jax.nn.relu(self.layer2(hidden)))

    @property
    def _reach(self) -> float:
        """[m] of the path that the network sees: as far as its footsteps go."""
        return self.geometry.length * self.geometry.count

    def _ahead(self, path: Float[Array, "n 2"], lengths: Float[Array, " n"]) -> Float[Array, "points 2"]:
        """[m] points of the path, evenly spaced by arc length; beyond its end they stay there."""
        along = jnp.linspace(0.0, self._reach, self.config.path_points, dtype=path.dtype)
        return interpolate_along(lengths, path, along)

    def _features(self, path: Float[Array, "n 2"], state: RobotState) -> Float[Array, " features"]:
        """Path ahead [m] and the state, each scaled to order one; lateral values from the stance foot's view.

        Multiplying every lateral quantity by the stance side makes left and right stance one problem: the network is
        exactly mirror-equivariant.
        """
        lengths = arc_length(path)
        ahead = self._ahead(path, lengths)
        view = _view(state.stance_sign)
        return jnp.concatenate(
            [
                (ahead * view).reshape(-1),
                jnp.minimum(lengths[-1:], self._reach),
                state.com_from_stance * view * 10.0,
                state.com_velocity * view * 3.0,
                state.time_in_step[None] * 4.0,
            ]
        )


def _view(stance_sign: Float[Array, ""]) -> Float[Array, "2"]:
    """Signs of forward and lateral values as the stance foot sees them."""
    return jnp.stack([jnp.ones_like(stance_sign), stance_sign])
