"""A RealSense camera without hardware: the SDK's own software device, which feeds frames through the real SDK."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spot3d.camera import Intrinsics

rs = pytest.importorskip(
    "pyrealsense2", reason="pyrealsense2 is not installed, or lacks libusb-1.0", exc_type=ImportError
)

UNIT = 0.0005
BASELINE_MM = 50.0


class SoftwareCamera:
    """Depth and colour of one size and place, or of cameras `apart` metres from each other."""

    def __init__(self, camera: Intrinsics, apart: float = 0.0, serial: str = "123") -> None:
        self.camera = camera
        self.device = rs.software_device()
        self.device.register_info(rs.camera_info.serial_number, serial)
        self.device.register_info(rs.camera_info.name, "Software D435")
        self.depth_sensor, self.colour_sensor = self.device.add_sensor("Depth"), self.device.add_sensor("Color")
        self.depth = self.depth_sensor.add_video_stream(self._stream(rs.stream.depth, 1, 2, rs.format.z16), True)
        self.colour = self.colour_sensor.add_video_stream(self._stream(rs.stream.color, 2, 3, rs.format.rgb8), True)
        self.depth_sensor.add_read_only_option(rs.option.depth_units, UNIT)
        self.depth_sensor.add_read_only_option(rs.option.stereo_baseline, BASELINE_MM)
        beside = rs.extrinsics()
        beside.rotation, beside.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [apart, 0, 0]
        self.depth.register_extrinsics_to(self.colour, beside)
        self.device.create_matcher(rs.matchers.default)

    def send(self, number: int, stamp_ms: float, depth: np.ndarray, colour: np.ndarray | None) -> None:
        """Feed one depth image (h, w) uint16 and one colour image (h, w, 3) uint8 RGB; None: no colour comes."""
        for sensor, profile, pixels, size in (
            (self.depth_sensor, self.depth, depth, 2),
            (self.colour_sensor, self.colour, colour, 3),
        ):
            if pixels is None:
                continue
            frame = rs.software_video_frame()
            frame.pixels, frame.bpp, frame.stride = pixels, size, size * self.camera.width
            frame.timestamp, frame.domain, frame.frame_number = stamp_ms, rs.timestamp_domain.system_time, number
            frame.profile = profile.as_video_stream_profile()
            if sensor is self.depth_sensor:
                frame.depth_units = UNIT
            sensor.on_video_frame(frame)

    def _stream(self, kind: Any, uid: int, size: int, form: Any) -> Any:
        k, stream = rs.intrinsics(), rs.video_stream()
        k.width, k.height, k.fx, k.fy = self.camera.width, self.camera.height, self.camera.fx, self.camera.fy
        k.ppx, k.ppy, k.model, k.coeffs = self.camera.cx, self.camera.cy, rs.distortion.none, [0.0] * 5
        stream.type, stream.index, stream.uid, stream.fps = kind, 0, uid, 30
        stream.width, stream.height, stream.bpp, stream.fmt = k.width, k.height, size, form
        stream.intrinsics = k
        return stream


def record(
    camera: SoftwareCamera, path: Path, images: Sequence[tuple[np.ndarray, np.ndarray]], gap_ms: float = 33.25
) -> None:
    """Record depth and colour images with the SDK's own recorder, their stamps `gap_ms` apart."""
    recorder = rs.recorder(str(path), camera.device)
    sensors, queue = recorder.query_sensors(), rs.frame_queue(100)
    for sensor in sensors:
        sensor.open(sensor.get_stream_profiles()[0])
        sensor.start(queue)
    for number, (depth, colour) in enumerate(images, start=1):
        camera.send(number, 1_700_000_000_000 + gap_ms * number, depth, colour)
        time.sleep(0.02)
    for sensor in sensors:
        sensor.stop()
        sensor.close()
