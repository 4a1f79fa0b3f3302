"""Messages as the cores see them."""

from dataclasses import asdict

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame
from spot3d_schemas import CameraIntrinsics, Frame, Heat


def rgbd_frame(message: Frame | Heat) -> RgbdFrame:
    """The RGB-D frame in a message. Its images are read-only, which the cores' kernels do not take: copy them."""
    return RgbdFrame(
        stamp_ns=message.header.stamp_ns,
        colour=message.colour,
        depth=message.depth,
        depth_scale=message.depth_scale,
        intrinsics=Intrinsics(**message.intrinsics.model_dump()),
        T_world_camera=message.T_world_camera if isinstance(message, Frame) else None,
    )


def intrinsics_message(camera: Intrinsics) -> CameraIntrinsics:
    """Intrinsics as messages state them."""
    return CameraIntrinsics(**asdict(camera))
