"""The whole robot from its right-hand side: the left-hand side is the mirror image in the plane y = 0.

A reflection turns a point (x, y, z) into (x, -y, z), changes the sign of an inertia's xy and yz products, and turns a
rotation axis (x, y, z) into (-x, y, -z).
"""

from dataclasses import replace

from bruce_model.parameters import (
    ARM_MOTORS,
    BASE,
    BASE_SITES,
    LEG_MOTORS,
    RIGHT_ARM,
    RIGHT_LEG,
    RIGHT_SITES,
    Hinge,
    Link,
    Motor,
    Site,
    Vector3,
)


def left_name(name: str) -> str:
    """`thigh_l` from `thigh_r`; names without a side stay."""
    return name.removesuffix("_r") + "_l" if name.endswith("_r") else name


def mirrored_point(point: Vector3) -> Vector3:
    """A point's mirror image."""
    return point[0], 0.0 - point[1], point[2]


def mirrored_hinge(hinge: Hinge) -> Hinge:
    """The left joint of a right one, with the axis that `mirror_sign` asks for."""
    sign = hinge.mirror_sign
    low, high = sorted((sign * hinge.low, sign * hinge.high))
    x, y, z = hinge.axis
    return replace(hinge, axis=(0.0 - sign * x, 0.0 + sign * y, 0.0 - sign * z), low=low, high=high)


def mirrored_link(link: Link) -> Link:
    """The left link of a right one."""
    inertia = link.inertia._replace(ixy=0.0 - link.inertia.ixy, iyz=0.0 - link.inertia.iyz)
    return replace(
        link,
        name=left_name(link.name),
        parent=None if link.parent is None else left_name(link.parent),
        position=mirrored_point(link.position),
        com=mirrored_point(link.com),
        inertia=inertia,
        hinge=None if link.hinge is None else mirrored_hinge(link.hinge),
    )


def mirrored_site(site: Site) -> Site:
    """The left site of a right one."""
    return Site(left_name(site.name), left_name(site.link), mirrored_point(site.position))


def all_links() -> tuple[Link, ...]:
    """The 17 links in joint order: base, right leg, left leg, right arm, left arm."""
    left_leg, left_arm = ([mirrored_link(link) for link in chain] for chain in (RIGHT_LEG, RIGHT_ARM))
    return (BASE, *RIGHT_LEG, *left_leg, *RIGHT_ARM, *left_arm)


def all_sites() -> tuple[Site, ...]:
    """Every site: base, right, left."""
    return (*BASE_SITES, *RIGHT_SITES, *(mirrored_site(site) for site in RIGHT_SITES))


def all_motors() -> tuple[Motor, ...]:
    """The 16 motors in control order, names and joints with their side: legs right and left, arms right and left."""
    return tuple(
        replace(
            motor,
            name=f"{motor.name}_{side}",
            angle=tuple((f"{joint}_{side}", coefficient) for joint, coefficient in motor.angle),
        )
        for motors in (LEG_MOTORS, ARM_MOTORS)
        for side in ("r", "l")
        for motor in motors
    )


def joint_names() -> tuple[str, ...]:
    """The 16 joints in order, with their side."""
    return tuple(f"{link.hinge.name}_{link.name[-1]}" for link in all_links() if link.hinge is not None)
