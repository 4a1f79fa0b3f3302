import threading
import time
from pathlib import Path

import numpy as np
import pytest
from software_camera import BASELINE_MM, UNIT, SoftwareCamera, record

from spot3d.camera import Intrinsics
from spot3d.depth_noise import PRESETS, stereo_noise
from spot3d.frame import RgbdFrame
from spot3d.settings import load_settings
from spot3d.source.errors import SourceError
from spot3d.source.realsense.camera import RealSenseCamera
from spot3d.source.selected import Selection, open_selected_stream
from spot3d.source.sequence import FrameStream
from spot3d.source.sequences import is_stream, open_stream

CAMERA = Intrinsics(60.0, 61.0, 31.5, 23.5, 64, 48)
LIMIT_S = 60.0


def images(number: int) -> tuple[np.ndarray, np.ndarray]:
    colour = np.full((*CAMERA.shape, 3), (number, 2 * number, 200), np.uint8)
    depth = np.full(CAMERA.shape, 2000 + number, np.uint16)
    depth[:4] = 0
    return depth, colour


class Listener:
    """Takes a camera's frames on a thread, as the source's process does."""

    def __init__(self, camera: FrameStream) -> None:
        self.frames: list[RgbdFrame] = []
        self.notes: list[str] = []
        self.texts: list[str] = []
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self._listen, args=(camera,))
        self.thread.start()

    def _listen(self, camera: FrameStream) -> None:
        def note(kind: str, text: str) -> None:
            self.texts.append(text)
            self.notes.append(kind)

        for frame in camera.stream(self.stop, note):
            if frame is not None:
                self.frames.append(frame)

    def end(self) -> None:
        self.stop.set()
        self.thread.join(LIMIT_S)
        assert not self.thread.is_alive()


def feed(camera: SoftwareCamera, listener: Listener, first: int, wanted: int) -> None:
    """Send frames until so many more have come through the SDK."""
    number, target, end_s = first, len(listener.frames) + wanted, time.monotonic() + LIMIT_S
    while len(listener.frames) < target:
        assert time.monotonic() < end_s, listener.notes
        camera.send(number, 1_700_000_000_000 + 33.25 * number, *images(number % 100))
        number += 1
        time.sleep(0.01)


def wait_for(listener: Listener, notes: list[str]) -> None:
    end_s = time.monotonic() + LIMIT_S
    while listener.notes[: len(notes)] != notes:
        assert time.monotonic() < end_s, listener.notes
        time.sleep(0.01)


def test_a_camera_that_is_plugged_in_late_unplugged_and_plugged_in_again() -> None:
    plugged: list[SoftwareCamera] = []

    listener = Listener(RealSenseCamera(devices=lambda: [one.device for one in plugged], silent_s=0.5))
    try:
        wait_for(listener, ["camera missing"])
        plugged.append(SoftwareCamera(CAMERA))
        while "camera found" not in listener.notes:
            time.sleep(0.01)
        feed(plugged[0], listener, 1, 5)
        listener.notes.clear()
        gone = plugged.pop()  # sends no more, and is not found
        wait_for(listener, ["camera lost", "camera missing"])
        plugged.append(SoftwareCamera(CAMERA))
        while "camera found" not in listener.notes:
            time.sleep(0.01)
        feed(plugged[0], listener, 1000, 5)
        del gone
    finally:
        listener.end()
    for frame in listener.frames:
        number = int(frame.depth.max()) - 2000
        depth, colour = images(number)
        np.testing.assert_array_equal(frame.depth, depth)
        np.testing.assert_array_equal(frame.colour, colour)
        assert frame.depth_scale == pytest.approx(UNIT)
        assert frame.intrinsics == CAMERA
        assert frame.intrinsics.noise == stereo_noise(BASELINE_MM / 1000, CAMERA.fx)
    stamps = [frame.stamp_ns for frame in listener.frames]
    assert stamps == sorted(set(stamps))
    assert stamps[0] > 1_700_000_000 * 10**9


