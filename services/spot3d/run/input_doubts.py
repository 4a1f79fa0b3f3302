"""What of a recording is in doubt before it is played, for people."""

from spot3d.source.recording import Recording
from spot3d.source.selected import Selected
from spot3d.source.sequence import FrameSequence

_FOLLOWED_HZ = 3.0
"""Odometry goes on from one frame to the next at this rate; what comes later than that is searched for."""
_COLOUR = (
    "colour is taken for that of 7-Scenes' Kinect, whose intrinsics the depth has, and moved by some 2 cm onto it: "
    'where it lies on depth already, say so in calibration.json in the folder: {"registered": true}'
)


def input_doubts(sequence: FrameSequence, odometry: bool) -> list[str]:
    """One line for each doubt; none where all is well. odometry: whether poses come of the frames alone."""
    doubts = []
    recording = sequence.original if isinstance(sequence, Selected) else sequence
    if isinstance(recording, Recording) and recording.colour_by_default:
        doubts.append(_COLOUR)
    if odometry and len(sequence) > 1 and sequence.rate_hz < _FOLLOWED_HZ:
        text = f"frames are {1 / sequence.rate_hz:.2g} s apart, which odometry follows roughly: boxes may be too wide"
        own = ", or take the poses that are recorded (--pose truth)" if sequence.has_true_poses else ""
        doubts.append(f"{text}; play more frames a second{own}")
    return doubts
