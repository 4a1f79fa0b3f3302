"""Warnings for people about a recording, before it is played."""

from contextlib import suppress
from dataclasses import replace

from spot3d.source.errors import SourceError
from spot3d.source.recording import Recording
from spot3d.source.selected import Selected
from spot3d.source.sequence import FrameSequence

_FOLLOWED_HZ = 3.0
"""Minimum rate at which odometry tracks from one frame to the next; at lower rates it has to search."""
_TAKEN_S = 10.0
"""Frames that are farther apart have their timestamps in another unit: milliseconds are 1000 times too far."""
_LOOKED_AT, _CLEARLY, _LEAST = 8, 1.3, 0.4
"""Frames that are examined; the ratio of colour's changes along depth's edges that decides; and the least change, for
dark frames.

Of colour that has to be moved the ratio is 4.5 with 8 frames over redkitchen, and 1.8 or more with any 8 in a row. Of
colour that lies on depth (redkitchen once moved, fr3/cabinet, built-in scenes) it is 2.7 or more.
"""
_SAY_SO = 'write {"registered": true} into calibration.json in the folder'
_ON_DEPTH = (
    "colour is shifted by some 2 cm, as the depth has the intrinsics of 7-Scenes' Kinect, but it is already "
    f"registered with depth: {_SAY_SO}"
)
_UNSURE = (
    "colour is shifted by some 2 cm onto depth, as the depth has the intrinsics of 7-Scenes' Kinect: if it is "
    f"already registered with depth, {_SAY_SO}"
)


def input_doubts(sequence: FrameSequence, odometry: bool) -> list[str]:
    """One line per warning; none if all is well. odometry: whether poses come from the frames alone."""
    doubts = []
    recording = sequence.original if isinstance(sequence, Selected) else sequence
    if isinstance(recording, Recording) and recording.colour_by_default and (doubt := _colour(recording)):
        doubts.append(doubt)
    if len(recording) > 1 and recording.rate_hz * _TAKEN_S < 1:
        apart = f"frames are {1 / recording.rate_hz:,.0f} s apart by their timestamps"
        doubts.append(f"{apart}: check that these are in seconds")
    elif odometry and len(sequence) > 1 and sequence.rate_hz < _FOLLOWED_HZ:
        text = f"frames are {1 / sequence.rate_hz:.2g} s apart, too far for accurate odometry: boxes may be too wide"
        own = ", or use the recorded poses (--pose truth)" if sequence.has_true_poses else ""
        doubts.append(f"{text}; play more frames per second{own}")
    return doubts


def _colour(recording: Recording) -> str:
    """A warning about colour that is moved onto depth because nobody has stated where it lies, or empty."""
    # OpenCV takes a while to import, and other recordings do not need it.
    from spot3d.colour_alignment import ColourAlignment

    moved, left_alone, as_it_is = ColourAlignment(), ColourAlignment(), replace(recording, colour_camera=None)
    for index in range(0, len(recording), max(1, len(recording) // _LOOKED_AT)):
        with suppress(SourceError):  # the run counts unreadable frames
            frame = recording[index]
            metres = frame.depth_metres()
            moved.add(frame.colour, metres)
            left_alone.add(as_it_is[index].colour, metres)
    changes, as_is = moved.on_depth(), left_alone.on_depth()
    if changes > _CLEARLY * max(as_is, _LEAST):
        return ""
    return _ON_DEPTH if as_is > _CLEARLY * max(changes, _LEAST) else _UNSURE
