"""From a robot's own MJCF to the model that walks: legs first, torque motors, soles of spheres, all else stripped.

What is left out: shapes other than the soles, sensors, tendons, equalities, springs and the joints' dry friction. What
is kept: bodies, inertias, the joints of legs and movable limbs with limits, armature and damping. Pictures show bodies
as ellipsoids of their inertia.
"""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
from jaxtyping import Float

from bruce_model.scenery import add_floor, add_scenery_assets, add_spotlight, add_sun, add_video_cameras
from iwalker_jax.constants import TIME_STEP
from iwalker_jax.errors import InputError
from iwalker_jax.humanoids.description import Anatomy, RobotDescription, Sole
from iwalker_jax.robot import compile_model

_DROPPED = (
    "actuators",
    "cameras",
    "equalities",
    "excludes",
    "geoms",
    "keys",
    "lights",
    "materials",
    "meshes",
    "pairs",
    "sensors",
    "tendons",
    "textures",
)

_GREY = "0.45 0.47 0.5 1"


def build_model(robot: RobotDescription) -> mujoco.MjModel:
    """The robot's model on a floor; its first keyframe is how it stands.

    Raises:
        InputError: the MJCF cannot be read, or lacks what the description names.
    """
    if robot.anatomy is None:
        return compile_model(robot.mjcf)
    anatomy = robot.anatomy
    spec = _read(robot)
    limits = _torque_limits(spec, anatomy)
    for kind in _DROPPED:
        for element in getattr(spec, kind):
            spec.delete(element)
    _fix_joints(spec, anatomy)
    _add_soles(spec, anatomy)
    _set_options(spec, anatomy)
    spec.compile()
    text = _completed(spec.to_xml(), anatomy, limits)
    standing = _standing(compile_model(text), anatomy)
    finished = mujoco.MjSpec.from_string(text)
    finished.add_key(name="standing", qpos=standing)
    return finished.compile()


