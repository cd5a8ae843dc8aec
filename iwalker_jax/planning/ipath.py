"""iPath: the network that turns a depth image and a goal into waypoints."""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Float

from iwalker_jax.checks import Scalar, require_plain_numbers
from iwalker_jax.errors import InputError
from iwalker_jax.perception import CameraMount, Intrinsics, backproject
from iwalker_jax.planning.goal_scan import SCAN_CHANNELS, GoalScan, goal_scan
from iwalker_jax.planning.residual_network import Conv, Trunk, at_least_two_rows, halve, trunk_size


@dataclass(frozen=True)
class IPathConfig:
    """Size and kind of the iPath network.

    Attributes:
        variant: "light" (trains on two CPU cores) or "paper" (the published 53 M parameter layout at 360 x 640).
        waypoints: number of predicted waypoints.
        trunk_width: channels of the first residual stage; the published network has 64.
        hidden: units of the light variant's fully connected layers.
        goal_reach: [m] goals farther than this are pulled in along their bearing before the network sees them.
        nearest_depth: [m] where the light variant's inverse-depth input saturates.
        camera: intrinsics and size of its depth images, which training frames, walks and recordings are taken with or
            re-projected to; the light variant turns pixels into points with it.
        mount: nominal mount, used where no measured one is given.
        scan: bearings about the goal's direction that the light variant's head sees besides the image.
        goal_is_end: replace the last waypoint by the goal, as published; otherwise the end point is free.
        even: space the waypoints evenly by construction, see `evenly_spaced`; the published network leaves it to the
            losses.
        equivariant: average the network over a frame and its mirror image, so that the plan of the mirrored frame is
            the mirrored plan by construction; the published network, which the losses alone make nearly so, is not.
    """

    variant: Literal["light", "paper"] = "light"
    waypoints: int = 5
    trunk_width: int = 16
    hidden: int = 256
    goal_reach: float = 6.0
    nearest_depth: float = 0.3
    camera: Intrinsics = Intrinsics()
    mount: CameraMount = CameraMount()
    scan: GoalScan = GoalScan()
    goal_is_end: bool = False
    even: bool = True
    equivariant: bool = True

    @classmethod
    def published(cls) -> "IPathConfig":
        """The paper's network at 360 x 640 (90 degrees wide), whose last waypoint is the goal."""
        camera = Intrinsics(width=640, height=360, fx=320.0, fy=320.0, cx=319.5, cy=179.5)
        return cls("paper", trunk_width=64, camera=camera, goal_is_end=True, even=False, equivariant=False)

    def __post_init__(self) -> None:
        require_plain_numbers(self)
        if self.variant not in ("light", "paper"):
            raise InputError(f"Unknown iPath variant {self.variant!r}; choose 'light' or 'paper'.")
        height, width = self.camera.height, self.camera.width
        if height < 64 or width < 96:
            raise InputError(f"iPath needs depth images of at least 64 x 96 px, got {height} x {width}.")
        if not (2 <= self.waypoints <= 100 and 4 <= self.trunk_width <= 4096 and 1 <= self.hidden <= 65_536):
            raise InputError(
                "iPath needs 2 to 100 waypoints, at least 4 trunk channels (4096 at most), 1 to 65536 hidden units."
            )
        if not (0 < self.goal_reach <= 1000 and 0 < self.nearest_depth <= 100):
            raise InputError("iPath needs a goal reach in (0, 1000] m and a nearest depth in (0, 100] m.")
        if self.goal_is_end and self.even:
            raise InputError("Evenly spaced waypoints cannot end at the goal too; set even or goal_is_end to False.")


_SHORTEST_INTERVAL = 1e-3  # [m] below which an interval has no direction


class IPathOutput(NamedTuple):
    """What iPath predicts.

    Attributes:
        waypoints: (batch, waypoints, 2) [m] in the base frame; the origin itself is not among them.
        fear: (batch,) logit of the path meeting an obstacle.
    """

    waypoints: Float[Array, "batch k 2"]
    fear: Float[Array, " batch"]


