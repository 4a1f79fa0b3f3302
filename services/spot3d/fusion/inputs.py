"""Which frames may be fused now: heat, pose and segments of one stamp come together, each by its own way."""

from dataclasses import dataclass, field

from spot3d.dataflow.join import NO_HEAT, NO_POSE, Join, Outcome
from spot3d.dataflow.node import Received
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import Heat, Pose, Segments

NO_SEGMENTS, WITHOUT_FRAME = "no segments", "segments without their frame"
"""What else may be missing: the segments of a lossless frame, or live the frame of segments, which was skipped, or
fused too long ago."""

_HEATS_WAITING = 8
"""Live: heats that wait for their poses, which mostly come first; 15 MB at VGA."""
_POSES_WAITING = 256
_EARLY = 16
"""Live: keyframes' segments that have come before their frame was fused; 0.1 MB each."""

Pair = tuple[Received[Heat], Received[Pose]]
HeatsAndPoses = Join[Received[Heat], Received[Pose]]


@dataclass(frozen=True, slots=True)
class Ready:
    """A frame to be fused, and its segments where they are there; their time is that of `heat`."""

    heat: Received[Heat]
    pose: Received[Pose]
    segments: Received[Segments] | None


@dataclass(slots=True)
class Arrival:
    """What one message led to.

    ready: frames to be fused, in order. late: segments of a frame that was fused before. skipped: stamps of frames
    that will not be fused, and why. drops: how often something else is missing, by reason.
    """

    ready: list[Ready] = field(default_factory=list)
    late: Received[Segments] | None = None
    skipped: list[tuple[int, str]] = field(default_factory=list)
    drops: list[str] = field(default_factory=list)


class LiveInputs:
    """A frame is ready when heat and pose are there; segments find it whenever they come.

    alone: frames that were ready since the segments stage last said anything.
    """

    def __init__(self) -> None:
        self.alone = 0
        self._answered_ns: int | None = None
        self._pairs: HeatsAndPoses = Join(_HEATS_WAITING, _POSES_WAITING)
        self._early: dict[int, Received[Segments]] = {}
        self._last_ns: int | None = None

    def add_heat(self, given: Received[Heat]) -> Arrival:
        """Take in a frame's heat."""
        return self._paired(self._pairs.add_left(given.message.header.stamp_ns, given))

    def add_pose(self, given: Received[Pose]) -> Arrival:
        """Take in a frame's pose."""
        return self._paired(self._pairs.add_right(given.message.header.stamp_ns, given))

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

    def rest(self) -> list[Ready]:
        """What still waits when the stream has ended: nothing."""
        return []

    def clear(self) -> int:
        """Forget what waits: another stream begins. Returns how many frames that were."""
        self._early.clear()
        self._last_ns = self._answered_ns = None
        return _count(self._pairs.clear())

    def _paired(self, outcome: Outcome[Received[Heat], Received[Pose]]) -> Arrival:
        arrival = Arrival(skipped=_skipped(outcome))
        if outcome.pair is not None:
            heat, pose = outcome.pair
            self.alone += 1
            self._last_ns = heat.message.header.stamp_ns
            segments = self._early.pop(self._last_ns, None)
            arrival.ready.append(Ready(heat, pose, segments))
            arrival.drops = self._forgotten([stamp for stamp in self._early if stamp < self._last_ns])
        return arrival

    def _forgotten(self, stamps: list[int]) -> list[str]:
        for stamp in stamps:
            del self._early[stamp]
        return [WITHOUT_FRAME] * len(stamps)


class LosslessInputs:
    """A frame is ready when heat, pose and the answer of the segments stage are there.

    alone, unanswered: as no frame that was ready is.
    """

    def __init__(self, in_flight: int) -> None:
        self.alone, self.unanswered = 0, False
        self._pairs: HeatsAndPoses = Join(max(_HEATS_WAITING, 2 * in_flight), _POSES_WAITING)
        self._answers: Join[Pair, Received[Segments]] = Join(2 * in_flight, _POSES_WAITING)
        self._waiting: dict[int, Pair] = {}

    def add_heat(self, given: Received[Heat]) -> Arrival:
        """Take in a frame's heat."""
        return self._paired(self._pairs.add_left(given.message.header.stamp_ns, given))

    def add_pose(self, given: Received[Pose]) -> Arrival:
        """Take in a frame's pose."""
        return self._paired(self._pairs.add_right(given.message.header.stamp_ns, given))

    def add_segments(self, given: Received[Segments]) -> Arrival:
        """Take in what the segments stage answers to a frame."""
        arrival = Arrival()
        self._answered(arrival, self._answers.add_right(given.message.header.stamp_ns, given))
        return arrival

    def rest(self) -> list[Ready]:
        """What still waits for segments when the stream has ended, in order."""
        pairs, self._waiting = self._waiting, {}
        self._answers.clear()
        return [Ready(heat, pose, None) for heat, pose in pairs.values()]

    def clear(self) -> int:
        """Forget what waits: another stream begins. Returns how many frames that were."""
        return len(self.rest()) + _count(self._pairs.clear())

    def _paired(self, outcome: Outcome[Received[Heat], Received[Pose]]) -> Arrival:
        arrival = Arrival(skipped=_skipped(outcome))
        if outcome.pair is not None:
            stamp_ns = outcome.pair[0].message.header.stamp_ns
            self._waiting[stamp_ns] = outcome.pair
            self._answered(arrival, self._answers.add_left(stamp_ns, outcome.pair))
        return arrival

    def _answered(self, arrival: Arrival, outcome: Outcome[Pair, Received[Segments]]) -> None:
        """Frames that will have no answer go first: they are older than the one that has."""
        for stamp in outcome.without_right:
            heat, pose = self._waiting.pop(stamp)
            arrival.ready.append(Ready(heat, pose, None))
            arrival.drops.append(NO_SEGMENTS)
        if outcome.pair is not None:
            (heat, pose), segments = outcome.pair
            del self._waiting[heat.message.header.stamp_ns]
            arrival.ready.append(Ready(heat, pose, segments))


def inputs_of(link: LinkSettings) -> LiveInputs | LosslessInputs:
    """The inputs for a delivery."""
    return LosslessInputs(link.in_flight) if link.delivery == "lossless" else LiveInputs()


def _count(waiting: Outcome[Received[Heat], Received[Pose]]) -> int:
    return len(waiting.without_left) + len(waiting.without_right)


def _skipped(outcome: Outcome[Received[Heat], Received[Pose]]) -> list[tuple[int, str]]:
    skipped = [(stamp, NO_HEAT) for stamp in outcome.without_left]
    return sorted(skipped + [(stamp, NO_POSE) for stamp in outcome.without_right])
