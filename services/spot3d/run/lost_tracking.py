"""When tracking was lost, for the report and for people."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from spot3d.run.results import TrackedFrame

_MOST = 100
"""Most stretches that are listed: the longest."""
_TOLD = 10
"""A stretch of so many frames is told of."""


@dataclass(slots=True)
class Stretch:
    """Frames in a row whose pose is lost: stamps of the first and the last, how many, and whether it is the end."""

    from_ns: int
    to_ns: int
    frames: int
    to_the_end: bool = False


def stretches(trajectory: Iterable[TrackedFrame]) -> list[Stretch]:
    """The stretches of a trajectory in the order of its stamps, at most the hundred longest."""
    found: list[Stretch] = []
    lost = False
    for item in trajectory:
        if item.lost and lost:
            found[-1].to_ns, found[-1].frames = item.stamp_ns, found[-1].frames + 1
        elif item.lost:
            found.append(Stretch(item.stamp_ns, item.stamp_ns, 1))
        lost = item.lost
    if lost:
        found[-1].to_the_end = True
    longest = sorted(found, key=lambda stretch: -stretch.frames)[:_MOST]
    return sorted(longest, key=lambda stretch: stretch.from_ns)


def told(found: Sequence[Stretch]) -> str:
    """One line for people; empty where tracking was never lost for long."""
    long = [stretch for stretch in found if stretch.frames >= _TOLD]
    if not long:
        return ""
    count, last = sum(stretch.frames for stretch in long), long[-1]
    text = f"tracking was lost in {count} frames" + (f", in {len(long)} stretches" if len(long) > 1 else "")
    if last.to_the_end:
        text += f", the last {last.frames} of them to the end: the camera had to move back to where it was"
    return text
