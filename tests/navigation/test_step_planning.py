"""From paths to footsteps. Oracles: multiples of the step length and of the largest turn, sides in NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from iwalker_jax.errors import InputError
from iwalker_jax.navigation.step_planning import (
    PursuitParameters,
    Stance,
    centre_of,
    has_nothing_to_do,
    plan_steps,
    pursue,
    stop_steps,
)
from iwalker_jax.planning.istepper import IStepper, IStepperConfig
from iwalker_jax.planning.robot_state import StepGeometry

PARAMETERS, STEPS = PursuitParameters(), StepGeometry()
follow = jax.jit(lambda path, face_point, centre, heading: pursue(PARAMETERS, STEPS, path, face_point, centre, heading))
STRAIGHT = np.stack([np.linspace(0, 3, 60), np.zeros(60)], axis=1)
NOWHERE = np.zeros((60, 2))


def course(path, face_point=(5.0, 0.0), centre=(0.0, 0.0), heading=0.0):
    return follow(*(jnp.asarray(value, jnp.float32) for value in (path, face_point, centre, heading)))


def _direction(heading) -> np.ndarray:
    """Unit vectors of headings [rad]."""
    return np.stack([np.cos(heading), np.sin(heading)], axis=-1)


def stance(left: bool, yaw: float = 0.0) -> Stance:
    side = 0.05 if left else -0.05
    foot = jnp.asarray([-side * np.sin(yaw), side * np.cos(yaw)], jnp.float32)
    return Stance(jnp.zeros(2), jnp.zeros(2), foot, jnp.asarray(yaw), jnp.asarray(int(left)), jnp.asarray(0.0))


@pytest.fixture(scope="module")
def istepper():
    """Without corrections: the nominal footsteps beside the line."""
    network = IStepper(IStepperConfig(), STEPS, nnx.Rngs(0))
    network.layer3.kernel[...] = jnp.zeros_like(network.layer3.kernel[...])
    network.layer3.bias[...] = jnp.zeros_like(network.layer3.bias[...])
    return network


def test_a_path_straight_ahead_is_walked_at_the_nominal_step():
    """Oracle: multiples of the step length."""
    line = course(STRAIGHT)
    np.testing.assert_allclose(line.centres[:, 0], STEPS.length * np.arange(STEPS.count + 1), atol=1e-5)
    np.testing.assert_allclose(line.centres[:, 1], 0.0, atol=1e-6)
    assert not line.turning


@pytest.mark.parametrize("angle", [-0.6, 0.5])
def test_turns_are_bounded_and_lead_onto_the_path(angle):
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    line = course(STRAIGHT @ rotation)
    assert np.abs(np.diff(line.headings)).max() < PARAMETERS.max_turn + 1e-5
    steps, middle = np.diff(line.centres, axis=0), (line.headings[1:] + line.headings[:-1]) / 2
    ahead, aside = (np.sum(steps * axis, axis=1) for axis in (_direction(middle), _direction(middle + np.pi / 2)))
    np.testing.assert_allclose(ahead, STEPS.length, atol=1e-5)
    assert np.abs(aside).max() <= PARAMETERS.max_return + 1e-5
    along = np.asarray(line.centres) @ rotation.T
    assert abs(along[-1, 1]) < 0.05 and abs(float(line.headings[-1]) - angle) < 0.1


def test_a_robot_whose_feet_land_aside_keeps_to_its_path():
    """Every foot lands 8 mm to the left. Oracle: the path; turns alone hold the middle 3 cm beside it."""
    at, heading, beside = np.zeros(2), 0.0, []
    for _ in range(30):
        line = course(STRAIGHT, centre=at, heading=heading)
        at, heading = np.asarray(line.centres[1]) + np.array([0.0, 0.008]), float(line.headings[1])
        beside.append(abs(at[1]))
    assert max(beside) < 0.012


def test_a_path_behind_the_robot_is_first_turned_to_on_the_spot():
    """Oracle: heading after n bounded turns, and no advance."""
    line = course(-STRAIGHT + [0.0, 0.01])
    assert line.turning
    np.testing.assert_allclose(line.centres, 0.0, atol=1e-6)
    assert abs(abs(float(line.headings[5])) - 5 * PARAMETERS.max_turn) < 1e-4
    assert abs(abs(float(line.headings[-1])) - np.pi) < 0.1


def test_without_a_path_the_robot_faces_the_point_to_face():
    line = course(NOWHERE, face_point=(0.0, 2.0))
    assert line.turning
    assert abs(float(line.headings[-1]) - np.pi / 2) < 0.05
    still = course(NOWHERE, face_point=(2.0, 0.1))
    assert not still.turning
    np.testing.assert_allclose(still.headings, 0.0, atol=1e-6)


def test_the_end_of_a_path_is_not_overrun():
    line = course(STRAIGHT[:8])
    end = STRAIGHT[7, 0]
    assert abs(float(line.centres[-1, 0]) - end) < 0.03


@pytest.mark.parametrize("left", [True, False])
@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_footsteps_alternate_beside_the_line(istepper, left, yaw):
    """Oracle: sides in NumPy; the swing foot of a left stance is the right one."""
    turned = STRAIGHT @ np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    path, face_point = jnp.asarray(turned, jnp.float32), jnp.asarray([5.0, 0.0])
    plan, _ = plan_steps(PARAMETERS, istepper, path, face_point, stance(left, yaw), jnp.zeros(2))
    across = np.asarray(plan.positions) @ [-np.sin(yaw), np.cos(yaw)]
    sides = np.where(np.arange(STEPS.count) % 2 == 0, -1, 1) * (1 if left else -1)
    np.testing.assert_allclose(across, sides * STEPS.width / 2, atol=5e-3)
    np.testing.assert_allclose(plan.yaws, yaw, atol=1e-3)
    assert int(plan.first_swing) == (0 if left else 1)


def test_a_turn_on_the_spot_does_not_drift_with_feet_that_land_beside_their_footsteps(istepper):
    """Every foot lands 1 cm off. Oracle: the spot; planned from the feet alone the middle goes 4 cm in eight steps."""
    nowhere, behind = jnp.asarray(NOWHERE, jnp.float32), jnp.asarray([-3.0, 0.0])
    plan = jax.jit(lambda stance, spot: plan_steps(PARAMETERS, istepper, nowhere, behind, stance, spot))
    spot, foot, side, yaw, middles = jnp.zeros(2), jnp.asarray([0.0, 0.05]), 1, 0.0, []
    for _ in range(16):
        stands = Stance(foot, jnp.zeros(2), foot, jnp.asarray(yaw), jnp.asarray(side), jnp.asarray(0.0))
        middles.append(centre_of(stands, STEPS.width))
        steps, spot = plan(stands, spot)
        foot, yaw, side = steps.positions[0] + jnp.asarray([0.006, 0.008]), float(steps.yaws[0]), 1 - side
    np.testing.assert_allclose(spot, 0.0, atol=1e-6)
    assert np.linalg.norm(middles, axis=1).max() < 0.02


@pytest.mark.parametrize(
    ("path", "face_point", "stands"),
    [(NOWHERE, (2.0, 0.1), True), (NOWHERE, (0.0, 2.0), False), (STRAIGHT, (2.0, 0.1), False)],
    ids=["no way", "no way, but somewhere to look", "a way"],
)
def test_a_robot_without_a_way_stands_instead_of_stepping_on_the_spot(path, face_point, stands):
    path, face_point = jnp.asarray(path, jnp.float32), jnp.asarray(face_point)
    assert bool(has_nothing_to_do(PARAMETERS, path, face_point, jnp.zeros(3))) == stands


def test_stopping_takes_two_steps_on_the_spot():
    plan = stop_steps(STEPS.count, STEPS.width, stance(True))
    assert int(plan.count) == 2
    np.testing.assert_allclose(plan.positions[0], [0.0, -0.05], atol=1e-6)
    np.testing.assert_allclose(plan.positions[1], [0.0, 0.05], atol=1e-6)


def test_useless_parameters_are_refused():
    with pytest.raises(InputError, match="positive"):
        PursuitParameters(lookahead=-1.0)
