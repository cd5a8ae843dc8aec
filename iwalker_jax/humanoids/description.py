"""What must be told of a robot so that it walks: its model, what in it are legs and feet, how it stands and steps."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from bruce_model.options import ContactParameters
from iwalker_jax.checks import require_plain_numbers, require_range
from iwalker_jax.control import GaitParameters, WholeBodyParameters
from iwalker_jax.errors import InputError


@dataclass(frozen=True)
class Sole:
    """Where a foot touches the floor, in the frame of its body with x forward and z up; the left foot's is mirrored.

    Attributes:
        front, back: [m] ends of the sole along x.
        inner, outer: [m] edges beside the body's origin, towards the other foot and away from it; both 0 make a foot
            that is a line, with a contact point at either end instead of one in each corner.
        height: [m] of the sole along z, negative below the body's origin.
        radius: [m] of the spheres that touch the floor.
    """

    front: float
    back: float
    inner: float
    outer: float
    height: float
    radius: float = 0.005

    def __post_init__(self) -> None:
        require_plain_numbers(self)
        if self.front - self.back < 0.02:
            raise InputError(f"The sole reaches from {self.back:g} to {self.front:g} m; give 2 cm or more, back first.")
        if self.inner < 0 or self.outer < 0 or (self.inner == 0) != (self.outer == 0):
            raise InputError(
                f"The sole's edges lie {self.inner:g} and {self.outer:g} m beside its middle; give both above 0, or "
                "both 0 for a foot that is a line."
            )
        require_range(self, "radius", 1e-3, 0.05, "m")

    @property
    def is_line(self) -> bool:
        """Whether the foot touches the floor along a line."""
        return self.inner == 0


@dataclass(frozen=True)
class Anatomy:
    """What in a robot's MJCF is what; the rest of its joints are fixed where they stand.

    Attributes:
        right_leg, left_leg: joints from the hip to the foot, five or six with an ankle roll.
        right_foot, left_foot: bodies that carry the soles.
        sole: of the right foot.
        imu: site on the floating base; the base's origin if left out.
        movable: further joints that are kept, and held by their motors where they stand.
        standing: [rad] positions of joints in which the robot stands with its soles level; 0 for all others.
        torque_limit: [N m] of motors whose limits the MJCF does not say.
        contact: between soles and floor, and the engine's solver.
    """

    right_leg: tuple[str, ...]
    left_leg: tuple[str, ...]
    right_foot: str
    left_foot: str
    sole: Sole
    imu: str | None = None
    movable: tuple[str, ...] = ()
    standing: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    torque_limit: float = 100.0
    contact: ContactParameters = ContactParameters()

    def __post_init__(self) -> None:
        if len(self.right_leg) != len(self.left_leg) or len(self.right_leg) not in (5, 6):
            raise InputError(
                f"The legs have {len(self.right_leg)} and {len(self.left_leg)} joints; name both legs' five, or six "
                "with an ankle roll, from hip to foot."
            )
        named = (*self.right_leg, *self.left_leg, *self.movable)
        twice = sorted({name for name in named if named.count(name) > 1})
        if twice:
            raise InputError(f"Joint {twice[0]!r} is named twice; name each joint of legs and movable once.")
        require_range(self, "torque_limit", 0.01, 1e4, "N m")


@dataclass(frozen=True)
class RobotDescription:
    """A robot that can walk.

    Attributes:
        name: for people.
        mjcf: its model's file.
        anatomy: what in it is what; None of a model made for this package, as BRUCE's, which then has all that
            `iwalker_jax.robot.load_robot_model` asks for.
        gait: when and where the feet move.
        tasks: weights and gains of the whole-body controller.
    """

    name: str
    mjcf: Path
    anatomy: Anatomy | None = None
    gait: GaitParameters = GaitParameters()
    tasks: WholeBodyParameters = WholeBodyParameters()

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.strip():
            raise InputError("The robot has no name; give it one.")
        gait, reach = self.gait, self.gait.reach
        if not reach.lateral_min < gait.width < reach.lateral_max:
            raise InputError(
                f"The robot's tracks lie {gait.width:g} m apart, and its gait reaches from {reach.lateral_min:g} to "
                f"{reach.lateral_max:g} m sideways; give a width in between."
            )
        step = gait.speed * float(gait.hlip.step_time)
        if not 0 < step <= reach.sagittal:
            raise InputError(
                f"At {gait.speed:g} m/s a step is {step:.2f} m long, and the gait reaches {reach.sagittal:g} m; give a "
                "speed above 0 and within reach."
            )