def reduced_goal(goal: Float[Array, "*batch 2"], reach: Scalar) -> Float[Array, "*batch 2"]:
    """The goal [m], pulled in to `reach` along its bearing; non-finite goals become the origin (stay)."""
    finite = jnp.all(jnp.isfinite(goal), axis=-1, keepdims=True)
    goal = jnp.where(finite, goal, 0.0)
    # Scale by the larger coordinate first: squaring a goal 1e30 m away would overflow.
    largest = jnp.maximum(jnp.max(jnp.abs(goal), axis=-1, keepdims=True), 1e-6)
    unit = goal / largest
    distance = largest * jnp.sqrt(jnp.sum(unit**2, axis=-1, keepdims=True))
    return goal * jnp.minimum(1.0, reach / jnp.maximum(distance, 1e-6))


def evenly_spaced(waypoints: Float[Array, "*batch k 2"]) -> Float[Array, "*batch k 2"]:
    """Waypoints [m] with the directions of the given ones' intervals, each interval as long as the mean of them.

    A unicycle at constant speed is at the knots of a path at even times only if the knots are evenly spaced. The first
    interval starts at the origin; standing still stays standing still.
    """
    intervals = jnp.diff(waypoints, axis=-2, prepend=jnp.zeros_like(waypoints[..., :1, :]))
    lengths = jnp.sqrt(jnp.sum(intervals**2, axis=-1, keepdims=True) + _SHORTEST_INTERVAL**2)
    return jnp.cumsum(intervals / lengths * jnp.mean(lengths, axis=-2, keepdims=True), axis=-2)


class IPath(nnx.Module):
    """Depth image + goal -> waypoints and fear; see `IPathConfig` for the two sizes."""

    def __init__(self, config: IPathConfig, rngs: nnx.Rngs) -> None:
        self.config = config
        head = _PaperHead if config.variant == "paper" else _LightHead
        self.trunk = Trunk(1 if config.variant == "paper" else _LIGHT_CHANNELS, config.trunk_width, rngs)
        self.head: Any = head(config, rngs)

    def __call__(
        self,
        depth: Float[Array, "batch h w"],
        goal: Float[Array, "batch 2"],
        mount: Float[Array, "batch 5"] | None = None,
    ) -> IPathOutput:
        """Plan for a batch.

        Args:
            depth: z-depth [m], 0 = no return (`clean_depth`).
            goal: [m] in the base frame (x forward, y left), any distance.
            mount: camera mounts as in `CameraMount`, from the robot's IMU and kinematics or a floor fit; the
                configured nominal mount if left out. The paper variant sees depth and goal alone.
        """
        config = self.config
        near_goal = reduced_goal(goal, config.goal_reach)
        points = None
        if config.variant == "light":
            if mount is None:
                mount = jnp.broadcast_to(config.mount.as_array(), (depth.shape[0], 5))
            points = jax.vmap(lambda image, pose: backproject(image, config.camera, pose))(depth, mount)
        if config.equivariant:
            # Points, not pixels, are mirrored: that is exact wherever the camera looks and its principal point lies.
            mirror = jnp.asarray([1.0, -1.0], near_goal.dtype)
            both = jnp.concatenate([depth, depth[:, :, ::-1]])
            if points is not None:
                points = jnp.concatenate([points, points[:, :, ::-1] * jnp.asarray([1.0, -1.0, 1.0], points.dtype)])
            waypoints, fear = self._seen(both, points, jnp.concatenate([near_goal, near_goal * mirror]))
            (seen, mirrored), (seen_fear, mirrored_fear) = jnp.split(waypoints, 2), jnp.split(fear, 2)
            waypoints, fear = (seen + mirrored * mirror) / 2, (seen_fear + mirrored_fear) / 2
        else:
            waypoints, fear = self._seen(depth, points, near_goal)
        return IPathOutput(self.constrained(waypoints, near_goal), fear)

    def _seen(
        self,
        depth: Float[Array, "batch h w"],
        points: Float[Array, "batch h w 3"] | None,
        near_goal: Float[Array, "batch 2"],
    ) -> tuple[Float[Array, "batch k 2"], Float[Array, " batch"]]:
        """Free waypoints and fear of one view; the light variant also sees the points of its pixels [m]."""
        if points is None:
            return self.head(self.trunk(depth[..., None]), near_goal)
        image, scan = _light_input(depth, points, near_goal, self.config)
        return self.head(self.trunk(image), scan, near_goal)

    def constrained(
        self, waypoints: Float[Array, "*batch k 2"], near_goal: Float[Array, "*batch 2"]
    ) -> Float[Array, "*batch k 2"]:
        """Any waypoints [m] made to obey what the configuration promises: even intervals, or the goal at the end.

        Args:
            waypoints: as a network's last layer or an exploring policy draws them.
            near_goal: [m] reduced goal.
        """
        if self.config.even:
            return evenly_spaced(waypoints)
        return waypoints.at[..., -1, :].set(near_goal) if self.config.goal_is_end else waypoints


