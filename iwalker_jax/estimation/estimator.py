"""The state estimator: readings in, position, velocity and attitude of the base out, once per control period.

An error-state filter: the gyro carries the attitude and the accelerometer the velocity; a Kalman filter
(`axis_filter`) estimates base, feet and the acceleration's error from leg kinematics of the standing feet, the floor
below them, and visual odometry's position. A horizontal acceleration error is a tilt error times gravity, so it turns
the attitude at once and starts from zero again; a vertical one is the accelerometer's bias. Leg odometry thereby tells
gravity from the sway of walking, which a filter that takes the accelerometer for the vertical cannot: such sway tilted
it by a degree. That older rule remains as a weak anchor for when no foot stands. Visual odometry gives the heading.

A foot is never switched: what the gait plan calls swing has a large process noise, so that it is forgotten, and no
weight in leg odometry. A delayed image is compared with the estimate remembered for the image's time, shifted by what
images have corrected since; the correction goes to the present, as over so short a delay odometry adds almost no
error of its own.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.estimation import axis_filter
from iwalker_jax.estimation.axis_filter import BIAS, DRIFT, LEFT_FOOT, POSITION, RIGHT_FOOT, VELOCITY, Belief
from iwalker_jax.estimation.parameters import EstimatorParameters
from iwalker_jax.estimation.readings import Readings, within_range
from iwalker_jax.estimation.state import EstimatorState
from iwalker_jax.geometry import rotations as attitude
from iwalker_jax.robot import LegKinematics, foot_motion

_FEET = (RIGHT_FOOT, LEFT_FOOT)


def estimate_step(
    parameters: EstimatorParameters,
    legs: LegKinematics,
    state: EstimatorState,
    readings: Readings,
    contacts: Float[Array, "2"],
) -> EstimatorState:
    """Advance the estimate by one control period with that period's readings.

    Args:
        parameters: what the filter believes about its sensors.
        legs: the robot's leg kinematics.
        state: the estimate one period ago.
        readings: of this period; what is NaN or out of range is left out and flagged in `health`.
        contacts: (2,) in [0, 1] which feet the gait plan has on the floor (right, left).
    """
    period = parameters.control_period
    contacts = jnp.clip(jnp.where(jnp.isfinite(contacts), contacts, 0), 0, 1)
    trust = jnp.minimum(contacts, state.contact_trust + period / parameters.contact_ramp)

    state, acceleration = _turn_and_accelerate(parameters, state, readings)
    belief = _predicted(parameters, state, acceleration, trust)
    state = _with_joints(parameters, legs, state, readings)
    belief, state = _legs_measured(parameters, legs, belief, state, trust)
    yaw_correction = -state.image_correction[3]
    belief, state = _image_measured(parameters, belief, state, readings)
    yaw_correction += state.image_correction[3]

    # A tilt error d (a rotation vector in the world) makes an acceleration error d x g.
    error_x, error_y, bias = belief.mean[BIAS]
    tilt = jnp.stack([error_y, -error_x, jnp.zeros_like(bias)]) / parameters.gravity
    share = period / parameters.doubt_time
    corrected = tilt.at[2].set(yaw_correction)
    mean_turn = state.mean_turn + share * (corrected / period - state.mean_turn)
    health = state.health._replace(gyro_doubted=jnp.sum(mean_turn**2) > parameters.doubted_turn**2)
    tilt = tilt @ attitude.rotation_matrix(state.quaternion)
    return state._replace(
        mean_turn=mean_turn,
        health=health,
        quaternion=attitude.turn_in_body(state.quaternion, tilt),
        gyro_bias=state.gyro_bias - parameters.gyro_bias_gain * tilt,
        position=belief.mean[POSITION],
        velocity=belief.mean[VELOCITY],
        accelerometer_bias=bias,
        feet=belief.mean[RIGHT_FOOT : LEFT_FOOT + 1],
        odometry_drift=belief.mean[DRIFT],
        covariance=belief.covariance,
        contact_trust=trust,
    )


def _turn_and_accelerate(
    parameters: EstimatorParameters, state: EstimatorState, readings: Readings
) -> tuple[EstimatorState, Float[Array, "3"]]:
    """Attitude one period later, and the measured acceleration in world axes over the period [m/s^2]."""
    period = parameters.control_period
    gyro_usable = jnp.all(within_range(readings.gyro, parameters.gyro_range))
    force_usable = jnp.all(within_range(readings.accelerometer, parameters.accelerometer_range))
    rotation = attitude.rotation_matrix(state.quaternion)
    vertical = rotation[2]
    at_rest = (parameters.gravity + state.accelerometer_bias) * vertical
    force = jnp.where(force_usable, readings.accelerometer, at_rest)
    angular_velocity = jnp.where(gyro_usable, readings.gyro - state.gyro_bias, state.angular_velocity)
    # The specific force belongs to the attitude at the beginning of the period.
    error = attitude.tilt_error(vertical, force, parameters.gravity, parameters.tilt_gate)
    turn = period * (angular_velocity + parameters.tilt_rate * error)
    acceleration = rotation @ force - jnp.asarray([0, 0, 1], force.dtype) * parameters.gravity
    share = period / parameters.doubt_time
    mean_acceleration = state.mean_acceleration + share * (acceleration - state.mean_acceleration)
    health = state.health._replace(
        gyro_rejected=~gyro_usable,
        accelerometer_rejected=~force_usable,
        accelerometer_doubted=jnp.sum(mean_acceleration**2) > parameters.doubted_acceleration**2,
    )
    state = state._replace(
        quaternion=attitude.turn_in_body(state.quaternion, turn),
        angular_velocity=angular_velocity,
        mean_acceleration=mean_acceleration,
        health=health,
    )
    return state, acceleration


def _predicted(
    parameters: EstimatorParameters, state: EstimatorState, acceleration: Float[Array, "3"], trust: Float[Array, "2"]
) -> Belief:
    """Belief carried over the period."""
    period = parameters.control_period
    bias = state.accelerometer_bias * jnp.asarray([0, 0, 1], acceleration.dtype)
    considered = jnp.zeros_like(bias)
    mean = jnp.stack([state.position, state.velocity, bias, *state.feet, considered, state.odometry_drift])
    std = jnp.where(
        state.health.accelerometer_rejected, parameters.missing_acceleration_noise, parameters.acceleration_noise
    )
    feet = trust * parameters.stance_walk**2 + (1 - trust) * parameters.swing_walk**2
    # Turning unseen for a period tilts, and tilt times gravity is an acceleration error.
    unseen = jnp.where(state.health.gyro_rejected, parameters.gravity * parameters.missing_gyro_noise, 0)
    error = parameters.acceleration_error_walk**2 + period * unseen**2
    zero = jnp.zeros_like(error)
    speed = jnp.sqrt(
        jnp.sum(state.velocity[:2] ** 2) + 1e-6
    )  # a standing robot's odometry rests, the derivative is there
    horizontal = jnp.stack([zero, zero, error, *feet, zero, speed * parameters.image_drift**2])
    vertical = jnp.stack([zero, zero, zero + parameters.vertical_error_walk**2, *feet, zero, zero])
    drift = period * jnp.stack([horizontal, vertical])
    return axis_filter.predict(Belief(mean, state.covariance), acceleration, period, std**2, drift)


def _with_joints(
    parameters: EstimatorParameters, legs: LegKinematics, state: EstimatorState, readings: Readings
) -> EstimatorState:
    """Take over the joint readings that can be believed and hold the others."""
    usable = within_range(readings.joint_positions, parameters.joint_position_range)
    usable &= within_range(readings.joint_velocities, parameters.joint_velocity_range)
    count = legs.axes.shape[1]
    by_leg = jnp.stack([jnp.all(usable[start : start + count]) for start in legs.starts])
    return state._replace(
        joint_positions=jnp.where(usable, readings.joint_positions, state.joint_positions),
        joint_velocities=jnp.where(usable, readings.joint_velocities, state.joint_velocities),
        health=state.health._replace(joints_rejected=~by_leg),
    )


def _legs_measured(
    parameters: EstimatorParameters,
    legs: LegKinematics,
    belief: Belief,
    state: EstimatorState,
    trust: Float[Array, "2"],
) -> tuple[Belief, EstimatorState]:
    """Leg kinematics: where the feet are, how fast the base moves past those that stand, how high it is above them."""
    gate = parameters.outlier_gate
    rotation = attitude.rotation_matrix(state.quaternion)
    motion = foot_motion(legs, state.joint_positions, state.joint_velocities)
    position = motion.position @ rotation.T
    velocity = (motion.velocity + jnp.cross(state.angular_velocity, motion.position)) @ rotation.T
    usable = 1 - state.health.joints_rejected.astype(trust.dtype)
    standing = trust * usable
    everywhere, upwards = jnp.ones(2, trust.dtype), jnp.asarray([0, 1], trust.dtype)

    residuals = []
    variance = jnp.zeros_like(trust[0]) + parameters.foot_position_noise**2
    for foot, state_index in enumerate(_FEET):
        row = axis_filter.measures_foot(state_index, -position[foot, 2], parameters.gravity)
        tilted = belief.mean[BIAS] * jnp.stack([row[0, BIAS], row[0, BIAS], row[1, BIAS]])
        innovation = position[foot] - belief.mean[state_index] - tilted
        belief, residual = axis_filter.update(belief, row, innovation, variance, usable[foot] * everywhere, gate)
        residuals.append(residual)

    # A standing foot does not move: the base's velocity is the negative of the foot's relative to it.
    total = jnp.sum(standing)
    odometry = -(standing @ velocity) / jnp.maximum(total, 1e-3)
    variance = jnp.zeros_like(total) + parameters.foot_velocity_noise**2
    belief, velocity_residual = axis_filter.update(
        belief, axis_filter.measures(VELOCITY), odometry - belief.mean[VELOCITY], variance, total * everywhere, gate
    )

    variance = jnp.zeros_like(total) + parameters.foot_height_noise**2
    for foot, state_index in enumerate(_FEET):
        innovation = -(belief.mean[POSITION] + belief.mean[state_index])
        weight = parameters.flat_floor * standing[foot] * upwards
        belief, _ = axis_filter.update(
            belief, axis_filter.measures(POSITION, state_index), innovation, variance, weight, gate
        )

    health = state.health._replace(
        foot_residual=jnp.stack(residuals) * usable,
        velocity_residual=jnp.where(total > 0, velocity_residual, 0),
    )
    return belief, state._replace(health=health)


def _image_measured(
    parameters: EstimatorParameters, belief: Belief, state: EstimatorState, readings: Readings
) -> tuple[Belief, EstimatorState]:
    """Remember this period's pose, and correct by the visual odometry that arrived, if any."""
    past = state.memory[0] + state.image_correction
    turned = attitude.wrap_angle(attitude.yaw_of(state.quaternion) - past[3])
    pose = jnp.concatenate([belief.mean[POSITION], (past[3] + turned)[None]])
    memory = jnp.concatenate([(pose - state.image_correction)[None], state.memory[:-1]])

    image = jnp.concatenate([readings.image_position, readings.image_yaw[None]])
    ticks = memory.shape[0]
    age = readings.image_age / parameters.control_period
    usable = jnp.all(jnp.isfinite(image)) & (age >= 0) & (age <= ticks - 1)
    used = readings.image_arrived & usable
    # Weights of linear interpolation between the two remembered poses around the image's time.
    hat = jnp.maximum(0, 1 - jnp.abs(jnp.arange(ticks) - jnp.where(used, age, 0)))
    drifted = jnp.append(belief.mean[DRIFT], 0)
    innovation = jnp.where(used, image - hat @ memory - state.image_correction - drifted, 0)
    yaw = jnp.clip(attitude.wrap_angle(innovation[3]), -parameters.yaw_gate, parameters.yaw_gate)

    before = belief.mean[POSITION]
    weight = jnp.ones(2, pose.dtype) * used
    variance = jnp.zeros_like(age) + parameters.image_position_noise**2
    belief, residual = axis_filter.update(
        belief, axis_filter.measures(POSITION, DRIFT), innovation[:3], variance, weight, parameters.outlier_gate
    )
    turn = parameters.yaw_gain * yaw
    correction = jnp.concatenate([belief.mean[POSITION] - before, turn[None]])
    vertical = attitude.rotation_matrix(state.quaternion)[2]
    health = state.health._replace(
        image_rejected=readings.image_arrived & ~usable, image_residual=jnp.where(used, residual, 0)
    )
    return belief, state._replace(
        quaternion=attitude.turn_about_vertical(state.quaternion, turn),
        gyro_bias=state.gyro_bias - parameters.yaw_bias_gain * yaw * vertical,
        memory=memory,
        image_correction=state.image_correction + correction,
        health=health,
    )
