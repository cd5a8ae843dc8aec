"""MJX against C MuJoCo in double precision: the mass matrix with its tendon armature, contact steps and sensors."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import mjx

from bruce_model import crouch_joints
from tests.bruce_model.numpy_robot import link_mass_matrix, rotor_matrix


def test_fifty_contact_steps_and_the_mass_matrix_agree(model, x64):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("crouch").id)
    mjx_model = mjx.put_model(model, impl="jax")
    mjx_data = mjx.put_data(model, data, impl="jax")
    step = jax.jit(mjx.step)
    to_motors = np.linalg.inv(joint_torques_of_motors(model))
    rng = np.random.default_rng(8)
    touching = 0
    for _ in range(50):
        joint_torque = 60 * (crouch_joints() - data.qpos[7:]) - 1.0 * data.qvel[6:]
        noise = rng.uniform(-0.2, 0.2, model.nu) * model.actuator_forcerange[:, 1]
        data.ctrl[:] = to_motors @ joint_torque + noise
        before = data.qpos.copy()
        mjx_data = step(mjx_model, mjx_data.replace(ctrl=jnp.asarray(data.ctrl)))
        mujoco.mj_step(model, data)
        touching += data.ncon > 0
        np.testing.assert_allclose(mjx_data.qpos, data.qpos, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(mjx_data.qvel, data.qvel, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(mjx_data.sensordata, data.sensordata, rtol=1e-9, atol=1e-8)
    assert touching > 40
    assert np.max(np.abs(data.qvel)) > 0.1
    # `before` is the configuration at which the last step formed M; M is stored dense for so few joints.
    mass = np.asarray(mjx_data._impl.M)
    np.testing.assert_allclose(mass, link_mass_matrix(before) + rotor_matrix(), atol=1e-10)


def joint_torques_of_motors(model: mujoco.MjModel) -> np.ndarray:
    """Matrix (16, 16) from motor torques to joint torques, from MuJoCo's sparse transmission."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    moment = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(moment, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
    return moment[:, 6:].T
