"""The physics step against C MuJoCo and `mjx.step`, its gradients against central differences, and its batches."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from mujoco import mjx

from iwalker_jax.robot.physics import initial_state, physics_step
from iwalker_jax.robot.structure import contact_point_names
from iwalker_jax.robot.variation import vary, vary_mujoco

STEPS = 100


@jax.jit
def roll(robot, state, torques, wrenches):
    """Open-loop roll-out: states before and what happened in each step."""

    def step(state, inputs):
        moved, info = physics_step(robot, state, *inputs)
        return moved, (moved, info)

    return jax.lax.scan(step, state, (torques, wrenches))[1]


def mujoco_roll(model, qpos, qvel, torques, wrenches):
    """The same by C MuJoCo."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, qvel
    points = {model.geom(name).id: k for k, name in enumerate(contact_point_names(model))}
    record = {name: [] for name in ("qpos", "qvel", "acceleration", "forces", "gyro", "accelerometer")}
    for torque, wrench in zip(torques, wrenches, strict=True):
        data.ctrl[:], data.xfrc_applied[1] = torque, wrench
        mujoco.mj_step(model, data)
        forces, local = np.zeros((4, 3)), np.zeros(6)
        for k, contact in enumerate(data.contact):
            mujoco.mj_contactForce(model, data, k, local)
            forces[points[contact.geom[1]]] += local[:3] @ contact.frame.reshape(3, 3)
        values = (data.qpos, data.qvel, data.qacc, forces, data.sensordata[4:7], data.sensordata[7:10])
        for name, value in zip(record, values, strict=True):
            record[name].append(np.array(value))
    return {name: np.array(values) for name, values in record.items()}


def scenario(name, model, rng):
    """Start and inputs: standing, falling over, flying with joints beyond their limits, or pushed."""
    qpos, qvel = model.key_qpos[0].copy(), 0.3 * rng.normal(size=model.nv)
    torques, wrenches = rng.normal(size=(STEPS, model.nu)), np.zeros((STEPS, 6))
    if name == "standing":
        # Clearly in contact: the home posture touches to within rounding.
        qpos[2] -= 0.0005
        qvel, torques = 0.1 * qvel, 0.1 * torques
    if name == "falling":
        qpos[2] += 0.05
        qvel[2:6] = [-1.0, 1.0, 3.0, 1.0]
    if name == "limits":
        qpos[2] += 0.5
        qpos[7:] += 0.8 * rng.choice([-1.0, 1.0], 16)
    if name == "pushed":
        wrenches[20:60] = [15.0, -10.0, 5.0, 0.5, -0.5, 0.3]
    return qpos, qvel, torques, wrenches


CHANGES = {"mass_scale": 1.1, "friction": 0.4, "com_shift": np.array([0.01, 0.0, 0.01]), "armature_scale": 1.2}


def compare(robot, model, inputs, tolerance):
    qpos, qvel, torques, wrenches = inputs
    dtype = robot.home.dtype
    start = initial_state(robot, jnp.asarray(qpos, dtype), jnp.asarray(qvel, dtype))
    states, info = roll(robot, start, jnp.asarray(torques, dtype), jnp.asarray(wrenches, dtype))
    expected = mujoco_roll(model, *inputs)
    ours = {
        "qpos": states.qpos,
        "qvel": states.qvel,
        "acceleration": info.acceleration,
        "forces": info.contact_forces,
        "gyro": info.gyro,
        "accelerometer": info.accelerometer,
    }
    for name, values in ours.items():
        scale = np.maximum(1.0, np.abs(expected[name]).max())
        np.testing.assert_allclose(values, expected[name], atol=tolerance * scale, err_msg=name)
    return states, info


@pytest.mark.parametrize("name", ["standing", "falling", "limits", "pushed"])
def test_steps_are_mujocos(robot64, bruce, x64, rng, name):
    _, info = compare(robot64, bruce, scenario(name, bruce, rng), 1e-8)
    assert info.residual.max() < 1e-11
    assert jnp.all(info.touching == jnp.any(info.contact_forces != 0, axis=2))
    if name == "limits":
        assert not jnp.any(info.touching[0])
        assert jnp.all(info.contact_distances[0] > 0)


def test_steps_of_a_varied_robot_are_mujocos(robot64, bruce, x64, rng):
    compare(vary(robot64, **CHANGES), vary_mujoco(bruce, **CHANGES), scenario("pushed", bruce, rng), 1e-8)


def test_damped_steps_are_mujocos(robot64, bruce, x64, rng):
    damped = {"joint_damping": 0.1}
    compare(vary(robot64, **damped), vary_mujoco(bruce, **damped), scenario("pushed", bruce, rng), 1e-8)


def test_single_precision(robot, bruce, rng):
    """On slippery ground, where an unconverged solver makes robots fall; errors stay at rounding over 0.2 s."""
    slippery = {"friction": 0.4}
    inputs = scenario("standing", bruce, rng)
    _, info = compare(vary(robot, **slippery), vary_mujoco(bruce, **slippery), inputs, 2e-3)
    assert info.residual.max() < 1e-3


