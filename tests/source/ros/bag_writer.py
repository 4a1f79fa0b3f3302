"""Writes the built-in scene, or what a test makes up, as a ROS bag of any kind."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame
from spot3d.trajectory import quaternion_from_rotation

rosbags = pytest.importorskip("rosbags", reason="rosbags is not installed")

from rosbags.rosbag1 import Writer as Writer1  # noqa: E402
from rosbags.rosbag2 import StoragePlugin  # noqa: E402
from rosbags.rosbag2 import Writer as Writer2  # noqa: E402
from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: E402

STORES = {1: get_typestore(Stores.ROS1_NOETIC), 2: get_typestore(Stores.ROS2_HUMBLE)}
STORES[1].register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
RECEIVED_LATE_NS = 7_000_000
"""Messages reach the recorder so much later than what their headers say."""

Said = tuple[str, int, Any]
"""A topic, when it is received in ns, and the message."""


class Speaker:
    """Makes messages of one version of ROS."""

    def __init__(self, version: int) -> None:
        self.version = version
        self.store = STORES[version]

    def make(self, kind: str, **fields: Any) -> Any:
        """A message; `kind` as `sensor_msgs/msg/Image`."""
        return self.store.types[kind](**fields)

    def header(self, stamp_ns: int, frame: str) -> Any:
        """A std_msgs/Header."""
        stamp = self.make("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        more = {"seq": 0} if self.version == 1 else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **more)

    def image(self, stamp_ns: int, frame: str, encoding: str, pixels: np.ndarray, bigendian: int = 0) -> Any:
        """An Image; rows of an odd number of bytes more than they hold, as aligned ones are."""
        height, width = pixels.shape[:2]
        rows = pixels.reshape(height, -1).view(np.uint8)
        padded = np.pad(rows, ((0, 0), (0, 3)))
        return self.make(
            "sensor_msgs/msg/Image",
            header=self.header(stamp_ns, frame),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=bigendian,
            step=padded.shape[1],
            data=padded.ravel(),
        )

    def compressed(self, stamp_ns: int, frame: str, form: str, data: bytes) -> Any:
        """A CompressedImage."""
        header = self.header(stamp_ns, frame)
        return self.make(
            "sensor_msgs/msg/CompressedImage", header=header, format=form, data=np.frombuffer(data, np.uint8)
        )

    def info(self, stamp_ns: int, frame: str, camera: Intrinsics) -> Any:
        """A CameraInfo."""
        roi = self.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        k = np.array([camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1.0])
        matrices = {"d": np.zeros(5), "k": k, "r": np.eye(3).ravel(), "p": np.zeros(12)}
        if self.version == 1:
            matrices = {name.upper(): matrix for name, matrix in matrices.items()}
        return self.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(stamp_ns, frame),
            height=camera.height,
            width=camera.width,
            distortion_model="plumb_bob",
            binning_x=0,
            binning_y=0,
            roi=roi,
            **matrices,
        )

    def transform(self, stamp_ns: int, parent: str, child: str, T_parent_child: np.ndarray) -> Any:
        """A TransformStamped."""
        return self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(stamp_ns, parent),
            child_frame_id=child,
            transform=self.make(
                "geometry_msgs/msg/Transform",
                translation=self.make("geometry_msgs/msg/Vector3", **_xyz(T_parent_child)),
                rotation=self._quaternion(T_parent_child),
            ),
        )

    def tf(self, *transforms: Any) -> Any:
        """A TFMessage."""
        return self.make("tf2_msgs/msg/TFMessage", transforms=list(transforms))

    def pose(self, stamp_ns: int, frame: str, T_frame_camera: np.ndarray) -> Any:
        """A PoseStamped."""
        return self.make(
            "geometry_msgs/msg/PoseStamped", header=self.header(stamp_ns, frame), pose=self._pose(T_frame_camera)
        )

    def odometry(self, stamp_ns: int, frame: str, child: str, T_frame_child: np.ndarray) -> Any:
        """An Odometry."""
        zero = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self.make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        covariance = np.zeros(36)
        return self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(stamp_ns, frame),
            child_frame_id=child,
            pose=self.make(
                "geometry_msgs/msg/PoseWithCovariance", pose=self._pose(T_frame_child), covariance=covariance
            ),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=covariance),
        )

    def _pose(self, T: np.ndarray) -> Any:
        position = self.make("geometry_msgs/msg/Point", **_xyz(T))
        return self.make("geometry_msgs/msg/Pose", position=position, orientation=self._quaternion(T))

    def _quaternion(self, T: np.ndarray) -> Any:
        x, y, z, w = map(float, quaternion_from_rotation(T[:3, :3]))
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def camera_messages(speaker: Speaker, frames: Sequence[RgbdFrame], start_ns: int = 0) -> list[Said]:
    """Registered colour and depth of frames, with their intrinsics, as realsense2_camera names them."""
    said: list[Said] = []
    for frame in frames:
        stamp_ns = start_ns + frame.stamp_ns
        for at, name, encoding, pixels in (
            (stamp_ns + 4_000_000, "color", "rgb8", frame.colour),
            (stamp_ns, "aligned_depth_to_color", "16UC1", frame.depth),
        ):
            image = speaker.image(at, "camera_color_optical_frame", encoding, pixels)
            info = speaker.info(at, "camera_color_optical_frame", frame.intrinsics)
            said += [
                (f"/camera/{name}/image_raw", at + RECEIVED_LATE_NS, image),
                (f"/camera/{name}/camera_info", at + RECEIVED_LATE_NS, info),
            ]
    return said


def write_bag(folder: Path, kind: str, said: Sequence[Said]) -> Path:
    """Write messages as `bag`, `mcap`, `db3` (files) or `mcap-folder`, `db3-folder`; returns what to open."""
    version = 1 if kind == "bag" else 2
    store = STORES[version]
    container = kind.partition("-")[0]
    path = folder / ("flight.bag" if version == 1 else "flight")
    plugins = {"mcap": StoragePlugin.MCAP, "db3": StoragePlugin.SQLITE3}
    with ExitStack() as stack:
        writer: Any = Writer1(path) if version == 1 else Writer2(path, version=9, storage_plugin=plugins[container])
        stack.enter_context(writer)
        connections: dict[str, Any] = {}
        for topic, received_ns, message in sorted(said, key=lambda one: one[1]):
            name = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            raw = store.serialize_ros1(message, name) if version == 1 else store.serialize_cdr(message, name)
            writer.write(connections[topic], received_ns, raw)
    if version == 1 or kind.endswith("folder"):
        return path
    return next(path.glob(f"*.{container}"))


def _xyz(T: np.ndarray) -> dict[str, float]:
    return dict(zip("xyz", map(float, T[:3, 3]), strict=True))
