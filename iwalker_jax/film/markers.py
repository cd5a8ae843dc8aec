"""Markers drawn into MuJoCo's visual scene: footsteps, paths and goals on the floor, forces and a soft shadow."""

import mujoco
import numpy as np
from jaxtyping import Float

from iwalker_jax.geometry import Side, host
from iwalker_jax.walking import TimedFootsteps

_COLOURS = {Side.RIGHT: (1.0, 0.5, 0.05), Side.LEFT: (0.12, 0.47, 0.71)}
"""Right feet orange and left feet blue, as in the plots."""
_SOLE = (0.0425, 0.012)  # [m] half length and half width of the mark of the next footstep: the line foot
_MARK = (0.022, 0.012)  # [m] of the others; steps of one foot are often shorter than the foot itself
_BORDER = 0.007  # [m] about the next footstep
_METRES_PER_NEWTON = {"contact": 0.006, "push": 0.012}
_BODY_RADIUS = 0.1  # [m] from the base's centre to where a push touches it
_FORCE_COLOUR = (0.1, 0.65, 0.25, 1.0)
_PUSH_COLOUR = (0.85, 0.1, 0.1, 1.0)
MARK_COLOURS = {
    "right footsteps": _COLOURS[Side.RIGHT],
    "left footsteps": _COLOURS[Side.LEFT],
    "contact force": _FORCE_COLOUR[:3],
    "push": _PUSH_COLOUR[:3],
}
"""(r, g, b) of what stands beside a robot, by name."""

_PATH_COLOUR = (0.85, 0.12, 0.12, 1.0)
_GOAL_COLOUR = (0.85, 0.0, 0.75)


def add_footsteps(scene: mujoco.MjvScene, footsteps: TimedFootsteps, time: float) -> None:
    """Lay planned footsteps on the floor: those made are pale, those to come clear, the next one long and framed."""
    coming = np.flatnonzero(footsteps.times > time)
    following = coming[0] if len(coming) else -1
    for i in np.flatnonzero(np.isfinite(footsteps.positions).all(axis=1)):
        x, y = footsteps.positions[i]
        colour = np.asarray(_COLOURS[Side(footsteps.sides[i])])
        if i == following:
            frame = (_SOLE[0] + _BORDER, _SOLE[1] + _BORDER)
            _add_plate(scene, (x, y, 0.0012), frame, footsteps.yaws[i], np.ones(3))
            _add_plate(scene, (x, y, 0.0020), _SOLE, footsteps.yaws[i], colour)
            continue
        if footsteps.times[i] <= time:
            colour = 0.35 * colour + 0.65 * np.array([0.75, 0.76, 0.78])
        _add_plate(scene, (x, y, 0.0006), _MARK, footsteps.yaws[i], colour)


def add_shadow(scene: mujoco.MjvScene, centre: Float[np.ndarray, " 3"], radius: float = 0.15) -> None:
    """Lay a soft round shadow on the floor below a point; MuJoCo's own are slow without a GPU."""
    for share in (1.0, 0.8, 0.6):
        size = np.array([share * radius, 0.0002, 0.0])
        position = np.array([centre[0], centre[1], 0.0003])
        _add_geom(scene, mujoco.mjtGeom.mjGEOM_CYLINDER, size, position, np.eye(3), (0.1, 0.1, 0.12, 0.13))


def add_path(scene: mujoco.MjvScene, points: Float[np.ndarray, "n 2"], spacing: float = 0.08) -> None:
    """Lay a path on the floor as a thin line; points [m] nearer than `spacing` to the last one drawn are left out."""
    last = points[0]
    for point in points[1:]:
        if np.linalg.norm(point - last) < spacing:
            continue
        geom = _add_geom(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, np.ones(3), np.zeros(3), np.eye(3), _PATH_COLOUR)
        ends = (np.array([*last, 0.003]), np.array([*point, 0.003]))
        mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, 0.006, *ends)
        last = point


def add_goal(scene: mujoco.MjvScene, position: Float[np.ndarray, " 2"], current: bool) -> None:
    """Mark a goal [m] by a disc on the floor; the one being walked to also by a slim pole."""
    colour = (*_GOAL_COLOUR, 0.9 if current else 0.35)
    disc, pole = np.array([0.12, 0.001, 0.0]), np.array([0.012, 0.35, 0.0])
    _add_geom(scene, mujoco.mjtGeom.mjGEOM_CYLINDER, disc, np.array([*position, 0.002]), np.eye(3), colour)
    if current:
        _add_geom(scene, mujoco.mjtGeom.mjGEOM_CYLINDER, pole, np.array([*position, 0.35]), np.eye(3), colour)
        ball = np.full(3, 0.045)
        _add_geom(scene, mujoco.mjtGeom.mjGEOM_SPHERE, ball, np.array([*position, 0.72]), np.eye(3), colour)


def add_forces(
    scene: mujoco.MjvScene, points: Float[np.ndarray, "c 3"], forces: Float[np.ndarray, "c 3"], push: bool = False
) -> None:
    """Draw arrows: contact forces in green start at their points, pushes in red, longer a newton, end short of them."""
    for point, force in zip(points, forces, strict=True):
        arrow = _METRES_PER_NEWTON["push" if push else "contact"] * force
        length = float(np.linalg.norm(arrow))
        if not length > 1e-3:
            continue
        start = point - arrow - _BODY_RADIUS / length * arrow if push else point
        colour = _PUSH_COLOUR if push else _FORCE_COLOUR
        geom = _add_geom(scene, mujoco.mjtGeom.mjGEOM_ARROW, np.ones(3), np.zeros(3), np.eye(3), colour)
        # MuJoCo draws an arrow half as long as the distance that it connects.
        width = 0.012 if push else 0.006
        mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_ARROW, width, start, start + 2.0 * arrow)


def _add_plate(
    scene: mujoco.MjvScene,
    position: tuple[float, ...],
    half: tuple[float, float],
    yaw: float,
    colour: Float[np.ndarray, " 3"],
) -> None:
    rotation = host.rotation_about_vertical(yaw)
    _add_geom(scene, mujoco.mjtGeom.mjGEOM_BOX, np.array([*half, 0.0004]), np.array(position), rotation, (*colour, 1.0))


def _add_geom(
    scene: mujoco.MjvScene,
    kind: mujoco.mjtGeom,
    size: Float[np.ndarray, " 3"],
    position: Float[np.ndarray, " 3"],
    rotation: Float[np.ndarray, "3 3"],
    colour: tuple[float, ...],
) -> mujoco.MjvGeom:
    """Append a geom to the scene; when the scene is full, the last one is replaced."""
    index = min(scene.ngeom, scene.maxgeom - 1)
    geom = scene.geoms[index]
    mujoco.mjv_initGeom(geom, kind, size, position, rotation.reshape(-1), np.asarray(colour, np.float32))
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR
    geom.specular = 0.0
    scene.ngeom = index + 1
    return geom
