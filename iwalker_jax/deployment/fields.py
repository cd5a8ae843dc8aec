"""What each named array is: unit, frame and meaning, so that whoever builds a robot's driver need not guess."""

from typing import NamedTuple


class Field(NamedTuple):
    """One named array.

    Attributes:
        unit: of its numbers; "1" for none.
        frame: in which they are given; empty if that has no meaning.
        meaning: what it is.
    """

    unit: str
    frame: str
    meaning: str


_WORLD = "world"
_OWN = "memory of the function; give back what it returned"

_FIELDS = {
    "qpos": Field(
        "m, 1, rad",
        "base in the world",
        "base position x, y, z, base quaternion wxyz (body to world), joint angles in the order of robot.joints",
    ),
    "qvel": Field(
        "m/s, rad/s, rad/s",
        "linear: world; angular: base body",
        "velocity of the base, angular velocity of the base, joint velocities in the order of robot.joints",
    ),
    "image.qpos": Field("m, 1, rad", "base in the world", "qpos when the image was taken"),
    "image.qvel": Field("m/s, rad/s, rad/s", "linear: world; angular: base body", "qvel when the image was taken"),
    "touching": Field("1", "", "whether the right and the left foot press on the floor"),
    "halt": Field("1", "", "close the feet and stand, whatever the command says"),
    "depth": Field("m", "camera", "z-depth image as taken by the manifest's camera, 0 = no return"),
    "time": Field("s", "", "since the start"),
    "goals": Field("m", _WORLD, "x, y of the goals, one after the other; rows from goal_count on are ignored"),
    "goal_count": Field("1", "", "how many goals there are"),
    "torques": Field("N m", "motor", "of the motors in the order of robot.motors; zero for a robot that lies"),
    "contact_forces": Field("N", _WORLD, "planned forces on right toe, right heel, left toe, left heel"),
    "fallen": Field("1", "", "the robot lies, or its state is not finite"),
    "solved": Field("1", "", "the tick's quadratic program was solved to its tolerance"),
    "stop": Field("1", "", "stand still instead of following the way"),
    "arrived": Field("1", "", "the robot believes to be at its last goal"),
    "stuck": Field("1", "", "the robot has not come on for long, or long had no route"),
    "base": Field("m, m, rad", _WORLD, "x, y, yaw of the base frame: on the floor below the robot, x forward"),
    "new": Field("1", "", "footsteps were due; else the plan is the present one"),
    "spot": Field("m", _WORLD, "x, y where footsteps hold a robot that does not advance"),
    "stopping": Field("1", "", "the footsteps under way end in standing"),
    "goal": Field("m", "base", "x forward, y left of the goal"),
    "mount": Field("m, rad, rad, m, m", "base", "camera height, pitch, roll, forward, left"),
    "waypoints": Field("m", "base", "x forward, y left"),
    "fear": Field("1", "", "logit of the path meeting an obstacle"),
    "path": Field("m", "base", "x forward, y left, starting at the robot"),
    "footsteps": Field("m", "base", "x forward, y left of the next footsteps, left and right in turn"),
    "com_from_stance": Field("m", "base", "centre of mass minus stance foot"),
    "com_velocity": Field("m/s", "base", "velocity of the centre of mass"),
    "stance_sign": Field("1", "", "+1 for a left stance foot, -1 for a right one"),
    "time_in_step": Field("s", "", "since the last touchdown"),
    "way.path": Field("m", _WORLD, "x, y of points to walk along; a point if there is no way"),
    "way.face_point": Field("m", _WORLD, "x, y of where to turn to if the path gives no direction"),
    "way.detour": Field("1", "", "the remembered route took the place of the network's path"),
    "way.route_exists": Field("1", "", "as far as was seen, a route to the goal may exist"),
    "way.room_offset": Field("m", _WORLD, "from the robot to where it has room to turn on the spot"),
    "clock.mode": Field("1", "", "0 stands, 1 shifts its weight, 2 walks"),
    "clock.stance": Field("1", "", "stance foot: 0 right, 1 left"),
    "clock.step": Field("1", "", "footsteps of the plan that were taken"),
    "clock.time": Field("s", "", "in this mode; walking, since the last touchdown"),
    "plan.positions": Field("m", _WORLD, "x, y of the middle of each foot; rows from plan.count on are ignored"),
    "plan.yaws": Field("rad", _WORLD, "heading of each foot"),
    "plan.first_swing": Field("1", "", "the foot that row 0 places, 0 right or 1 left; the others alternate"),
    "plan.count": Field("1", "", "footsteps of the plan; 0 stands"),
    "command.number": Field("1", "", "another one than before if the plan is new"),
    "command.stopping": Field("1", "", "the plan ends in standing"),
    "command.touchdowns": Field("1", "", "memory.touchdowns when it was planned; later, it is too late and not taken"),
    "memory.plan_number": Field("1", "", "number of the last command that was heeded"),
    "memory.stopping": Field("1", "", "the footsteps under way end in standing"),
    "memory.touchdowns": Field("1", "", "of the feet since the start"),
    "memory.goal": Field("1", "", "index of the present goal"),
    "memory.health.failed": Field("1", "", "the camera is blind or frozen"),
    "memory.guide.cells.evidence": Field("1", _WORLD, "of occupied cells, positive, and free ones; x first, then y"),
    "memory.guide.cells.middle": Field("1", _WORLD, "world cell at the map's middle"),
    "memory.guide.routes.clearance": Field("m", _WORLD, "mean over each cell of the routes' map; x first, then y"),
    "memory.guide.routes.room": Field("m", _WORLD, "clearance of the best place in each of its cells"),
    "memory.guide.routes.unseen": Field("1", "", "share of each of its cells that was not seen"),
    "memory.guide.routes.middle": Field("1", _WORLD, "world cell at its middle"),
    "memory.guide.route": Field("m", _WORLD, "x, y of points along the last frame's route"),
}


def field_of(name: str) -> Field:
    """What the array of a name is; KeyError for a name that nobody described."""
    if name in _FIELDS:
        return _FIELDS[name]
    head, _, tail = name.partition(".")
    if head == "command" or name.startswith("memory.plan."):
        return _FIELDS["plan." + name.rpartition(".")[2]]
    if head == "memory":
        return Field("SI", _WORLD, f"{tail}: {_OWN}")
    raise KeyError(name)
