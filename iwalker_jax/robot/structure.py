"""Constants that follow from a model's structure: legs, feet, moments of tendons and motors, limbs, contacts."""

import jax
import mujoco
import numpy as np
from jaxtyping import Float

from iwalker_jax.errors import InputError
from iwalker_jax.robot.engine import mjx
from iwalker_jax.robot.limbs import Limbs

FEET = ("midfoot_r", "midfoot_l")
"""Sites in the middle of the right and the left sole, x forward and z up."""


def site_index(model: mujoco.MjModel, name: str) -> int:
    """Index of a site.

    Raises:
        InputError: there is none of that name.
    """
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
    if index < 0:
        raise InputError(f"The robot has no site {name!r}; add it to the MJCF model.")
    return index


def leg_joint_ids(model: mujoco.MjModel, site: str) -> list[int]:
    """Joints from the base down to the body that carries a site, hip first.

    Raises:
        InputError: there is no such site, it does not hang from the base, or there are other joints than hinges in
            between, or joints that do not follow one another.
    """
    body = model.site_bodyid[site_index(model, site)]
    joints: list[int] = []
    while body != model.jnt_bodyid[0]:
        if body == 0:
            raise InputError(f"Site {site!r} does not hang from the floating base; move it to a foot.")
        first, count = model.body_jntadr[body], model.body_jntnum[body]
        joints = [*range(first, first + count), *joints]
        body = model.body_parentid[body]
    if not joints or any(model.jnt_type[joints] != mujoco.mjtJoint.mjJNT_HINGE) or any(np.diff(joints) != 1):
        raise InputError(f"The joints from the base to site {site!r} must be hinges that follow one another.")
    return joints


def contact_point_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Contact points of the feet, right foot first: a site and a geom of one name on the body of a site of `FEET`.

    Raises:
        InputError: a foot has less than two, or the feet differ in their number.
    """
    feet = []
    for name in FEET:
        body = model.site_bodyid[site_index(model, name)]
        geoms = {model.geom(k).name for k in range(model.ngeom) if model.geom_bodyid[k] == body}
        sites = [model.site(k).name for k in range(model.nsite) if model.site_bodyid[k] == body]
        feet.append([name for name in sites if name and name in geoms])
    right, left = feet
    if len(right) != len(left) or len(right) < 2:
        raise InputError(
            f"The feet have {len(right)} and {len(left)} contact points; give both as many, two or more, each a geom "
            "and a site of one name on the foot's body."
        )
    return (*right, *left)


def tendon_moments(model: mujoco.MjModel) -> Float[np.ndarray, "nt nv"]:
    """Rate of each fixed tendon's length by velocity, a constant."""
    moments = np.zeros((model.ntendon, model.nv))
    for tendon in range(model.ntendon):
        first, count = model.tendon_adr[tendon], model.tendon_num[tendon]
        for wrap in range(first, first + count):
            moments[tendon, model.jnt_dofadr[model.wrap_objid[wrap]]] += model.wrap_prm[wrap]
    return moments


def motor_moments(model: mujoco.MjModel) -> Float[np.ndarray, "nu nv"]:
    """Generalised force of a unit torque of each motor, a constant."""
    moments = np.zeros((model.nu, model.nv))
    tendons = tendon_moments(model)
    for motor in range(model.nu):
        target, gear = model.actuator_trnid[motor, 0], model.actuator_gear[motor, 0]
        if model.actuator_trntype[motor] == mujoco.mjtTrn.mjTRN_TENDON:
            moments[motor] = gear * tendons[target]
        else:
            moments[motor, model.jnt_dofadr[target]] = gear
    return moments


def motor_limits(model: mujoco.MjModel) -> Float[np.ndarray, "nu 2"]:
    """Least and largest torque of each motor: the narrower of its control and force range [N m]."""
    limits = np.tile([-np.inf, np.inf], (model.nu, 1))
    for limited, span in (
        (model.actuator_ctrllimited, model.actuator_ctrlrange),
        (model.actuator_forcelimited, model.actuator_forcerange),
    ):
        chosen = limited.astype(bool)
        limits[chosen, 0] = np.maximum(limits[chosen, 0], span[chosen, 0])
        limits[chosen, 1] = np.minimum(limits[chosen, 1], span[chosen, 1])
    return limits


def contact_pairs(model: mujoco.MjModel, device_model: mjx.Model) -> tuple[tuple[int, int], ...]:
    """Both geoms of each contact that MJX considers, in its order; the contact's normal points to the second.

    Raises:
        InputError: nothing can touch, or a contact has no or other friction than sliding.
    """
    data = mjx.make_data(device_model, impl="jax")
    if data._impl.ncon == 0 or any(data._impl.contact.dim != 3):
        raise InputError("The robot needs contacts, all with condim 3; give the feet's geoms and the floor condim 3.")
    if any(model.numeric(k).name in ("max_geom_pairs", "max_contact_points") for k in range(model.nnumeric)):
        raise InputError("The model limits MJX's contacts; remove max_geom_pairs and max_contact_points.")
    pairs = jax.jit(lambda: mjx.collision(device_model, data)._impl.contact.geom)()
    return tuple((int(first), int(second)) for first, second in np.asarray(pairs))


def contact_bodies(model: mujoco.MjModel, pairs: tuple[tuple[int, int], ...]) -> tuple[tuple[int, int], ...]:
    """Of each contact the body that moves, and 1 if the normal points to it, else -1.

    Raises:
        InputError: two moving bodies can touch.
    """
    found = []
    for pair in pairs:
        bodies = model.geom_bodyid[list(pair)]
        moving = model.body_weldid[bodies] != 0
        if all(moving):
            names = [model.body(body).name for body in bodies]
            raise InputError(
                f"Bodies {names[0]!r} and {names[1]!r} of the robot can touch; let its geoms touch the world's alone."
            )
        found.append((int(bodies[1]), 1) if moving[1] else (int(bodies[0]), -1))
    return tuple(found)


def touching_geoms(pairs: tuple[tuple[int, int], ...]) -> tuple[int, ...]:
    """The geoms that can touch something, each once."""
    return tuple(sorted({geom for pair in pairs for geom in pair}))


def limb_pattern(model: mujoco.MjModel, touching: list[int]) -> Limbs:
    """The limbs that hang from the base, and which of them each contact's moving body belongs to.

    Raises:
        InputError: a tendon couples limbs, or a body of the base can touch something.
    """
    roots = [dof for dof in range(6, model.nv) if model.dof_parentid[dof] < 6]
    sizes = np.diff([*roots, model.nv])
    limb_of = np.repeat(np.arange(len(roots)), sizes)
    for tendon, moments in enumerate(tendon_moments(model)):
        if len(set(limb_of[np.nonzero(moments[6:])[0]])) > 1:
            raise InputError(f"Tendon {model.tendon(tendon).name!r} couples two limbs; couple joints of one limb only.")
    last = [model.body_dofadr[model.body_weldid[body]] for body in touching]
    if any(dof < 6 for dof in last):
        raise InputError("The robot's base can touch something; let the geoms of its limbs touch the world's alone.")
    return Limbs(tuple(roots), tuple(int(size) for size in sizes), tuple(int(limb_of[dof - 6]) for dof in last))
