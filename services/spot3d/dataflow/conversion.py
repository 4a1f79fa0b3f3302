"""Conversions between messages and the cores' own types."""

from typing import Any

import numpy as np

from spot3d.calibration import Calibration
from spot3d.camera import Intrinsics
from spot3d.camera_pose import CameraPose
from spot3d.depth_noise import KINECT_V1, DepthNoise
from spot3d.frame import RgbdFrame
from spot3d.frame_segments import FrameSegments
from spot3d.pose_corrections import PoseCorrections
from spot3d_schemas import CameraIntrinsics, Frame, Header, Heat, Pose, Segments
from spot3d_schemas import DepthNoise as NoiseMessage


def rgbd_frame(message: Frame | Heat) -> RgbdFrame:
    """The RGB-D frame in a message. Its images are read-only, which the cores' kernels do not accept: copy them."""
    return RgbdFrame(
        stamp_ns=message.header.stamp_ns,
        colour=message.colour,
        depth=message.depth,
        depth_scale=message.depth_scale,
        intrinsics=Intrinsics(**message.intrinsics.model_dump(), noise=_noise(message.depth_noise)),
        T_world_camera=message.T_world_camera if isinstance(message, Frame) else None,
    )


def frame_message(header: Header, frame: RgbdFrame) -> Frame:
    """The message of a frame. Raises ValueError for what no message may hold, such as a pose that is no rotation."""
    return Frame(
        header=header,
        intrinsics=intrinsics_message(frame.intrinsics),
        depth_scale=frame.depth_scale,
        colour=frame.colour,
        depth=frame.depth,
        depth_noise=noise_message(frame.intrinsics.noise),
        T_world_camera=frame.T_world_camera,
    )


def intrinsics_message(camera: Intrinsics) -> CameraIntrinsics:
    """The message of a camera's intrinsics."""
    return CameraIntrinsics(**{name: getattr(camera, name) for name in CameraIntrinsics.model_fields})


def noise_message(noise: DepthNoise) -> NoiseMessage:
    """The message of the depth noise."""
    return NoiseMessage(**noise._asdict())


def calibration_of(pose: Pose) -> Calibration:
    """The calibration of the camera that a pose message states for its frame."""
    turn = (0.0, 0.0, 0.0) if pose.turn is None else (float(pose.turn[0]), float(pose.turn[1]), float(pose.turn[2]))
    centre = (0.0, 0.0) if pose.centre is None else (float(pose.centre[0]), float(pose.centre[1]))
    bend = () if pose.bend is None else tuple(tuple(row) for row in pose.bend.tolist())
    return Calibration(pose.depth_factor, turn, centre, bend)


def camera_pose(pose: Pose) -> CameraPose:
    """The pose in a message, as fusion takes it."""
    corrections = None
    if pose.corrected_ns:
        corrections = PoseCorrections(np.array(pose.corrected_ns, np.int64), pose.corrections.copy())
    T_world_camera, given_by = pose.T_world_camera.copy(), pose.header.sender
    return CameraPose(T_world_camera, pose.T_world_map, given_by, calibration_of(pose), corrections)


def corrections_message(corrections: PoseCorrections | None) -> dict[str, Any]:
    """The fields of a `Pose` that state these corrections."""
    if corrections is None:
        return {}
    stamps_ns: list[int] = corrections.stamps_ns.tolist()
    return {"corrected_ns": tuple(stamps_ns), "corrections": corrections.twists}


def _noise(stated: NoiseMessage | None) -> DepthNoise:
    return KINECT_V1 if stated is None else DepthNoise(stated.floor, stated.growth, stated.at)


def segments_message(header: Header, found: FrameSegments | None) -> Segments:
    """The message of a keyframe's segments; None: the frame is no keyframe."""
    if found is None:
        return Segments(
            header=header,
            keyframe=False,
            intrinsics=None,
            labels=np.zeros((0, 0), np.uint8),
            heat=np.zeros(0, np.float32),
            planes=np.zeros((0, 4)),
            stands_on=np.zeros(0, np.int8),
        )
    return Segments(
        header=header,
        keyframe=True,
        intrinsics=intrinsics_message(found.camera),
        labels=found.labels,
        heat=found.heat,
        planes=found.planes,
        stands_on=found.stands_on,
        left_out=found.left_out,
    )


def frame_segments(message: Segments) -> FrameSegments | None:
    """The segments in a message, copied; None if its frame is no keyframe."""
    if message.intrinsics is None:
        return None
    return FrameSegments(
        labels=message.labels.copy(),
        heat=message.heat.copy(),
        planes=message.planes.copy(),
        stands_on=message.stands_on.copy(),
        camera=Intrinsics(**message.intrinsics.model_dump()),
        left_out=message.left_out,
    )