def _read(robot: RobotDescription) -> mujoco.MjSpec:
    """The robot's own MJCF, checked for what the description names."""
    try:
        spec = mujoco.MjSpec.from_file(str(robot.mjcf))
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise InputError(f"MuJoCo cannot read the model of {robot.name} ({reason}); give an MJCF file.") from error
    anatomy = robot.anatomy
    assert anatomy is not None
    joints = {joint.name for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_HINGE}
    wanted = {
        "joint": ((*anatomy.right_leg, *anatomy.left_leg, *anatomy.movable, *anatomy.standing), joints),
        "body": ((anatomy.right_foot, anatomy.left_foot), {body.name for body in spec.bodies}),
        "site": (() if anatomy.imu is None else (anatomy.imu,), {site.name for site in spec.sites}),
    }
    for kind, (names, there) in wanted.items():
        missing = [name for name in names if name not in there]
        if missing:
            raise InputError(
                f"The model of {robot.name} has no {'hinge' if kind == 'joint' else kind} {missing[0]!r}; "
                f"name one of its {kind}s."
            )
    bases = [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    if len(bases) != 1 or bases[0].parent.parent != spec.worldbody:
        raise InputError(f"The model of {robot.name} has no floating base; give its first body a <freejoint>.")
    return spec


def _torque_limits(spec: mujoco.MjSpec, anatomy: Anatomy) -> dict[str, float]:
    """[N m] of each joint: the least that the joint and its actuators say, or the description's."""
    spans = {joint.name: [joint.actfrcrange] for joint in spec.joints}
    for actuator in spec.actuators:
        if actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT:
            spans[actuator.target].append(actuator.forcerange)
            if actuator.biastype == mujoco.mjtBias.mjBIAS_NONE and actuator.gainprm[0] == 1:
                spans[actuator.target].append(actuator.ctrlrange)
    # A span of nothing is how MJCF says that there is none.
    said = {name: [float(np.abs(span).min()) for span in given if np.any(span)] for name, given in spans.items()}
    return {name: min(values, default=anatomy.torque_limit) for name, values in said.items()}


def _fix_joints(spec: mujoco.MjSpec, anatomy: Anatomy) -> None:
    """Weld what does not move at its standing angle, and take from the other joints what the dynamics do not know."""
    kept = {*anatomy.right_leg, *anatomy.left_leg, *anatomy.movable}
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            continue
        if joint.name in kept:
            joint.frictionloss = 0.0
            joint.stiffness = joint.stiffness * 0
            joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
            continue
        body, turn, moved = joint.parent, np.zeros(4), np.zeros(3)
        mujoco.mju_axisAngle2Quat(turn, joint.axis, anatomy.standing.get(joint.name, 0.0))
        mujoco.mju_rotVecQuat(moved, joint.pos, turn)
        mujoco.mju_rotVecQuat(moved, joint.pos - moved, body.quat)
        body.pos = body.pos + moved
        mujoco.mju_mulQuat(turn, body.quat.copy(), turn.copy())
        body.quat = turn
        spec.delete(joint)


def _add_soles(spec: mujoco.MjSpec, anatomy: Anatomy) -> None:
    """Contact points, the feet's middles and ends, and the IMU."""
    contact = anatomy.contact
    for side, name in (("r", anatomy.right_foot), ("l", anatomy.left_foot)):
        body, ends = spec.body(name), _ends(anatomy.sole, side)
        for point, place in _corners(anatomy.sole, side).items():
            body.add_site(name=f"{point}_{side}", pos=place)
            body.add_geom(
                name=f"{point}_{side}",
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[anatomy.sole.radius, 0, 0],
                pos=[*place[:2], place[2] + anatomy.sole.radius],
                contype=1,
                conaffinity=0,
                condim=3,
                priority=1,
                friction=[contact.friction, 0.005, 0.0001],
                solref=[contact.time_constant, contact.damping_ratio],
                mass=0.0,
            )
        for point, place in ends.items():
            if spec.site(f"{point}_{side}") is None:
                body.add_site(name=f"{point}_{side}", pos=place)
    base = next(joint.parent for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE)
    if anatomy.imu is not None:
        given = spec.site(anatomy.imu)
        if given.parent != base:
            raise InputError(f"Site {anatomy.imu!r} is not on the floating base; name one that is, or none.")
        given.name = "imu"
    else:
        base.add_site(name="imu")


def _ends(sole: Sole, side: str) -> dict[str, Float[np.ndarray, "3"]]:
    """Middle, toe and heel of a sole [m] in its body's frame."""
    middle = (sole.outer - sole.inner) / 2 * (1 if side == "l" else -1)
    along = {"midfoot": (sole.front + sole.back) / 2, "toe": sole.front, "heel": sole.back}
    return {name: np.array([x, middle, sole.height]) for name, x in along.items()}


def _corners(sole: Sole, side: str) -> dict[str, Float[np.ndarray, "3"]]:
    """Contact points of a sole [m] in its body's frame."""
    if sole.is_line:
        return {name: place for name, place in _ends(sole, side).items() if name != "midfoot"}
    outward = 1 if side == "l" else -1
    return {
        f"{end}_{edge}": np.array([x, outward * y, sole.height])
        for end, x in (("front", sole.front), ("back", sole.back))
        for edge, y in (("outer", sole.outer), ("inner", -sole.inner))
    }


def _set_options(spec: mujoco.MjSpec, anatomy: Anatomy) -> None:
    """Those of BRUCE's model, which are the ones that the dynamics know."""
    option, contact = spec.option, anatomy.contact
    option.timestep = TIME_STEP
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    option.iterations, option.ls_iterations = contact.iterations, contact.line_search_iterations
    option.tolerance, option.impratio = 1e-12, contact.impratio
    option.disableflags = option.enableflags = 0


def _completed(text: str, anatomy: Anatomy, limits: dict[str, float]) -> str:
    """The stripped model with the legs' joints first, a motor a joint, and what surrounds it."""
    root = ElementTree.fromstring(text)
    world = root.find("worldbody")
    assert world is not None
    _order_bodies(world, (anatomy.right_leg[0], anatomy.left_leg[0]))
    base = next(body for body in world if body.find("freejoint") is not None or body.find("joint") is not None)
    for body in list(world.iter("body")):
        _add_shape(body)
    asset = root.find("asset")
    add_scenery_assets(ElementTree.SubElement(root, "asset") if asset is None else asset, True)
    add_sun(world)
    add_floor(world)
    add_spotlight(base)
    add_video_cameras(base)
    motors = ElementTree.SubElement(root, "actuator")
    for joint in world.iter("joint"):
        name = joint.get("name", "")
        if name in limits and joint.get("type") != "free":
            span = f"{-limits[name]:.12g} {limits[name]:.12g}"
            ElementTree.SubElement(motors, "motor", name=name, joint=name, forcelimited="true", forcerange=span)
    return ElementTree.tostring(root, encoding="unicode")


def _add_shape(body: Element) -> None:
    """Show a body as the solid ellipsoid of its mass and inertia; it touches nothing."""
    inertial = body.find("inertial")
    if inertial is None or "diaginertia" not in inertial.attrib:
        return
    moments = np.array(inertial.get("diaginertia", "").split(), float)
    squares = 2.5 * (moments.sum() - 2 * moments) / float(inertial.get("mass", "1"))
    size = " ".join(f"{x:.6g}" for x in np.sqrt(np.maximum(squares, 1e-4)))
    shape = {"type": "ellipsoid", "size": size, "contype": "0", "conaffinity": "0", "mass": "0", "rgba": _GREY}
    place = {name: value for name, value in inertial.attrib.items() if name in ("pos", "quat")}
    ElementTree.SubElement(body, "geom", shape | place)


def _order_bodies(body: Element, firsts: tuple[str, str]) -> int:
    """Put the bodies that carry the first joints of the legs before the others, all the way down; the body's rank."""
    children = [child for child in body if child.tag == "body"]
    ranks = {id(child): _order_bodies(child, firsts) for child in children}
    for child in children:
        body.remove(child)
    body.extend(sorted(children, key=lambda child: ranks[id(child)]))
    own = [firsts.index(joint.get("name", "")) for joint in body.findall("joint") if joint.get("name") in firsts]
    return min([*own, *ranks.values()], default=len(firsts))


def _standing(model: mujoco.MjModel, anatomy: Anatomy) -> Float[np.ndarray, " nq"]:
    """Positions of the robot that stands with the lower sole on the floor, its feet either side of the origin.

    Raises:
        InputError: the soles are not level, or not level with each other.
    """
    data = mujoco.MjData(model)
    for joint in (*anatomy.right_leg, *anatomy.left_leg, *anatomy.movable):
        data.qpos[model.joint(joint).qposadr[0]] = anatomy.standing.get(joint, 0.0)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    mujoco.mj_kinematics(model, data)
    feet = [data.site(f"midfoot_{side}") for side in "rl"]
    heights = [foot.xpos[2] for foot in feet]
    tilt = max(float(np.arccos(np.clip(foot.xmat[8], -1, 1))) for foot in feet)
    if tilt > 0.02 or abs(heights[0] - heights[1]) > 0.005:
        raise InputError(
            f"Standing, the soles are tilted by up to {np.degrees(tilt):.1f} degrees and {heights[0] - heights[1]:.3f} "
            "m differ in height; correct the joints of `standing`."
        )
    data.qpos[2] = -min(heights)
    data.qpos[:2] = -np.mean([foot.xpos[:2] for foot in feet], axis=0)
    return data.qpos.copy()