_LIGHT_CHANNELS = 6


def _light_input(
    depth: Float[Array, "batch h w"],
    points: Float[Array, "batch h w 3"],
    goal: Float[Array, "batch 2"],
    config: IPathConfig,
) -> tuple[Float[Array, "batch half_h half_w c"], Float[Array, "batch features"]]:
    """What the light variant sees in each pixel: inverse depth, and where its point lies relative to the goal; and the
    scan about the goal's direction.

    Height above the floor, progress along the straight line to the goal and signed distance from that line
    make an obstacle on the way look the same wherever the goal is; a network that has to turn pixels into metres by
    itself needs many times the frames.
    """
    valid = (depth > 0).astype(depth.dtype)
    inverse = valid / jnp.maximum(depth, config.nearest_depth)
    ahead, lateral = _goal_axes(goal)
    scan = jax.vmap(lambda p, v, a: goal_scan(p, v, a, config.scan))(points, valid, ahead)
    distance = jnp.sqrt(jnp.sum(goal**2, axis=-1) + 1e-2)[:, None, None]
    x, y = points[..., 0], points[..., 1]
    along = (x * ahead[:, 0, None, None] + y * ahead[:, 1, None, None]) / distance
    across = x * lateral[:, 0, None, None] + y * lateral[:, 1, None, None]
    height = jnp.clip(points[..., 2], -0.3, 1.2)
    columns = jnp.broadcast_to(jnp.linspace(-1.0, 1.0, depth.shape[2])[None, None, :], depth.shape)
    image = jnp.stack(
        [
            inverse,
            2.0 * valid * height,
            valid * jnp.clip(along, -0.5, 2.0),
            valid * jnp.tanh(across),
            valid * jnp.tanh(4.0 * across),
            columns.astype(depth.dtype),
        ],
        axis=-1,
    )
    # The scan keeps the full resolution; half of it is enough for the trunk and costs it a quarter of the time.
    image = halve(image)
    # How far the goal is turned from the camera's axis says which bearings lie out of view.
    return image, jnp.concatenate([scan.reshape(depth.shape[0], -1), ahead], axis=-1)


def _goal_axes(goal: Float[Array, "batch 2"]) -> tuple[Float[Array, "batch 2"], Float[Array, "batch 2"]]:
    """Unit vectors towards the goal and to its left; forward and left for a goal at the robot's feet."""
    distance = jnp.sqrt(jnp.sum(goal**2, axis=-1, keepdims=True) + 1e-12)
    ahead = jnp.where(distance > 1e-3, goal / distance, jnp.asarray([1.0, 0.0], goal.dtype))
    return ahead, jnp.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)


