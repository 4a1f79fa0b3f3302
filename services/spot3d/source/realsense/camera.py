"""A live RealSense camera, which may be missing, unplugged and plugged in again."""

import time
from collections.abc import Callable, Iterator, Sequence
from threading import Event
from typing import Any

from spot3d.frame import RgbdFrame
from spot3d.source.errors import SourceError
from spot3d.source.realsense.framesets import sdk, streamed
from spot3d.source.sequence import CAMERA_LOST, CAMERA_MISSING, Note

_NAME = "realsense"
"""A camera's name as an input. `realsense:SERIAL` selects one of several."""
_SILENT_S = 3.0
"""A camera without a frame for this long is gone or hangs, and is opened anew."""
_RETRY_S = 1.0


def is_camera(name: str) -> bool:
    """Whether an input's name is that of a camera."""
    return name.partition(":")[0] == _NAME


def open_camera(name: str) -> "RealSenseCamera":
    """The camera of this name. Raises SourceError if the serial number or the SDK is missing."""
    _, colon, serial = name.partition(":")
    if colon and not serial:
        raise SourceError(f"{name} lacks a serial number; give {_NAME}:SERIAL, or {_NAME} for the first camera found")
    return RealSenseCamera(serial)


def plugged_in() -> list[Any]:
    """The cameras that are plugged in now."""
    return list(sdk().context().query_devices())


class RealSenseCamera:
    """Frames of a camera until stopped.

    serial: its serial number; empty: the first camera found. devices: returns the connected cameras.
    """

    def __init__(
        self, serial: str = "", devices: Callable[[], Sequence[Any]] = plugged_in, silent_s: float = _SILENT_S
    ) -> None:
        sdk()
        self._serial = serial
        self._devices = devices
        self._silent_s = silent_s

    def stream(self, stop: Event, note: Note) -> Iterator[RgbdFrame | None]:
        """Frames as they come, until `stop`. note: is called when the camera is found, missing or lost."""
        while not stop.is_set():
            try:
                devices = self._devices()
                wanted = [one for one in devices if not self._serial or _serial_of(one) == self._serial]
                if wanted:
                    yield from self._opened(wanted[0], stop, note)
                    continue
                note(CAMERA_MISSING, self._what_is_missing(devices))
            except (RuntimeError, ValueError) as error:  # whatever is wrong, the SDK raises these
                note(CAMERA_LOST, f"the RealSense camera is lost: {error}; waiting for it")
            yield None
            stop.wait(_RETRY_S)

    def _what_is_missing(self, devices: Sequence[Any]) -> str:
        if not self._serial:
            return "no RealSense camera is connected; waiting for one"
        found = ", ".join(map(_serial_of, devices)) or "none"
        return f"the RealSense camera {self._serial} is not connected; waiting for it; connected: {found}"

    def _opened(self, device: Any, stop: Event, note: Note) -> Iterator[RgbdFrame | None]:
        note("camera found", f"streaming from {device.get_info(sdk().camera_info.name)} {_serial_of(device)}")
        since_s = time.monotonic()
        for frame in streamed(device, stop, note, lambda: False):
            if frame is None and time.monotonic() - since_s > self._silent_s:
                raise RuntimeError(f"no pairs of depth and colour images for {self._silent_s:g} s")
            yield frame
            if frame is not None:
                since_s = time.monotonic()


def _serial_of(device: Any) -> str:
    """A device's serial number. Empty if it has none."""
    number = sdk().camera_info.serial_number
    return str(device.get_info(number)) if device.supports(number) else ""
