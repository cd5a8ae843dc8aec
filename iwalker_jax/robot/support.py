"""What a robot model may use: everything that the dynamics here do not reproduce is refused when it is loaded."""

import mujoco
import numpy as np

from iwalker_jax.errors import InputError


def check_supported(model: mujoco.MjModel) -> None:
    """Refuse models whose dynamics would silently differ from MuJoCo's.

    Raises:
        InputError: the first unsupported feature, and what to do.
    """
    if model.njnt == 0 or model.jnt_type[0] != mujoco.mjtJoint.mjJNT_FREE:
        raise InputError("The robot's first joint is not a free joint; give its base a <freejoint>.")
    if np.any(model.jnt_type[1:] != mujoco.mjtJoint.mjJNT_HINGE):
        raise InputError("The robot has a joint other than a hinge after the floating base; only hinges are supported.")
    if np.any(model.dof_armature[:6]) or np.any(model.dof_damping[:6]):
        raise InputError("The floating base has armature or damping; set both to zero.")
    option = model.opt
    if option.integrator != mujoco.mjtIntegrator.mjINT_IMPLICITFAST:
        raise InputError('The model\'s integrator is not supported; set <option integrator="implicitfast"/>.')
    if option.cone != mujoco.mjtCone.mjCONE_PYRAMIDAL:
        raise InputError('The model\'s friction cone is elliptic; set <option cone="pyramidal"/>.')
    if option.disableflags or option.enableflags:
        raise InputError("The model switches parts of MuJoCo on or off; remove <flag> from its options.")
    if option.density or option.viscosity:
        raise InputError("The model has air; set the density and viscosity of <option> to zero.")
    for unsupported, remedy in _features(model):
        if unsupported:
            raise InputError(f"The robot model {remedy}.")


def _features(model: mujoco.MjModel) -> list[tuple[bool, str]]:
    """Pairs of a test that must be false and the rest of the sentence."""
    motor = (
        (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED)
        & (model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE)
        & (model.actuator_dyntype == mujoco.mjtDyn.mjDYN_NONE)
        & (model.actuator_gainprm[:, 0] == 1)
        & np.isin(model.actuator_trntype, (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_TENDON))
    )
    return [
        (not np.all(motor), "has an actuator that is not a <motor> on a joint or tendon; make all of them motors"),
        (bool(np.any(model.wrap_type != mujoco.mjtWrap.mjWRAP_JOINT)), "has a spatial tendon; use <fixed> tendons"),
        (model.neq > 0, "has equality constraints; remove <equality>"),
        (
            bool(np.any(model.dof_frictionloss > 0) or np.any(model.tendon_frictionloss > 0)),
            "has dry friction; set frictionloss to zero or use damping",
        ),
        (
            bool(np.any(model.jnt_stiffness) or np.any(model.tendon_stiffness) or np.any(model.tendon_damping)),
            "has springs or damped tendons; use motors and joint damping",
        ),
        (bool(np.any(model.jnt_actfrclimited)), "has actuatorfrcrange on joints; use the motors' forcerange"),
        (bool(np.any(model.tendon_actfrclimited)), "has actuatorfrcrange on tendons; use the motors' forcerange"),
        (bool(np.any(model.body_gravcomp)), "has gravity compensation; set gravcomp to zero"),
        (
            bool(np.any(model.jnt_solimp[:, 4] != 2) or np.any(model.geom_solimp[:, 4] != 2)),
            "has an impedance that does not rise quadratically; set the last number of solimp to 2",
        ),
        (bool(np.any(model.tendon_limited)), "has limits on tendons; limit the joints"),
        (bool(np.any(model.dof_dampingpoly)), "has polynomial damping; use linear damping"),
    ]
