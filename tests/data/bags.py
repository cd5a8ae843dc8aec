"""Bags of a walk over a bare floor, written by the package rosbags, with images rendered through a distorting lens."""

import math
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from tests.data.recording_folders import CAMERA_HEIGHT, FOCAL, HEIGHT, PITCH, WIDTH

KINDS = ("ros1", "sqlite3", "mcap")
K = np.array([[FOCAL, 0.0, 59.5], [0.0, FOCAL, 44.5], [0.0, 0.0, 1.0]])
DISTORTION = np.array([-0.12, 0.03, 0.002, -0.001, 0.0])
START = 1_700_000_000.0
FRAMES = 5
YAW = 0.3
POSES = np.array([[0.4 * k * math.cos(YAW), 0.4 * k * math.sin(YAW), YAW] for k in range(FRAMES)])
P_BODY_CAMERA = np.array([0.1, 0.02, 0.3])
R_BODY_CAMERA = Rotation.from_matrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]) * Rotation.from_euler(
    "xz", [-PITCH, 0.0]
)


def floor_depth(x: np.ndarray, y: np.ndarray, shift: float = 0.0, roll: float = 0.0) -> np.ndarray:
    """z-depth [m] along rays (x, y, 1): a floor CAMERA_HEIGHT below, and a wall 4 m ahead."""
    normal = [math.cos(PITCH) * math.sin(roll), math.cos(PITCH) * math.cos(roll), math.sin(PITCH)]
    inverse = (normal[0] * x + normal[1] * y + normal[2]) / CAMERA_HEIGHT
    return 1.0 / np.maximum(inverse, 1.0 / (4.0 + shift))


def rays(distortion: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Ray (x, y, 1) of every pixel, by fixed-point iterations over OpenCV's lens."""
    u, v = np.meshgrid(np.arange(WIDTH, dtype=float), np.arange(HEIGHT, dtype=float))
    if distortion is None:
        return (u - K[0, 2]) / FOCAL, (v - K[1, 2]) / FOCAL
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2)
    points = (pixels - K[:2, 2]) / FOCAL
    for _ in range(50):
        points -= (recorded_pixels(points, distortion) - pixels) / FOCAL
    assert np.abs(recorded_pixels(points, distortion) - pixels).max() < 1e-6
    return points[:, 0].reshape(HEIGHT, WIDTH), points[:, 1].reshape(HEIGHT, WIDTH)


