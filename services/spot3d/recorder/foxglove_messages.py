"""Messages in Foxglove's schemas, which Foxglove, Lichtblick and Rerun show without plugins.

Frames: `map` has z up, `world` is the run's world, `camera` is optical (x right, y down, z forward).
"""

from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from foxglove.messages import (
    CameraCalibration,
    Color,
    CompressedImage,
    CubePrimitive,
    FrameTransform,
    FrameTransforms,
    KeyValuePair,
    PackedElementField,
    PackedElementFieldNumericType,
    PointCloud,
    Pose,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneUpdate,
    TextPrimitive,
    Timestamp,
    Vector3,
)
from numpy.typing import NDArray

from spot3d.boxes import EDGES, corners
from spot3d.camera import Intrinsics
from spot3d.drawing.picture import object_colour
from spot3d.found_object import FoundObject
from spot3d.trajectory import quaternion_from_rotation, rotation_to_z

MAP, WORLD, CAMERA = "map", "world", "camera"
_JPEG_QUALITY = 85
_BOX_ALPHA = 0.35
_LABEL_SIZE = 0.03
"""Height of the labels' letters, metres."""
_SPACING = 0.005
"""Largest distance of points on the edges of boxes, metres: that of the map's points."""

_POINT = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3), ("alpha", "u1")])
_FLOAT, _BYTE = PackedElementFieldNumericType.Float32, PackedElementFieldNumericType.Uint8
_FIELDS = [
    *(PackedElementField(name=axis, offset=4 * number, type=_FLOAT) for number, axis in enumerate("xyz")),
    *(
        PackedElementField(name=channel, offset=12 + number, type=_BYTE)
        for number, channel in enumerate(("red", "green", "blue", "alpha"))
    ),
]
"""The fields of a point, of type `_POINT`."""


def stamp(stamp_ns: int) -> Timestamp:
    """A capture time."""
    return Timestamp(sec=stamp_ns // 10**9, nsec=stamp_ns % 10**9)


def image(stamp_ns: int, colour: NDArray[np.uint8]) -> CompressedImage:
    """colour: (h, w, 3) uint8 RGB, as JPEG."""
    bgr = cv2.cvtColor(colour, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return CompressedImage(timestamp=stamp(stamp_ns), frame_id=CAMERA, data=data.tobytes(), format="jpeg")


def calibration(stamp_ns: int, camera: Intrinsics) -> CameraCalibration:
    """A pinhole camera without distortion."""
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    return CameraCalibration(
        timestamp=stamp(stamp_ns),
        frame_id=CAMERA,
        width=camera.width,
        height=camera.height,
        K=[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


def camera_pose(stamp_ns: int, T_world_camera: NDArray[np.float64]) -> FrameTransforms:
    """The transform of the camera, T_world_camera (4, 4)."""
    return _transform(stamp_ns, WORLD, CAMERA, T_world_camera[:3, :3], T_world_camera[:3, 3])


def upright(stamp_ns: int, up: Sequence[float]) -> FrameTransforms:
    """Rotation of the world into the map, whose z is `up`, a (3,) unit vector in the world."""
    return _transform(stamp_ns, MAP, WORLD, rotation_to_z(np.array(up, np.float64)), np.zeros(3))


def points(stamp_ns: int, frame_id: str, xyz: NDArray[np.float32], rgb: NDArray[np.uint8]) -> PointCloud:
    """xyz: (n, 3) metres in `frame_id`. rgb: (n, 3)."""
    rows = np.empty(len(xyz), _POINT)
    rows["xyz"], rows["rgb"], rows["alpha"] = xyz, rgb, 255
    return PointCloud(
        timestamp=stamp(stamp_ns),
        frame_id=frame_id,
        pose=_pose(np.eye(3), np.zeros(3)),
        point_stride=_POINT.itemsize,
        fields=_FIELDS,
        data=rows.tobytes(),
    )


def edge_points(objects: Iterable[FoundObject]) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Points along the edges of the objects' boxes, in the colours of their labels, for viewers that show no boxes.

    Returns (n, 3) metres, world, and (n, 3) RGB.
    """
    xyz, rgb = [np.zeros((0, 3))], [np.zeros((0, 3), np.uint8)]
    for item in objects:
        for start, end in corners(item.box)[EDGES]:
            count = 1 + int(np.ceil(np.linalg.norm(end - start) / _SPACING))
            xyz.append(np.linspace(start, end, count))
            rgb.append(np.full((count, 3), object_colour(item.id), np.uint8))
    return np.concatenate(xyz).astype(np.float32), np.concatenate(rgb)


def scene(stamp_ns: int, objects: Iterable[FoundObject], up: Sequence[float], gone: Iterable[int]) -> SceneUpdate:
    """Each object as a box with its number and confidence above it. gone: ids of objects to delete."""
    return SceneUpdate(
        deletions=[SceneEntityDeletion(timestamp=stamp(stamp_ns), id=str(number)) for number in gone],
        entities=[_entity(stamp_ns, item, np.array(up, np.float64)) for item in objects],
    )


def _entity(stamp_ns: int, item: FoundObject, up: NDArray[np.float64]) -> SceneEntity:
    red, green, blue = (value / 255 for value in object_colour(item.id))
    box = item.box
    top = box.centre + up * (0.5 * np.abs(box.rotation.T @ up) @ box.size + _LABEL_SIZE)
    width, depth, height = box.size.tolist()
    return SceneEntity(
        timestamp=stamp(stamp_ns),
        frame_id=WORLD,
        id=str(item.id),
        metadata=[
            KeyValuePair(key="confidence", value=f"{item.confidence:.3f}"),
            KeyValuePair(key="views", value=str(item.views)),
            KeyValuePair(key="points", value=str(item.points)),
        ],
        cubes=[
            CubePrimitive(
                pose=_pose(box.rotation, box.centre),
                size=Vector3(x=width, y=depth, z=height),
                color=Color(r=red, g=green, b=blue, a=_BOX_ALPHA),
            )
        ],
        texts=[
            TextPrimitive(
                pose=_pose(np.eye(3), top),
                billboard=True,
                font_size=_LABEL_SIZE,
                color=Color(r=red, g=green, b=blue, a=1.0),
                text=f"{item.id}: {item.confidence:.2f}",
            )
        ],
    )


def _transform(
    stamp_ns: int, parent: str, child: str, rotation: NDArray[np.float64], translation: NDArray[np.float64]
) -> FrameTransforms:
    pose = FrameTransform(
        timestamp=stamp(stamp_ns),
        parent_frame_id=parent,
        child_frame_id=child,
        translation=_vector(translation),
        rotation=_quaternion(rotation),
    )
    return FrameTransforms(transforms=[pose])


def _pose(rotation: NDArray[np.float64], translation: NDArray[np.float64]) -> Pose:
    return Pose(position=_vector(translation), orientation=_quaternion(rotation))


def _vector(values: NDArray[np.float64]) -> Vector3:
    x, y, z = values.tolist()
    return Vector3(x=x, y=y, z=z)


def _quaternion(rotation: NDArray[np.float64]) -> Quaternion:
    x, y, z, w = quaternion_from_rotation(rotation).tolist()
    return Quaternion(x=x, y=y, z=z, w=w)
