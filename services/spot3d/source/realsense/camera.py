"""A RealSense camera, live: it may be missing, unplugged and plugged in again."""

import time
from collections.abc import Callable, Iterator
from threading import Event
from typing import Any

from spot3d.frame import RgbdFrame
from spot3d.source.realsense.framesets import sdk, streamed
from spot3d.source.sequence import CAMERA_LOST, CAMERA_MISSING, Note

NAME = "realsense"
"""What the camera is called as an input."""
_SILENT_S = 3.0
"""A camera without a frame for so long is gone, or hangs: it is opened anew."""
_RETRY_S = 1.0


def first_device() -> Any | None:
    """The first camera that is plugged in, or None."""
    devices = sdk().context().query_devices()
    return devices[0] if len(devices) else None


class RealSenseCamera:
    """Frames of a camera for as long as they are wanted. find: gives the device to open, None while there is none."""

    def __init__(self, find: Callable[[], Any | None] = first_device, silent_s: float = _SILENT_S) -> None:
        sdk()
        self._find = find
        self._silent_s = silent_s

    def stream(self, stop: Event, note: Note) -> Iterator[RgbdFrame | None]:
        """Frames as they come, until `stop`; note: is told when the camera is found, missing or lost."""
        while not stop.is_set():
            try:
                device = self._find()
                if device is not None:
                    yield from self._opened(device, stop, note)
                    continue
                note(CAMERA_MISSING, "no RealSense camera is plugged in; waiting for one")
            except (RuntimeError, ValueError) as error:  # what the SDK raises, whatever is wrong
                note(CAMERA_LOST, f"the RealSense camera is lost: {error}; waiting for it")
            yield None
            stop.wait(_RETRY_S)

    def _opened(self, device: Any, stop: Event, note: Note) -> Iterator[RgbdFrame | None]:
        note("camera found", f"streaming from {device.get_info(sdk().camera_info.name)}")
        since_s = time.monotonic()
        for frame in streamed(device, stop, note, lambda: False):
            if frame is None and time.monotonic() - since_s > self._silent_s:
                raise RuntimeError(f"no depth with colour for {self._silent_s:g} s")
            yield frame
            if frame is not None:
                since_s = time.monotonic()
