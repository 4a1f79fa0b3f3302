"""Which of a camera's frames are played."""

import threading
from collections.abc import Iterator

import numpy as np
import pytest

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame
from spot3d.source import selected
from spot3d.source.selected import Selection, open_selected_stream
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