def recorded_pixels(points: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    """(n, 2) [px] where the lens puts rays (x, y, 1)."""
    places = np.column_stack([points, np.ones(len(points))])
    return cv2.projectPoints(places, np.zeros(3), np.zeros(3), K, distortion)[0].reshape(-1, 2)


@dataclass
class BagDraft:
    """What is written into a bag; what is None or empty is left out.

    Attributes:
        encoding: of the depth images.
        compressed: whether they are packed by compressedDepth.
        depth: [m] images; rendered through the lens if left out.
        distortion, model: of the CameraInfo and of the rendered images.
        info: whether there is a CameraInfo.
        odometry, tf: whether there are poses on /odom, and the body's pose in tf.
        camera_frame: whether tf knows the camera in the body.
        changes: fields of the CameraInfo that are replaced.
    """

    encoding: str = "16UC1"
    compressed: bool = False
    depth: list[np.ndarray] | None = None
    distortion: np.ndarray | None = field(default_factory=lambda: DISTORTION)
    model: str = "plumb_bob"
    info: bool = True
    odometry: bool = True
    tf: bool = False
    camera_frame: bool = True
    name: str = "/camera/depth/image_raw"
    changes: dict[str, Any] = field(default_factory=dict)

    def images(self) -> list[np.ndarray]:
        if self.depth is not None:
            return self.depth
        x, y = rays(self.distortion)
        return [floor_depth(x, y, 0.01 * k) for k in range(FRAMES)]

    def write(self, place: Path, kind: str = "sqlite3") -> Path:
        """Writes the bag and returns where it lies."""
        writer = _Writer(place, kind)
        with writer.stream:
            for k, image in enumerate(self.images()):
                stamp = START + 0.1 * k
                self._write_frame(writer, image, stamp)
                # Two poses: one at 20 ms after the image, and one that is far off in between.
                for pose, delay in ((POSES[k], 0.02), (POSES[k] + [0.2, 0.0, 0.0], 0.05)):
                    if self.odometry:
                        writer.odometry(pose, stamp + delay)
                    if self.tf:
                        writer.transform("/tf", "odom", "base_link", [*pose[:2], 0.0], _yaw(pose[2]), stamp + delay)
            if self.camera_frame:
                quaternion = R_BODY_CAMERA.as_quat()
                writer.transform("/tf_static", "base_link", "camera_link", P_BODY_CAMERA, np.eye(4)[3], START)
                writer.transform("/tf_static", "camera_link", "camera_optical", np.zeros(3), quaternion, START)
        return writer.place

    def _write_frame(self, writer: "_Writer", image: np.ndarray, stamp: float) -> None:
        header = writer.header(stamp, "camera_optical")
        millimetres = np.round(image * 1000.0).astype(np.uint16)
        if self.compressed:
            content, form = compressed_depth(image, self.encoding), f"{self.encoding}; compressedDepth png"
            message = writer.make("sensor_msgs/msg/CompressedImage", header=header, format=form, data=content)
            writer.write(f"{self.name}/compressedDepth", message, stamp)
        else:
            pixels = millimetres if self.encoding == "16UC1" else image.astype(np.float32)
            message = writer.image(header, self.encoding, pixels)
            writer.write(self.name, message, stamp)
        if self.info:
            D = np.zeros(5) if self.distortion is None else self.distortion
            writer.camera_info(
                f"{self.name.rpartition('/')[0]}/camera_info", header, D, self.model, stamp, self.changes
            )


def compressed_depth(image: np.ndarray, encoding: str) -> np.ndarray:
    """Bytes of a depth image [m] as compressed_depth_image_transport lays them down.

    Its ConfigHeader: int32 format (0 UNDEFINED for 16UC1, 1 INV_DEPTH for 32FC1), float32 quantA and quantB; then a
    PNG, of inverse depth quantA / depth + quantB in 32FC1 with quantA = q (q + 1), quantB = 1 - quantA / depth_max.
    """
    if encoding == "16UC1":
        units, header = np.round(image * 1000.0).astype(np.uint16), struct.pack("<iff", 0, 0.0, 0.0)
    else:
        a = 100.0 * 101.0
        b = 1.0 - a / 10.0
        units, header = np.floor(a / image + b).astype(np.uint16), struct.pack("<iff", 1, a, b)
    return np.frombuffer(header + cv2.imencode(".png", units)[1].tobytes(), np.uint8)


def _yaw(angle: float) -> np.ndarray:
    return Rotation.from_euler("z", angle).as_quat()


_TF = """geometry_msgs/TransformStamped[] transforms"""


class _Writer:
    """Writes messages of either version."""

    def __init__(self, place: Path, kind: str):
        self.ros1 = kind == "ros1"
        self.place = place.with_suffix(".bag") if self.ros1 else place
        self.store = get_typestore(Stores.ROS1_NOETIC if self.ros1 else Stores.ROS2_HUMBLE)
        if "tf2_msgs/msg/TFMessage" not in self.store.fielddefs:
            self.store.register(get_types_from_msg(_TF, "tf2_msgs/msg/TFMessage"))
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        self.stream: Any = Writer1(self.place) if self.ros1 else Writer2(self.place, version=9, storage_plugin=plugin)
        self._connections: dict[str, Any] = {}

    def make(self, kind: str, **fields: Any) -> Any:
        return self.store.types[kind](**fields)

    def header(self, stamp: float, frame: str) -> Any:
        seconds, nanoseconds = divmod(round(stamp * 1e9), 10**9)
        time = self.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        sequence = {"seq": 0} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=frame, **sequence)

    def image(self, header: Any, encoding: str, pixels: np.ndarray) -> Any:
        """A plain image, whose rows end in four bytes of padding."""
        rows = pixels.view(np.uint8).reshape(len(pixels), -1)
        rows = np.pad(rows, ((0, 0), (0, 4)), constant_values=255)
        size = {"height": pixels.shape[0], "width": pixels.shape[1], "step": rows.shape[1]}
        data = np.ascontiguousarray(rows).ravel()
        return self.make("sensor_msgs/msg/Image", header=header, encoding=encoding, is_bigendian=0, data=data, **size)

    def camera_info(
        self, topic: str, header: Any, D: np.ndarray, model: str, stamp: float, changes: dict[str, Any]
    ) -> None:
        matrices = {"d": D, "k": K.ravel(), "r": np.eye(3).ravel(), "p": np.column_stack([K, np.zeros(3)]).ravel()}
        fields = matrices | {"width": WIDTH, "height": HEIGHT, "distortion_model": model} | changes
        if self.ros1:
            fields = {name.upper() if len(name) == 1 else name: value for name, value in fields.items()}
        kind = "sensor_msgs/msg/RegionOfInterest"
        region = self.make(kind, x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        rest = {"binning_x": 0, "binning_y": 0, "roi": region}
        self.write(topic, self.make("sensor_msgs/msg/CameraInfo", header=header, **(rest | fields)), stamp)

    def odometry(self, pose: np.ndarray, stamp: float) -> None:
        zero = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self.make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        position = self.make("geometry_msgs/msg/Point", x=pose[0], y=pose[1], z=0.3)
        turn = self._quaternion(_yaw(pose[2]))
        placed = self.make("geometry_msgs/msg/Pose", position=position, orientation=turn)
        message = self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(stamp, "odom"),
            child_frame_id="base_link",
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=placed, covariance=np.zeros(36)),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )
        self.write("/odom", message, stamp)

    def transform(self, topic: str, parent: str, child: str, p: Any, quaternion: np.ndarray, stamp: float) -> None:
        x, y, z = (float(value) for value in p)
        moved = self.make(
            "geometry_msgs/msg/Transform",
            translation=self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
            rotation=self._quaternion(quaternion),
        )
        header = self.header(stamp, parent)
        placed = self.make("geometry_msgs/msg/TransformStamped", header=header, child_frame_id=child, transform=moved)
        self.write(topic, self.make("tf2_msgs/msg/TFMessage", transforms=[placed]), stamp)

    def write(self, topic: str, message: Any, stamp: float) -> None:
        kind = message.__msgtype__
        if topic not in self._connections:
            self._connections[topic] = self.stream.add_connection(topic, kind, typestore=self.store)
        serialise = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
        self.stream.write(self._connections[topic], round(stamp * 1e9), serialise(message, kind))

    def _quaternion(self, values: np.ndarray) -> Any:
        x, y, z, w = (float(value) for value in values)
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
