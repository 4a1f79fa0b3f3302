"""Which frames of a camera or a recording are played."""

import threading
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame
from spot3d.source import selected
from spot3d.source.selected import Selection, open_selected_stream, open_selection
from spot3d.source.sequence import Note
from spot3d.source.settings import SourceSettings

CAMERA = Intrinsics(4.0, 4.0, 1.5, 1.5, 4, 4)


class HaltingCamera:
    """Gives no frame before each of ten."""

    def stream(self, stop: threading.Event, note: Note) -> Iterator[RgbdFrame | None]:
        for number in range(10):
            yield None
            yield RgbdFrame(number, np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4), np.uint16), 0.001, CAMERA)


@pytest.mark.parametrize(
    ("frames", "every", "halved", "stamps"),
    [
        (None, 1, False, list(range(10))),
        (None, 4, True, [0, 4, 8]),
        (2, 3, False, [0, 3]),
        (3, 1, True, [0, 1, 2]),
    ],
)
def test_frames_are_counted_and_their_absence_is_passed_on(
    frames: int | None, every: int, halved: bool, stamps: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(selected, "open_stream", lambda _name: HaltingCamera())
    stream = open_selected_stream(Selection("realsense", frames, every), SourceSettings(halved=halved))
    told = list(stream.stream(threading.Event(), lambda _kind, _text: None))
    played = [frame for frame in told if frame is not None]
    assert [frame.stamp_ns for frame in played] == stamps
    assert {frame.depth.shape for frame in played} == {(2, 2) if halved else (4, 4)}
    assert told.count(None) >= stamps[-1]


@pytest.mark.parametrize(("name", "stamps"), [("walk.db3", [6, 8]), ("realsense", [0, 2, 4, 6, 8])])
def test_a_recording_that_is_begun_again_goes_on_where_it_was(
    name: str, stamps: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its frames count from its beginning; a camera has no others than new ones, whatever its clock says."""
    monkeypatch.setattr(selected, "open_stream", lambda _name: HaltingCamera())
    stream = open_selected_stream(Selection(name, frames=5, every=2, after_ns=5), SourceSettings())
    given = [frame for frame in stream.stream(threading.Event(), lambda _kind, _text: None) if frame is not None]
    assert [frame.stamp_ns for frame in given] == stamps


def test_a_selection_is_at_half_size_as_the_settings_open_it(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for number in range(3):
        colour, depth = rng.integers(0, 256, (480, 640, 3), np.uint8), np.full((480, 640), 1500, np.uint16)
        cv2.imwrite(str(tmp_path / f"frame-{number:06d}.color.png"), colour)
        cv2.imwrite(str(tmp_path / f"frame-{number:06d}.depth.png"), depth)
    chosen = Selection(str(tmp_path), every=2, intrinsics=(585.0, 585.0, 320.0, 240.0))
    opened = open_selection(chosen, SourceSettings(halved=True))
    halved = open_selection(chosen, SourceSettings()).at_half_size()
    assert len(halved) == len(opened) == 2
    assert halved.intrinsics == opened.intrinsics == halved[1].intrinsics
    np.testing.assert_array_equal(halved[1].colour, opened[1].colour)
    np.testing.assert_array_equal(halved[1].depth, opened[1].depth)
