"""The one door to MJX; quiet, because importing it prints that an optional back end is absent."""

import contextlib
import io

from jaxtyping import Array, Float

with contextlib.redirect_stdout(io.StringIO()):
    from mujoco import mjx

__all__ = ["body_poses", "mjx"]


def body_poses(
    model: mjx.Model, qpos: Float[Array, " nq"]
) -> tuple[Float[Array, "nbody 3"], Float[Array, "nbody 3 3"]]:
    """World positions [m] and rotations (body to world axes) of all of a model's bodies, in MuJoCo's order.

    MJX's own kinematics: those of `dynamics` have the links that move, not every body that is fixed to one.

    Args:
        qpos: (nq,) base position [m] and quaternion (wxyz), joint positions [rad].
    """
    data = mjx.kinematics(model, mjx.make_data(model).replace(qpos=qpos))
    return data.xpos, data.xmat
