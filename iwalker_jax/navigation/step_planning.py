"""From a path to the next footsteps: a centre line the robot can turn along, then iStepper, or turning on the spot."""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.control import FootstepPlan
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import (
    angle_between,
    arc_length,
    footstep_signs,
    interpolate_along,
    other_side,
    resample_by_arc_length,
    safe_sqrt,
    side_sign,
    to_base,
    to_world,
    turn,
)
from iwalker_jax.planning import PATH_POINTS, IStepper, RobotState, StepGeometry


@dataclass(frozen=True)
class PursuitParameters:
    """How sharply the robot turns towards a path.

    Attributes:
        lookahead: [m] along the path to the point that the robot heads for.
        max_turn: [rad] largest change of heading in one step.
        turn_in_place: [rad] angle to the path from which the robot turns without advancing.
        min_length: [m] of a path below which there is nowhere to go.
        face_tolerance: [rad] angle to the point to face below which the robot need not turn.
        end_radius: [m] about the point that the robot heads for, within which it keeps its heading.
        max_return: [m] by which a footstep aside brings the robot back to its path, or to the spot that it steps on.
    """

    lookahead: float = 0.24
    max_turn: float = 0.20
    turn_in_place: float = 0.7
    min_length: float = 0.06
    face_tolerance: float = 0.3
    end_radius: float = 0.05
    max_return: float = 0.02

    def __post_init__(self) -> None:
        if not min(self.lookahead, self.min_length, self.face_tolerance, self.end_radius) > 0 or self.max_return < 0:
            raise InputError(
                "PursuitParameters needs positive lookahead, min_length, face_tolerance and end_radius, and "
                "max_return >= 0."
            )
        if not (0 < self.max_turn < 1 and 0 < self.turn_in_place < 3):
            raise InputError("PursuitParameters needs max_turn in (0, 1) rad and turn_in_place in (0, 3) rad.")


class Stance(NamedTuple):
    """Where the next steps start from, world frame.

    Attributes:
        com, com_velocity: (2,) [m, m/s].
        foot: (2,) [m] and yaw: () [rad] of the stance foot.
        side: () int32, the `Side` of the stance foot.
        time: () [s] since the last touchdown.
    """

    com: Float[Array, "2"]
    com_velocity: Float[Array, "2"]
    foot: Float[Array, "2"]
    yaw: Float[Array, ""]
    side: Int[Array, ""]
    time: Float[Array, ""]


class Course(NamedTuple):
    """A centre line for the next steps.

    Attributes:
        centres: (m + 1, 2) [m] world and headings: (m + 1,) [rad], the present ones first.
        turning: () bool, on the spot.
        advancing: () bool; neither turning nor advancing, the robot has nowhere to go and stands or steps on the spot.
    """

    centres: Float[Array, "m1 2"]
    headings: Float[Array, " m1"]
    turning: Bool[Array, ""]
    advancing: Bool[Array, ""]


