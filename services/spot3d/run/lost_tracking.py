"""When tracking was lost, for the report and for people."""

from collections.abc import Sequence
from dataclasses import dataclass

_MOST = 100
"""Maximum number of stretches listed: the longest."""
_TOLD = 10
"""Minimum number of frames that are reported to people: of a stretch, or of all where each is shorter."""


@dataclass(slots=True)
class Stretch:
    """Consecutive frames whose pose is lost: first and last stamp, number, and whether it lasts to the end.

    reason: why the last of them is lost. from_the_start: no frame was tracked before.
    """

    from_ns: int
    to_ns: int
    frames: int
    to_the_end: bool = False
    reason: str = ""
    from_the_start: bool = False


class LostTracking:
    """Counts the frames whose pose is lost, and keeps their longest stretches. Add frames in the order of stamps."""

    def __init__(self) -> None:
        self.frames = 0
        self._followed = False
        self._stretches: list[Stretch] = []

    def add(self, stamp_ns: int, lost: bool, reason: str = "") -> None:
        """Add the next frame. reason: why it is lost."""
        found = self._stretches
        goes_on = bool(found) and found[-1].to_the_end
        if not lost:
            self._followed = True
            if goes_on:
                found[-1].to_the_end = False
            return
        self.frames += 1
        if goes_on:
            found[-1].to_ns, found[-1].frames, found[-1].reason = stamp_ns, found[-1].frames + 1, reason
            return
        if len(found) >= 2 * _MOST:
            self._stretches = found = self.stretches()
        found.append(Stretch(stamp_ns, stamp_ns, 1, True, reason, not self._followed))

    def stretches(self) -> list[Stretch]:
        """The stretches in the order of their stamps, at most the hundred longest."""
        longest = sorted(self._stretches, key=lambda stretch: -stretch.frames)[:_MOST]
        return sorted(longest, key=lambda stretch: stretch.from_ns)


def notice(found: Sequence[Stretch], given_poses: bool = False) -> str:
    """One line for people; empty where tracking was never lost for long. given_poses: they are no odometry's."""
    long = [stretch for stretch in found if stretch.frames >= _TOLD or (stretch.from_the_start and stretch.to_the_end)]
    if not long and sum(stretch.frames for stretch in found) >= _TOLD:
        long = list(found)
    if not long:
        return ""
    count, last = sum(stretch.frames for stretch in long), long[-1]
    text = f"tracking was lost in {count} frames" + (f", in {len(long)} stretches" if len(long) > 1 else "")
    if last.to_the_end and last.from_the_start:
        text = f"none of the {count} frames could be tracked" if count > 1 else "the only frame could not be tracked"
    elif last.to_the_end and last.frames >= _TOLD:
        text += f", the last {last.frames} of them to the end"
        text += "" if given_poses else ": the camera did not return to a place that it saw before"
    longest = max(long, key=lambda stretch: stretch.frames)
    return f"{text} ({longest.reason})" if longest.reason else text
