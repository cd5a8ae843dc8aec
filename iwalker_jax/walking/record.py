"""Recorded walks as plain NumPy arrays: what is plotted and drawn into videos."""

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import host


class TimedFootsteps(NamedTuple):
    """Planned footsteps, in the order in which they are made.

    Attributes:
        times: (K,) [s] planned touchdown.
        positions: (K, 2) [m] middle of the sole, world frame.
        yaws: (K,) [rad] heading of the foot.
        sides: (K,) the `Side` of each.
    """

    times: Float[np.ndarray, " k"]
    positions: Float[np.ndarray, "k 2"]
    yaws: Float[np.ndarray, " k"]
    sides: Int[np.ndarray, " k"]


@dataclass(frozen=True)
class WalkRecord:
    """One robot's walk, sampled at N instants. NaN is left out of pictures, e.g. after a fall.

    Attributes:
        time: (N,) [s] increasing.
        com, com_velocity: (N, 3) [m], [m/s] of the centre of mass, world frame.
        base_rpy: (N, 3) [rad] roll, pitch and yaw of the base.
        foot_positions: (N, 2, 3) [m] middle of the right and the left foot, world frame.
        torques: (N, nu) [N m] of the motors, right leg, left leg, then the others; or largest magnitudes since the
            instant before.
        torque_limits: (nu,) [N m] largest magnitudes.
        forces: (N, c, 3) [N] on the contact points, as many of the right, then of the left foot, world frame.
        planned: the footsteps to take.
        actual: (K, 3) x, y [m] and yaw [rad] of the footsteps as made; NaN for those that were not.
        commanded_speed: (N,) [m/s] wanted along the heading, if any.
        estimated_velocity: (N, 3) [m/s] of the centre of mass as the estimator believes it to be, if any.
        path: (n, 2) [m] that the footsteps follow, if any.
        push_times: (P,) [s] when the robot is pushed.
        friction: the floor's coefficient, if known.
        leg_motors: of one leg.
    """

    time: Float[np.ndarray, " n"]
    com: Float[np.ndarray, "n 3"]
    com_velocity: Float[np.ndarray, "n 3"]
    base_rpy: Float[np.ndarray, "n 3"]
    foot_positions: Float[np.ndarray, "n 2 3"]
    torques: Float[np.ndarray, "n nu"]
    torque_limits: Float[np.ndarray, " nu"]
    forces: Float[np.ndarray, "n c 3"]
    planned: TimedFootsteps
    actual: Float[np.ndarray, "k 3"]
    commanded_speed: Float[np.ndarray, " n"] | None = None
    estimated_velocity: Float[np.ndarray, "n 3"] | None = None
    path: Float[np.ndarray, "m 2"] | None = None
    push_times: tuple[float, ...] = ()
    friction: float | None = None
    leg_motors: int = 5

    def __post_init__(self) -> None:
        n, k = len(self.time), len(self.planned.times)
        motors = np.shape(self.torque_limits)
        shapes = {
            "time": (n,),
            "com": (n, 3),
            "com_velocity": (n, 3),
            "base_rpy": (n, 3),
            "foot_positions": (n, 2, 3),
            "torques": (n, *motors),
            "forces": (n, 2 * (np.shape(self.forces)[1] // 2), 3),
            "actual": (k, 3),
            "commanded_speed": (n,),
            "estimated_velocity": (n, 3),
        }
        for field in fields(self):
            value, wanted = getattr(self, field.name), shapes.get(field.name)
            if value is not None and wanted is not None and np.shape(value) != wanted:
                raise InputError(
                    f"The walk's {field.name} has shape {np.shape(value)}; with {n} instants and {k} planned "
                    f"footsteps it must be {wanted}."
                )
        if n < 2 or not np.all(np.diff(self.time) > 0):
            raise InputError("The walk's time does not increase; give at least two instants in order.")

    def footstep_errors(self) -> Float[np.ndarray, " k"]:
        """(K,) [m] distance between each planned footstep and the one made; NaN where none was."""
        return np.linalg.norm(self.actual[:, :2] - self.planned.positions, axis=1)

    def friction_ratios(self, least_force: float = 2.0) -> Float[np.ndarray, "n 2"]:
        """(N, 2) largest ratio of horizontal to vertical force at the points of each foot.

        NaN where no point carries `least_force` [N]: the ratio of two small numbers says nothing.
        """
        vertical = self.forces[..., 2]
        carries = vertical >= least_force
        ratio = np.where(
            carries, np.linalg.norm(self.forces[..., :2], axis=-1) / np.where(carries, vertical, 1.0), -1.0
        )
        largest = ratio.reshape(len(ratio), 2, -1).max(axis=2)
        return np.where(largest >= 0.0, largest, np.nan)

    def speeds_along_heading(self, velocity: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """(N, 2) [m/s] forward and leftward components of a world-frame velocity, relative to the base's yaw."""
        return host.turn(-self.base_rpy[:, 2], velocity[:, :2])