class _LightHead(nnx.Module):
    """Reduces the channels, keeps every image position, and adds the goal before two hidden layers."""

    def __init__(self, config: IPathConfig, rngs: nnx.Rngs) -> None:
        height, width = trunk_size(config.camera.height // 2), trunk_size(config.camera.width // 2)
        features = height * width * 8 * config.trunk_width
        hidden = config.hidden
        self.image = nnx.Linear(features, hidden, rngs=rngs)
        self.goal = nnx.Linear(6, hidden, rngs=rngs)
        self.scan1 = nnx.Linear(config.scan.bins * SCAN_CHANNELS + 2, hidden, rngs=rngs)
        self.scan2 = nnx.Linear(hidden, hidden, rngs=rngs)
        self.hidden1 = nnx.Linear(3 * hidden, hidden, rngs=rngs)
        self.hidden2 = nnx.Linear(hidden, hidden, rngs=rngs)
        self.waypoints = nnx.Linear(hidden, 2 * config.waypoints, rngs=rngs)
        self.fear = nnx.Linear(hidden, 1, rngs=rngs)
        self.count = config.waypoints

    def __call__(
        self,
        image: Float[Array, "batch rows columns c"],
        scan: Float[Array, "batch features"],
        goal: Float[Array, "batch 2"],
    ) -> tuple[Float[Array, "batch k 2"], Float[Array, " batch"]]:
        """Waypoints [m] and fear logit from the trunk's map, the scan about the goal and the reduced goal [m]."""
        batch = image.shape[0]
        seen = jax.nn.relu(self.image(image.reshape(batch, -1)))
        around = jax.nn.relu(self.scan2(jax.nn.relu(self.scan1(scan))))
        distance = jnp.sqrt(jnp.sum(goal**2, axis=-1, keepdims=True) + 1e-6)
        embedded = jnp.concatenate([goal, distance, goal / distance, 1.0 / (1.0 + distance)], axis=-1)
        joint = jnp.concatenate([seen, around, jax.nn.relu(self.goal(embedded))], axis=-1)
        joint = jax.nn.relu(self.hidden1(joint))
        joint = joint + jax.nn.relu(self.hidden2(joint))
        # Waypoints are departures from the evenly divided straight line, along it and across it.
        fractions = (jnp.arange(self.count) + 1.0) / self.count
        line = fractions[None, :, None] * goal[:, None, :]
        departure = self.waypoints(joint).reshape(batch, self.count, 2)
        ahead, lateral = _goal_axes(goal)
        departure = departure[..., :1] * ahead[:, None] + departure[..., 1:] * lateral[:, None]
        return line + departure, self.fear(joint)[:, 0]


class _PaperHead(nnx.Module):
    """The published head: goal Linear(3 -> 16) broadcast, two convolutions, 1024 -> 512 -> waypoints x 3."""

    def __init__(self, config: IPathConfig, rngs: nnx.Rngs) -> None:
        channels = 8 * config.trunk_width
        height, width = trunk_size(config.camera.height), trunk_size(config.camera.width)
        # The published paddings shrink the map by 4; images too small for that keep it instead.
        self.shrinks = min(height, width) > 4
        self.goal = nnx.Linear(3, 16, rngs=rngs)
        self.conv1 = Conv(5, channels + 16, channels, 1, 1 if self.shrinks else 2, True, rngs)
        self.conv2 = Conv(3, channels, channels // 2, 1, 0 if self.shrinks else 1, True, rngs)
        loss = 4 if self.shrinks else 0
        self.dense1 = nnx.Linear((height - loss) * (width - loss) * (channels // 2), 1024, rngs=rngs)
        self.dense2 = nnx.Linear(1024, 512, rngs=rngs)
        self.waypoints = nnx.Linear(512, 3 * config.waypoints, rngs=rngs)
        self.fear1 = nnx.Linear(1024, 128, rngs=rngs)
        self.fear2 = nnx.Linear(128, 1, rngs=rngs)
        self.count = config.waypoints

    def __call__(
        self, image: Float[Array, "batch rows columns c"], goal: Float[Array, "batch 2"]
    ) -> tuple[Float[Array, "batch k 2"], Float[Array, " batch"]]:
        """Waypoints [m] and fear logit from the trunk's map and the reduced goal [m]."""
        batch, height, width, _ = image.shape
        flat_goal = jnp.concatenate([goal, jnp.zeros_like(goal[:, :1])], axis=-1)
        embedded = jnp.broadcast_to(self.goal(flat_goal)[:, None, None, :], (batch, height, width, 16))
        joint = jnp.concatenate([image, embedded], axis=-1)
        joint = jax.nn.relu(self.conv1(joint))
        joint = jax.nn.relu(self.conv2(joint)).reshape(batch, -1)
        shared = jax.nn.relu(self.dense1(at_least_two_rows(joint)))
        waypoints = self.waypoints(jax.nn.relu(self.dense2(shared)))[:batch].reshape(batch, self.count, 3)
        fear = self.fear2(jax.nn.relu(self.fear1(shared)))[:batch, 0]
        return waypoints[..., :2], fear