def pursue(
    parameters: PursuitParameters,
    steps: StepGeometry,
    path: Float[Array, "k 2"],
    face_point: Float[Array, "2"],
    centre: Float[Array, "2"],
    heading: Float[Array, ""],
) -> Course:
    """Pure pursuit of a path with bounded turns and short steps aside, one point a step.

    Args:
        parameters: of the pursuit.
        steps: advance of a step, and how many to take.
        path: (k, 2) [m] world.
        face_point: (2,) [m] world, where to turn to if the path is short.
        centre: (2,) [m] middle between the feet's tracks.
        heading: () [rad].
    """
    lengths = arc_length(path)
    long = lengths[-1] > parameters.min_length

    def bearing(at: Float[Array, "2"], towards: Float[Array, ""]) -> tuple[Array, Array]:
        """Angle to turn by, and the way left, at a place."""
        nearest = jnp.argmin(jnp.sum((path - at) ** 2, axis=-1))
        ahead = interpolate_along(lengths, path, (lengths[nearest] + parameters.lookahead)[None])[0]
        left_over = lengths[-1] - lengths[nearest]
        target = jnp.where(long, ahead, face_point)
        offset = target - at
        # So near its end the path has no direction any more: keep the heading.
        near = jnp.sum(offset**2) < parameters.end_radius**2
        return jnp.where(near, 0.0, angle_between(jnp.arctan2(offset[1], offset[0]), towards)), left_over

    first, _ = bearing(centre, heading)
    turning = jnp.abs(first) > jnp.where(long, parameters.turn_in_place, parameters.face_tolerance)
    advancing = long & ~turning

    def step(carry: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        at, yaw = carry
        error, left_over = bearing(at, yaw)
        turned = jnp.clip(error, -parameters.max_turn, parameters.max_turn) * (turning | advancing)
        advance = jnp.where(advancing, jnp.minimum(steps.length, left_over), 0.0)
        middle = yaw + turned / 2
        at = at + advance * jnp.stack([jnp.cos(middle), jnp.sin(middle)])
        # A step aside brings the robot back to the path sooner than a turn, and without one.
        left = jnp.stack([-jnp.sin(middle), jnp.cos(middle)])
        aside = jnp.dot(path[jnp.argmin(jnp.sum((path - at) ** 2, axis=-1))] - at, left)
        at = at + jnp.clip(aside, -parameters.max_return, parameters.max_return) * left * advancing
        return (at, yaw + turned), (at, yaw + turned)

    _, (centres, headings) = jax.lax.scan(step, (centre, heading), None, length=steps.count)
    centres, headings = jnp.concatenate([centre[None], centres]), jnp.concatenate([heading[None], headings])
    return Course(centres, headings, turning, advancing)


def held_on_spot(
    parameters: PursuitParameters, course: Course, spot: Float[Array, "2"]
) -> tuple[Course, Float[Array, "2"]]:
    """The course of a robot that does not advance brought back to its spot [m], and the spot, which else moves along.

    Feet land beside their footsteps; planned from where they stand alone, a turn on the spot would drift with them.
    """
    centre = course.centres[0]
    spot = jnp.where(course.advancing, centre, spot)
    back = spot - centre
    back = back * jnp.minimum(1.0, parameters.max_return / safe_sqrt(jnp.sum(back**2) + 1e-12))
    return course._replace(centres=course.centres + back), spot


def footsteps_beside(course: Course, stance_sign: Float[Array, ""], width: float) -> Float[Array, "m 2"]:
    """Footsteps [m] beside the centre line, left and right in turn, after a stance foot of the given `side_sign`."""
    yaw = course.headings[1:]
    signs = footstep_signs(stance_sign, len(yaw))[:, None]
    return course.centres[1:] + signs * width / 2 * jnp.stack([-jnp.sin(yaw), jnp.cos(yaw)], axis=-1)


def plan_steps(
    parameters: PursuitParameters | None,
    istepper: IStepper,
    path: Float[Array, "k 2"],
    face_point: Float[Array, "2"],
    stance: Stance,
    spot: Float[Array, "2"],
) -> tuple[FootstepPlan, Float[Array, "2"]]:
    """The next footsteps along a path, and the middle between the tracks that they hold if they do not advance.

    Args:
        parameters: None hands the path to iStepper as it is, as published; feet then point along it.
        istepper: the network.
        path, face_point: as in `pursue`.
        stance: where the steps start from.
        spot: (2,) [m] as the footsteps before returned it, see `held_on_spot`.
    """
    steps = istepper.geometry
    pursuit = PursuitParameters() if parameters is None else parameters
    centre = centre_of(stance, steps.width)
    course = pursue(pursuit, steps, path, face_point, centre, stance.yaw)
    course, spot = held_on_spot(pursuit, course, spot)
    geometric = footsteps_beside(course, _stance_sign(stance), steps.width)
    frame = jnp.append(stance.com, stance.yaw)
    line = resample_by_arc_length(path if parameters is None else course.centres, PATH_POINTS)
    state = RobotState(
        com_from_stance=turn(-stance.yaw, stance.com - stance.foot),
        com_velocity=turn(-stance.yaw, stance.com_velocity),
        stance_sign=_stance_sign(stance),
        time_in_step=stance.time,
    )
    learned = istepper(to_base(frame, line)[None], jax.tree.map(lambda leaf: leaf[None], state))[0]
    positions = to_world(frame, learned)
    yaws = course.headings[1:]
    if parameters is not None:
        positions = jnp.where(course.advancing, positions, geometric)
    return FootstepPlan(positions, yaws, other_side(stance.side), jnp.asarray(steps.count, jnp.int32)), spot


def has_nothing_to_do(
    parameters: PursuitParameters, path: Float[Array, "k 2"], face_point: Float[Array, "2"], base: Float[Array, "3"]
) -> Bool[Array, ""]:
    """Whether a robot at a base pose has no path to follow and faces where it would turn to: it should stand."""
    offset = face_point - base[:2]
    near = jnp.sum(offset**2) < parameters.end_radius**2
    faces = near | (jnp.abs(angle_between(jnp.arctan2(offset[1], offset[0]), base[2])) < parameters.face_tolerance)
    return faces & (arc_length(path)[-1] <= parameters.min_length)


def stop_steps(count: int, width: float, stance: Stance) -> FootstepPlan:
    """Two closing footsteps beside the stance foot, after which the robot stands."""
    centre = centre_of(stance, width)
    still = Course(
        jnp.broadcast_to(centre, (count + 1, 2)),
        jnp.broadcast_to(stance.yaw, (count + 1,)),
        jnp.asarray(False),
        jnp.asarray(False),
    )
    footsteps = footsteps_beside(still, _stance_sign(stance), width)
    return FootstepPlan(footsteps, still.headings[1:], other_side(stance.side), jnp.asarray(2, jnp.int32))


def _stance_sign(stance: Stance) -> Float[Array, ""]:
    """`side_sign` of the stance foot."""
    return side_sign(stance.side).astype(stance.foot.dtype)


def centre_of(stance: Stance, width: float) -> Float[Array, "2"]:
    """Middle [m] between two tracks of which the stance foot stands on one."""
    normal = jnp.stack([-jnp.sin(stance.yaw), jnp.cos(stance.yaw)])
    return stance.foot - _stance_sign(stance) * width / 2 * normal
