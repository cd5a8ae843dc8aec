"""The body's volume as coloured primitives, for pictures and for volume tests; nothing here carries mass or contact.

Drawn to the robot's joint positions, its 0.66 m height and the places that the inertias give to the actuators: pairs
of actuators at the hip, at the lower thigh and at the knee. Right-hand side and base only, as in the parameter table.
"""

from dataclasses import dataclass, replace

from bruce_model.parameters import FOOT, Vector3
from bruce_model.symmetry import left_name, mirrored_point

Colour = tuple[float, float, float, float]

COLOURS: dict[str, Colour] = {
    "shell": (0.92, 0.92, 0.90, 1.0),
    "frame": (0.16, 0.17, 0.19, 1.0),
    "accent": (0.95, 0.45, 0.10, 1.0),
    "glass": (0.03, 0.05, 0.08, 1.0),
}


@dataclass(frozen=True)
class Shape:
    """One primitive in its link's frame.

    Attributes:
        link: the body's name.
        kind: box, sphere, capsule or cylinder.
        points: the centre of a box or sphere; the two ends of a capsule's or cylinder's axis [m].
        size: a box's half lengths, else the radius [m].
        colour: a name in `COLOURS`.
    """

    link: str
    kind: str
    points: tuple[Vector3, ...]
    size: tuple[float, ...]
    colour: str


def _box(link: str, colour: str, centre: Vector3, half: Vector3) -> Shape:
    return Shape(link, "box", (centre,), half, colour)


def _sphere(link: str, colour: str, centre: Vector3, radius: float) -> Shape:
    return Shape(link, "sphere", (centre,), (radius,), colour)


def _capsule(link: str, colour: str, start: Vector3, end: Vector3, radius: float) -> Shape:
    return Shape(link, "capsule", (start, end), (radius,), colour)


def _cylinder(link: str, colour: str, start: Vector3, end: Vector3, radius: float) -> Shape:
    return Shape(link, "cylinder", (start, end), (radius,), colour)


_TOP = 0.1944  # of the head above the base origin: 0.663 m above the sole of straight legs

_BASE_SHAPES = (
    _box("base", "frame", (0.024, 0.0, 0.012), (0.036, 0.088, 0.014)),
    _box("base", "shell", (0.022, 0.0, 0.065), (0.038, 0.058, 0.042)),
    _box("base", "shell", (0.026, 0.0, 0.130), (0.044, 0.082, 0.030)),
    _box("base", "frame", (-0.026, 0.0, 0.085), (0.014, 0.056, 0.050)),
    _box("base", "accent", (0.061, 0.0, 0.070), (0.002, 0.036, 0.010)),
    _box("base", "shell", (0.031, 0.0, (0.150 + _TOP) / 2), (0.038, 0.046, (_TOP - 0.150) / 2)),
    _box("base", "glass", (0.069, 0.0, 0.168), (0.004, 0.040, 0.014)),
)

_BAR = (FOOT.sole_drop - 0.0125) / 2  # half the thickness of the foot's bar

_RIGHT_SHAPES = (
    # The yaw motor in the pelvis, then the hip differential's two motors, left and right of the hip.
    _cylinder("base", "frame", (0.029, -0.0758, -0.004), (0.029, -0.0758, 0.042), 0.028),
    _box("hip_yaw_r", "frame", (0.0, 0.0, 0.024), (0.022, 0.052, 0.008)),
    _cylinder("hip_yaw_r", "frame", (0.0, 0.027, 0.0), (0.0, 0.059, 0.0), 0.029),
    _cylinder("hip_yaw_r", "frame", (0.0, -0.059, 0.0), (0.0, -0.027, 0.0), 0.029),
    _cylinder("hip_yaw_r", "accent", (0.0, -0.062, 0.0), (0.0, -0.058, 0.0), 0.018),
    _sphere("hip_pitch_r", "frame", (0.0, 0.0, 0.0), 0.018),
    _capsule("thigh_r", "frame", (0.0, 0.0, -0.010), (-0.002, 0.0, -0.060), 0.018),
    _cylinder("thigh_r", "frame", (-0.006, -0.025, -0.085), (-0.006, 0.025, -0.085), 0.029),
    _box("thigh_r", "shell", (-0.006, 0.0, -0.138), (0.024, 0.021, 0.062)),
    _cylinder("thigh_r", "frame", (0.0, -0.024, -0.2049), (0.0, 0.024, -0.2049), 0.029),
    _cylinder("thigh_r", "accent", (0.0, -0.027, -0.2049), (0.0, -0.023, -0.2049), 0.018),
    _capsule("shank_r", "shell", (0.006, 0.0, -0.030), (0.0, 0.0, -0.190), 0.014),
    _capsule("shank_r", "frame", (0.036, 0.0, -0.012), (0.022, 0.0, -0.178), 0.005),
    _cylinder("foot_r", "frame", (0.0, -0.014, 0.0), (0.0, 0.014, 0.0), 0.012),
    _capsule("foot_r", "frame", (0.0, 0.0, -0.004), (0.040, 0.0, -0.015), 0.005),
    _capsule("foot_r", "frame", (0.0, 0.0, -0.004), (-0.028, 0.0, -0.015), 0.005),
    _box("foot_r", "frame", (0.00875, 0.0, _BAR - FOOT.sole_drop), (0.04725, 0.009, _BAR)),
    _box("foot_r", "accent", (0.053, 0.0, _BAR - FOOT.sole_drop), (0.004, 0.010, _BAR)),
    _cylinder("shoulder_pitch_r", "frame", (0.0, -0.004, 0.0), (0.0, 0.040, 0.0), 0.019),
    _sphere("upper_arm_r", "accent", (0.0, 0.0, 0.0), 0.020),
    _capsule("upper_arm_r", "shell", (0.0, -0.020, 0.0), (0.005, -0.100, 0.004), 0.015),
    _cylinder("forearm_r", "frame", (0.0, 0.0, -0.017), (0.0, 0.0, 0.017), 0.017),
    _capsule("forearm_r", "shell", (0.0, -0.024, 0.0), (0.0, -0.095, 0.0), 0.013),
    _sphere("forearm_r", "accent", (0.0, -0.116, 0.0), 0.016),
)  # fmt: skip


def all_shapes() -> tuple[Shape, ...]:
    """Every primitive: base, right, left."""
    left = (
        replace(shape, link=left_name(shape.link), points=tuple(mirrored_point(point) for point in shape.points))
        for shape in _RIGHT_SHAPES
    )
    return (*_BASE_SHAPES, *_RIGHT_SHAPES, *left)