def test_a_camera_whose_colour_stalls_is_lost_until_colour_comes_again() -> None:
    camera = SoftwareCamera(CAMERA)
    listener = Listener(RealSenseCamera(devices=lambda: [camera.device], silent_s=0.5))
    try:
        while "camera found" not in listener.notes:
            time.sleep(0.01)
        feed(camera, listener, 1, 5)
        number, end_s = 10_000, time.monotonic() + LIMIT_S
        while "camera lost" not in listener.notes:
            assert time.monotonic() < end_s, listener.notes
            camera.send(number, 1_700_000_000_000 + 33.25 * number, images(1)[0], None)
            number += 1
            time.sleep(0.01)
        assert "unmatched images" in listener.notes
        feed(camera, listener, 20_000, 5)
    finally:
        listener.end()


def test_a_camera_is_taken_by_its_serial_number() -> None:
    plugged = [SoftwareCamera(CAMERA, serial="123"), SoftwareCamera(CAMERA, serial="456")]
    listener = Listener(RealSenseCamera("789", devices=lambda: [one.device for one in plugged]))
    try:
        wait_for(listener, ["camera missing"])
        assert listener.texts == ["the RealSense camera 789 is not connected; waiting for it; connected: 123, 456"]
        listener.notes.clear()
        plugged.append(SoftwareCamera(CAMERA, serial="789"))
        while "camera found" not in listener.notes:
            time.sleep(0.01)
        assert listener.texts[-1] == "streaming from Software D435 789"
        feed(plugged[2], listener, 1, 2)
    finally:
        listener.end()


def test_a_name_with_a_serial_number_is_a_camera() -> None:
    assert is_stream("realsense:0123")
    assert isinstance(open_stream("realsense:0123"), RealSenseCamera)
    with pytest.raises(SourceError, match="realsense: lacks a serial number; give realsense:SERIAL, or realsense for"):
        open_stream("realsense:")
    assert not is_stream("realsenses:0123")


def test_depth_is_aligned_with_colour() -> None:
    camera = SoftwareCamera(CAMERA, apart=0.05)
    listener = Listener(RealSenseCamera(devices=lambda: [camera.device]))
    try:
        while "camera found" not in listener.notes:
            time.sleep(0.01)
        number = 0
        while not listener.frames:
            depth, colour = images(1)
            depth[:, 20:30] = 1000  # a bar half a metre away, before a wall twice as far
            camera.send(number, 1_700_000_000_000 + 33.25 * number, depth, colour)
            number += 1
            time.sleep(0.01)
    finally:
        listener.end()
    bar = np.flatnonzero(np.abs(listener.frames[0].depth[24].astype(int) - 1000) < 5)
    # Seen from 5 cm beside, the bar is 60 px * 0.05 m / 0.5 m = 6 px farther to the right.
    assert (bar.min(), bar.max()) == (26, 35)


def test_a_recording_of_the_sdk_plays_like_a_camera(tmp_path: Path) -> None:
    path = tmp_path / "walk.db3"
    record(SoftwareCamera(CAMERA), path, [images(number) for number in range(1, 13)])
    assert is_stream(str(path))
    settings = load_settings(overrides={"source": {"depth_noise": "d455"}})
    stream = open_selected_stream(Selection(str(path), frames=6), settings.source)
    played = [frame for frame in stream.stream(threading.Event(), lambda _kind, _text: None) if frame is not None]
    assert 4 <= len(played) <= 6, "the SDK gives what has come when it is asked"
    for frame in played:
        number = (frame.stamp_ns - 1_700_000_000_000_000_000) / 33_250_000
        depth, colour = images(round(number))
        assert number == round(number)
        np.testing.assert_array_equal(frame.depth, depth)
        # The SDK's newer recordings hold JPEG.
        assert np.abs(frame.colour.astype(int) - colour).max() <= 4
        assert frame.intrinsics == CAMERA
        assert frame.intrinsics.noise == PRESETS["d455"]


def test_a_recording_that_is_damaged_is_told(tmp_path: Path) -> None:
    path = tmp_path / "walk.bag"
    head = b"#ROSBAG V2.0\n\x45\x00\x00\x00\x12\x00\x00\x00index_pos=" + (200).to_bytes(8, "little")
    path.write_bytes(head.ljust(200, b"\0") + b"topic=/device_0/sensor_0/Depth_0/image/data")
    assert is_stream(str(path))
    with pytest.raises(SourceError, match=r"walk\.bag cannot be played"):
        list(open_stream(str(path)).stream(threading.Event(), lambda _kind, _text: None))
