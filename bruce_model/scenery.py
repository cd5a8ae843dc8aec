"""What surrounds the robot in a picture: sky, lights, checker floor and the cameras that videos are filmed with."""

from xml.etree.ElementTree import Element, SubElement

# Camera name -> offset from the robot's centre of mass [m], picture x axis, picture y axis.
_VIDEO_CAMERAS = {
    "side": ("0.95 -1.15 0.42", "0.771 0.637 0 -0.173 0.209 0.962"),
    "front": ("1.25 0 0.4", "0 1 0 -0.305 0 0.952"),
    "top": ("0 0 2", "0 -1 0 1 0 0"),
}
_LIGHT_DIRECTION = "-0.36 0.4 -0.84"


def add_scenery_assets(asset: Element, floor: bool) -> None:
    """Append the sky and, for the floor, its checker material."""
    SubElement(
        asset,
        "texture",
        name="sky",
        type="skybox",
        builtin="gradient",
        rgb1="0.62 0.74 0.86",
        rgb2="0.93 0.95 0.97",
        width="256",
        height="1536",
    )
    if not floor:
        return
    SubElement(
        asset,
        "texture",
        name="floor",
        type="2d",
        builtin="checker",
        mark="edge",
        rgb1="0.72 0.74 0.76",
        rgb2="0.62 0.64 0.67",
        markrgb="0.82 0.83 0.85",
        width="512",
        height="512",
    )
    # Squares of a quarter metre.
    SubElement(asset, "material", name="floor", texture="floor", texuniform="true", texrepeat="2 2", reflectance="0.08")


def add_floor(world: Element) -> None:
    """Append the plane z = 0; only the foot spheres collide with it."""
    SubElement(
        world,
        "geom",
        name="floor",
        type="plane",
        size="0 0 0.25",
        material="floor",
        contype="0",
        conaffinity="1",
        condim="3",
    )


def add_sun(world: Element) -> None:
    """Append the sun, which casts no shadow: the renderer's directional shadows are speckled far from the robot."""
    SubElement(
        world,
        "light",
        name="sun",
        type="directional",
        pos="0 0 4",
        dir=_LIGHT_DIRECTION,
        diffuse="0.4 0.4 0.38",
        specular="0.1 0.1 0.1",
        castshadow="false",
    )


def add_spotlight(base: Element) -> None:
    """Append a lamp that follows the robot and casts its shadow."""
    SubElement(
        base,
        "light",
        name="spotlight",
        type="spot",
        mode="trackcom",
        pos="1.3 -1.5 3.2",
        dir=_LIGHT_DIRECTION,
        cutoff="45",
        exponent="8",
        diffuse="0.3 0.3 0.3",
        specular="0 0 0",
        castshadow="true",
    )


def add_video_cameras(base: Element) -> None:
    """Append cameras that keep a fixed offset and direction while they follow the robot's centre of mass."""
    for name, (offset, axes) in _VIDEO_CAMERAS.items():
        SubElement(base, "camera", name=name, mode="trackcom", pos=offset, xyaxes=axes, fovy="40")
