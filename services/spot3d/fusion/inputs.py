"""Which frames may be fused now: heat, pose and segments of one stamp come together, each by its own way."""

from dataclasses import dataclass, field

from spot3d.dataflow.join import Join, Outcome, Skipped, heat_pose_join
from spot3d.dataflow.node import Received
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import Heat, Pose, Segments

NO_SEGMENTS, WITHOUT_FRAME = "no segments", "segments without their frame"
"""What else may be missing: the segments of a lossless frame, or live the frame of segments, which was skipped, or
fused too long ago."""

_ANSWERS_WAITING = 256
"""Lossless: answers of the segments stage that wait for heat and pose."""
_EARLY = 16
"""Live: keyframes' segments that have come before their frame was fused; 0.1 MB each."""


@dataclass(frozen=True, slots=True)
class Ready:
    """A frame to be fused, and its segments where they are there; their time is that of `heat`."""

    heat: Received[Heat]
    pose: Received[Pose]
    segments: Received[Segments] | None


@dataclass(slots=True)
class Arrival:
    """What one message led to.

    frames: to be fused or skipped, in order: none before it is left. late: segments of a frame that was fused before.
    drops: how often something else is missing, by reason.
    """

    frames: list[Ready | Skipped] = field(default_factory=list)
    late: Received[Segments] | None = None
    drops: list[str] = field(default_factory=list)


class LiveInputs:
    """A frame is ready when heat and pose are there; segments find it whenever they come.

    alone: frames that were ready since the segments stage last said anything.
    """

    def __init__(self, link: LinkSettings) -> None:
        self.alone = 0
        self._answered_ns: int | None = None
        self._pairs = heat_pose_join(link)
        self._early: dict[int, Received[Segments]] = {}
        self._last_ns: int | None = None

    def add_heat(self, given: Received[Heat]) -> Arrival:
        """Take in a frame's heat."""
        return self._paired(self._pairs.add_left(given))

    def add_pose(self, given: Received[Pose]) -> Arrival:
        """Take in a frame's pose."""
        return self._paired(self._pairs.add_right(given))

    def add_segments(self, given: Received[Segments]) -> Arrival:
        """Take in a frame's segments; of a frame that is no keyframe there is nothing to keep."""
        self.alone = 0
        self._answered_ns = stamp_ns = given.message.header.stamp_ns
        if not given.message.keyframe:
            return Arrival()
        if self._last_ns is not None and stamp_ns <= self._last_ns:
            return Arrival(late=given)
        self._early[stamp_ns] = given
        return Arrival(drops=self._forgotten(list(self._early)[:-_EARLY]))

    @property
    def unanswered(self) -> bool:
        """Whether the segments stage has not come to the last frame yet: it may be looking at keyframes before it."""
        return self._last_ns is not None and (self._answered_ns is None or self._answered_ns < self._last_ns)

    def rest(self) -> list[Ready | Skipped]:
        """What still waits when the stream has ended: nothing."""
        return []

    def clear(self) -> int:
        """Forget what waits: another stream begins. Returns how many frames that were."""
        self._early.clear()
        self._last_ns = self._answered_ns = None
        return len(self._pairs.clear())

    def _paired(self, outcome: Outcome[Heat, Pose]) -> Arrival:
        arrival = Arrival([*sorted(outcome.skipped)])
        if outcome.pair is not None:
            heat, pose = outcome.pair
            self.alone += 1
            self._last_ns = heat.message.header.stamp_ns
            segments = self._early.pop(self._last_ns, None)
            arrival.frames.append(Ready(heat, pose, segments))
            arrival.drops = self._forgotten([stamp for stamp in self._early if stamp < self._last_ns])
        return arrival

    def _forgotten(self, stamps: list[int]) -> list[str]:
        for stamp in stamps:
            del self._early[stamp]
        return [WITHOUT_FRAME] * len(stamps)


class LosslessInputs:
    """A frame is ready when heat, pose and the answer of the segments stage are there.

    One that is skipped waits for those before it: all frames up to the last that is told of are accounted for.
    alone, unanswered: as no frame that was ready is.
    """

    def __init__(self, link: LinkSettings) -> None:
        self.alone, self.unanswered = 0, False
        self._pairs = heat_pose_join(link)
        self._answers = Join[Heat, Segments](2 * link.in_flight, _ANSWERS_WAITING, WITHOUT_FRAME, NO_SEGMENTS)
        self._waiting: dict[int, tuple[Received[Heat], Received[Pose]]] = {}
        self._behind: dict[int, list[Skipped]] = {}

    def add_heat(self, given: Received[Heat]) -> Arrival:
        """Take in a frame's heat."""
        return self._paired(self._pairs.add_left(given))

    def add_pose(self, given: Received[Pose]) -> Arrival:
        """Take in a frame's pose."""
        return self._paired(self._pairs.add_right(given))

    def add_segments(self, given: Received[Segments]) -> Arrival:
        """Take in what the segments stage answers to a frame."""
        arrival = Arrival()
        self._answered(arrival, self._answers.add_right(given))
        return arrival

    def rest(self) -> list[Ready | Skipped]:
        """What still waits for segments when the stream has ended, and what waits for that, in order."""
        frames: list[Ready | Skipped] = []
        for stamp in list(self._waiting):
            frames += self._leaving(stamp, None)
        self._answers.clear()
        return frames

    def clear(self) -> int:
        """Forget what waits: another stream begins. Returns how many frames that were."""
        return len(self.rest()) + len(self._pairs.clear())

    def _paired(self, outcome: Outcome[Heat, Pose]) -> Arrival:
        arrival = Arrival()
        newest = next(reversed(self._waiting), None)
        behind = arrival.frames if newest is None else self._behind.setdefault(newest, [])
        behind += sorted(outcome.skipped)
        if outcome.pair is not None:
            heat = outcome.pair[0]
            self._waiting[heat.message.header.stamp_ns] = outcome.pair
            self._answered(arrival, self._answers.add_left(heat))
        return arrival

    def _answered(self, arrival: Arrival, outcome: Outcome[Heat, Segments]) -> None:
        """Frames that will have no answer go first: they are older than the one that has."""
        for frame in outcome.skipped:
            if frame.reason == NO_SEGMENTS:
                arrival.frames += self._leaving(frame.stamp_ns, None)
                arrival.drops.append(NO_SEGMENTS)
        if outcome.pair is not None:
            heat, segments = outcome.pair
            arrival.frames += self._leaving(heat.message.header.stamp_ns, segments)

    def _leaving(self, stamp_ns: int, segments: Received[Segments] | None) -> list[Ready | Skipped]:
        """A frame that waits no more, and those that were skipped behind it."""
        heat, pose = self._waiting.pop(stamp_ns)
        return [Ready(heat, pose, segments), *self._behind.pop(stamp_ns, ())]


def inputs_of(link: LinkSettings) -> LiveInputs | LosslessInputs:
    """The inputs for a delivery."""
    return LosslessInputs(link) if link.delivery == "lossless" else LiveInputs(link)
