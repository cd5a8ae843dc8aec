"""How camera paths are drawn: how long they are, how the camera is carried, and which goals are asked for."""

from dataclasses import dataclass

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY
from iwalker_jax.perception import CameraMount


@dataclass(frozen=True)
class CameraPathSampling:
    """How a camera is carried through a scene, and which goals are asked for.

    Attributes:
        frames_per_path: images along one route.
        goals_per_frame: the route's end plus random reachable points.
        min_route, max_route: [m] route lengths (cost-to-go along the comfortable route).
        last_frame: [m] distance before the goal at which the recording ends.
        height, height_spread: [m] camera height and its standard deviation from path to path.
        pitch, pitch_spread: [rad] downward pitch and its spread from path to path.
        roll_spread: [rad] mounting roll's spread from path to path.
        sway_angle: [rad] gait sway in pitch and roll from image to image.
        sway_height: [m] gait sway of the height.
        forward: [m] of the camera ahead of the COM, and sway_position: [m] of the COM's gait sway about it, both axes.
        heading_spread: [rad] departure of the heading from the route.
        lateral_spread: [m] departure of the position from the route.
        goal_radius: [m] random goals lie at most this far away.
        min_clearance: [m] distance to obstacles at every recorded pose.
    """

    frames_per_path: int = 5
    goals_per_frame: int = 6
    min_route: float = 3.0
    max_route: float = 9.0
    last_frame: float = 1.0
    height: float = CameraMount.height
    height_spread: float = 0.03
    pitch: float = CameraMount.pitch
    pitch_spread: float = 0.06
    roll_spread: float = 0.02
    sway_angle: float = 0.02
    sway_height: float = 0.008
    forward: float = CameraMount.forward
    sway_position: float = 0.012
    heading_spread: float = 0.25
    lateral_spread: float = 0.08
    goal_radius: float = 6.0
    min_clearance: float = BODY.route_radius

    def __post_init__(self) -> None:
        if self.frames_per_path < 1 or self.goals_per_frame < 1:
            raise InputError("A camera path needs at least one frame and one goal per frame.")
        if not 0 < self.last_frame < self.min_route < self.max_route:
            raise InputError("CameraPathSampling needs 0 < last_frame < min_route < max_route [m].")
