"""Frames from the RealSense SDK: depth aligned with colour, its unit, stamp, intrinsics and noise."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from threading import Event
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.depth_noise import KINECT_V1, TIME_OF_FLIGHT, DepthNoise, stereo_noise
from spot3d.frame import RgbdFrame
from spot3d.source.errors import SourceError
from spot3d.source.sequence import Note

log = logging.getLogger(__name__)

_TOGETHER_MS = 20.0
"""Largest time between the depth and the colour image of one frame."""
_WAIT_MS = 200
# Stereo is best at 848 x 480 (Intel's tuning guide), which USB 2 cannot carry. Last resort: any size.
_WANTED = (((848, 480), (640, 480)), ((640, 480), (640, 480)), ((0, 0), (0, 0)))


def sdk() -> Any:
    """The package pyrealsense2. Raises SourceError if it is not installed, or lacks a system library."""
    try:
        import pyrealsense2
    except ModuleNotFoundError:
        hint = "which is not installed: pip install 'spot3d[realsense]'"
        raise SourceError(f"RealSense cameras and recordings need pyrealsense2, {hint}") from None
    except ImportError as error:
        hint = f"which cannot be loaded ({error}): on Debian and Ubuntu install libusb-1.0-0"
        raise SourceError(f"RealSense cameras and recordings need pyrealsense2, {hint}") from None
    return pyrealsense2


def streamed(device: Any, stop: Event, note: Note, ended: Callable[[], bool]) -> Iterator[RgbdFrame | None]:
    """Frames of a device, live or played, until `stop`, or until nothing comes and `ended` is true. None: none yet.

    If no new colour image comes, the SDK repeats the last one with each depth image. These pairs are dropped, and
    `note` is told. Raises RuntimeError, as the SDK does for every fault, and ValueError.
    """
    rs = sdk()
    pipeline = rs.pipeline(rs.context())
    pipeline.set_device(device)
    _start(pipeline, device.is_playback())
    try:
        framesets = Framesets(device)
        while not stop.is_set():
            arrived, frameset = pipeline.try_wait_for_frames(_WAIT_MS)
            if arrived and _are_together(frameset):
                yield framesets.frame(frameset)
                continue
            if arrived:
                note("unmatched images", "depth images without a colour image of the same time are left out")
            elif ended():
                return
            yield None
    finally:
        with suppress(RuntimeError):  # unplugged: it has stopped already
            pipeline.stop()


def _are_together(frameset: Any) -> bool:
    """Whether depth and colour are there and of the same time."""
    depth, colour = frameset.get_depth_frame(), frameset.get_color_frame()
    return bool(depth and colour) and abs(depth.get_timestamp() - colour.get_timestamp()) <= _TOGETHER_MS


def _start(pipeline: Any, recorded: bool) -> None:
    rs, refused = sdk(), None
    for depth, colour in _WANTED[:1] if recorded else _WANTED:
        config = rs.config()
        if recorded:
            config.enable_stream(rs.stream.depth)
            config.enable_stream(rs.stream.color)
        else:
            config.enable_stream(rs.stream.depth, *depth, rs.format.z16, 30)
            config.enable_stream(rs.stream.color, *colour, rs.format.rgb8, 30)
        try:
            pipeline.start(config)
            return
        except RuntimeError as error:
            refused = error
    raise RuntimeError(f"it cannot stream depth and colour together ({refused})")


class Framesets:
    """Converts a device's framesets to frames. Make a new one for each start of the device."""

    def __init__(self, device: Any) -> None:
        rs = sdk()
        self._rs = rs
        self._device = device
        self._sensor = device.first_depth_sensor()
        self._scale = float(self._sensor.get_depth_scale())
        self._noise: DepthNoise | None = None
        self._align = rs.align(rs.stream.color)
        self._played = device.is_playback()
        self._ahead_ns: int | None = None

    def frame(self, frameset: Any) -> RgbdFrame:
        """Depth resampled to the colour camera's pixels, with colour.

        Hardware clock stamps of a live device are shifted to this machine's clock. Raises ValueError if the colour
        format is not supported.
        """
        depth = frameset.get_depth_frame()
        stamp_ns = self._stamp_ns(depth)
        if self._noise is None:
            self._noise = _noise(self._rs, self._device, self._sensor, depth)
        aligned = self._align.process(frameset)
        image = aligned.get_color_frame()
        k = image.profile.as_video_stream_profile().get_intrinsics()
        camera = Intrinsics(k.fx, k.fy, k.ppx, k.ppy, k.width, k.height, self._noise)
        # Copied: the SDK reuses its buffers.
        units = np.array(aligned.get_depth_frame().get_data())
        return RgbdFrame(stamp_ns, self._rgb(image), units, self._scale, camera)

    def _stamp_ns(self, depth: Any) -> int:
        # The SDK gives milliseconds as floats, which do not resolve nanoseconds since 1970.
        stamp_ns = 1000 * round(1000 * float(depth.get_timestamp()))
        if self._played or depth.get_frame_timestamp_domain() != self._rs.timestamp_domain.hardware_clock:
            return stamp_ns
        if self._ahead_ns is None:
            self._ahead_ns = time.time_ns() - stamp_ns
        return stamp_ns + self._ahead_ns

    def _rgb(self, image: Any) -> NDArray[np.uint8]:
        form, pixels = image.profile.format(), np.array(image.get_data())
        if form == self._rs.format.bgr8:
            return np.ascontiguousarray(pixels[..., ::-1])
        if form != self._rs.format.rgb8:
            raise ValueError(f"the colour format is {form}; use rgb8 or bgr8")
        return pixels


def _noise(rs: Any, device: Any, sensor: Any, depth: Any) -> DepthNoise:
    """Depth noise of the device; of a stereo camera, from its baseline and the focal length of unaligned depth."""
    if sensor.supports(rs.option.stereo_baseline):
        focal = depth.profile.as_video_stream_profile().get_intrinsics().fx
        return stereo_noise(sensor.get_option(rs.option.stereo_baseline) / 1000, focal)
    name = device.get_info(rs.camera_info.name) if device.supports(rs.camera_info.name) else ""
    if "L5" in name:  # the lidar cameras
        return TIME_OF_FLIGHT
    log.warning(
        "the camera %s does not state its baseline; the depth noise of a Kinect v1 is assumed (--noise sets another)",
        name,
    )
    return KINECT_V1