def test_a_step_is_mjx_step(robot64, bruce, x64, rng):
    """Value by value after one and after 20 steps; MJX's own solver is given as many iterations as it needs."""
    qpos, qvel, torques, _ = scenario("standing", bruce, rng)
    model = mjx.put_model(bruce, impl="jax")
    data = mjx.make_data(model, impl="jax").replace(qpos=jnp.asarray(qpos), qvel=jnp.asarray(qvel))

    @jax.jit
    def theirs(data, torques):
        data = mjx.forward(model, data)

        def step(data, torque):
            data = mjx.step(model, data.replace(ctrl=torque))
            return data, (data.qpos, data.qvel, data.qacc)

        return jax.lax.scan(step, data, torques)[1]

    expected = theirs(data, jnp.asarray(torques))
    states, info = roll(
        robot64, initial_state(robot64, data.qpos, data.qvel), jnp.asarray(torques), jnp.zeros((STEPS, 6))
    )
    for ours, value in zip((states.qpos, states.qvel, info.acceleration), expected, strict=True):
        np.testing.assert_allclose(ours, value, atol=1e-9 * np.abs(value).max())


def standing(robot, qpos, qvel, torques):
    """Numbers of the robot's state after 1, 10, 50 and 200 steps under joint feedback plus constant torques."""
    to_motors = jnp.linalg.inv(robot.motor_moments[:, 6:].T)
    stiffness = jnp.asarray([100.0] * 10 + [2.0] * 6)
    damping = jnp.asarray([1.0, 1.0, 1.0, 1.0, 0.3] * 2 + [0.02] * 6)
    weights = jnp.linspace(-1, 1, qpos.size), jnp.linspace(1, -0.5, qvel.size)

    def step(state, _):
        wanted = stiffness * (robot.home[7:] - state.qpos[7:]) - damping * state.qvel[6:]
        moved, info = physics_step(robot, state, to_motors @ wanted + torques)
        return moved, (weights[0] @ moved.qpos + 0.1 * weights[1] @ moved.qvel, info.touching)

    _, (numbers, touching) = jax.lax.scan(step, initial_state(robot, qpos, qvel), None, length=200)
    return numbers[jnp.array([0, 9, 49, 199])], touching


def test_gradients_through_contact(robot64, x64):
    """Standing on four points, after 1, 10, 50 and 200 steps, with respect to state and torques."""
    rng = np.random.default_rng(0)
    inputs = (
        robot64.home.at[2].add(-0.0005),
        jnp.asarray(0.02 * rng.normal(size=22)),
        jnp.asarray(0.05 * rng.normal(size=16)),
    )
    value = jax.jit(lambda robot, inputs: standing(robot, *inputs))
    _, touching = value(robot64, inputs)
    assert jnp.all(touching), "the scenario is meant to stay in contact"
    reverse = jax.jit(lambda robot, inputs, ct: jax.vjp(lambda *x: standing(robot, *x)[0], *inputs)[1](ct))
    forward = jax.jit(lambda robot, inputs, change: jax.jvp(lambda *x: standing(robot, *x)[0], inputs, change)[1])
    rows = [reverse(robot64, inputs, jnp.eye(4)[k]) for k in range(4)]
    for k, of in enumerate(inputs):
        direction = jnp.asarray(rng.normal(size=of.shape))
        change = tuple(direction if i == k else jnp.zeros_like(x) for i, x in enumerate(inputs))
        along = forward(robot64, inputs, change)
        ahead, behind = (
            value(robot64, jax.tree.map(lambda x, d, s=s: x + s * d, inputs, change))[0] for s in (1e-7, -1e-7)
        )
        numeric = (ahead - behind) / 2e-7
        for n in range(4):
            scale = max(abs(float(numeric[n])), float(jnp.linalg.norm(rows[n][k])))
            assert abs(float(rows[n][k] @ direction - along[n])) <= 1e-9 * scale
            assert abs(float(along[n] - numeric[n])) <= 1e-5 * scale, (k, n, along[n], numeric[n])


def test_a_batch_equals_a_loop_and_nan_stays_alone(robot, bruce, rng):
    """Neighbours change a robot by rounding alone, and a NaN not at all."""
    inputs = [scenario(name, bruce, rng) for name in ("standing", "falling", "limits", "pushed")]
    qpos, qvel, torques, wrenches = (jnp.asarray(np.array(x), jnp.float32) for x in zip(*inputs, strict=True))
    start = jax.vmap(lambda q, v: initial_state(robot, q, v))(qpos, qvel)
    batch = jax.jit(jax.vmap(roll, in_axes=(None, 0, 0, 0)))
    clean, clean_info = batch(robot, start, torques, wrenches)
    alone, _ = roll(robot, jax.tree.map(lambda x: x[3], start), torques[3], wrenches[3])
    np.testing.assert_allclose(clean.qpos[3], alone.qpos, atol=2e-3)
    spoiled, spoiled_info = batch(robot, start._replace(qvel=start.qvel.at[1, 8].set(jnp.nan)), torques, wrenches)
    others = jnp.array([0, 2, 3])
    np.testing.assert_array_equal(spoiled.qpos[others], clean.qpos[others])
    np.testing.assert_array_equal(spoiled_info.iterations[others], clean_info.iterations[others])
    assert jnp.all(spoiled_info.iterations[1] == 0)
    assert not jnp.any(jnp.isfinite(spoiled.qvel[1]))


def test_time_and_warm_start_are_carried(robot):
    start = initial_state(robot)
    states, info = roll(robot, start, jnp.zeros((STEPS, 16)), jnp.zeros((STEPS, 6)))
    np.testing.assert_allclose(states.time, 0.002 * (1 + np.arange(STEPS)), rtol=1e-5)
    np.testing.assert_array_equal(states.warmstart, info.acceleration)
