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


@dataclass(frozen=True, slots=True)
class Skipped:
    """A frame that will not be fused, and why."""

    stamp_ns: int
    reason: str


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

    def rest(self) -> list[Ready | Skipped]:
        """What still waits when the stream has ended: nothing."""
        return []

    def clear(self) -> int:
        """Forget what waits: another stream begins. Returns how many frames that were."""
        self._early.clear()
        self._last_ns = self._answered_ns = None
        return _count(self._pairs.clear())

    def _paired(self, outcome: Outcome[Received[Heat], Received[Pose]]) -> Arrival:
        arrival = Arrival([*_skipped(outcome)])
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

    def __init__(self, in_flight: int) -> None:
        self.alone, self.unanswered = 0, False
        self._pairs: HeatsAndPoses = Join(max(_HEATS_WAITING, 2 * in_flight), _POSES_WAITING)
        self._answers: Join[Pair, Received[Segments]] = Join(2 * in_flight, _POSES_WAITING)
        self._waiting: dict[int, Pair] = {}
        self._behind: dict[int, list[Skipped]] = {}

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

    def rest(self) -> list[Ready | Skipped]:
        """What still waits for segments when the stream has ended, and what waits for that, in order."""
        frames: list[Ready | Skipped] = []
        for stamp in list(self._waiting):
            frames += self._leaving(stamp, None)
        self._answers.clear()
        return frames

    def clear(self) -> int:
        """Forget what waits: another stream begins. Returns how many frames that were."""
        return len(self.rest()) + _count(self._pairs.clear())

    def _paired(self, outcome: Outcome[Received[Heat], Received[Pose]]) -> Arrival:
        arrival = Arrival()
        newest = next(reversed(self._waiting), None)
        behind = arrival.frames if newest is None else self._behind.setdefault(newest, [])
        behind += _skipped(outcome)
        if outcome.pair is not None:
            stamp_ns = outcome.pair[0].message.header.stamp_ns
            self._waiting[stamp_ns] = outcome.pair
            self._answered(arrival, self._answers.add_left(stamp_ns, outcome.pair))
        return arrival

    def _answered(self, arrival: Arrival, outcome: Outcome[Pair, Received[Segments]]) -> None:
        """Frames that will have no answer go first: they are older than the one that has."""
        for stamp in outcome.without_right:
            arrival.frames += self._leaving(stamp, None)
            arrival.drops.append(NO_SEGMENTS)
        if outcome.pair is not None:
            (heat, _), segments = outcome.pair
            arrival.frames += self._leaving(heat.message.header.stamp_ns, segments)

    def _leaving(self, stamp_ns: int, segments: Received[Segments] | None) -> list[Ready | Skipped]:
        """A frame that waits no more, and those that were skipped behind it."""
        heat, pose = self._waiting.pop(stamp_ns)
        return [Ready(heat, pose, segments), *self._behind.pop(stamp_ns, ())]


def inputs_of(link: LinkSettings) -> LiveInputs | LosslessInputs:
    """The inputs for a delivery."""
    return LosslessInputs(link.in_flight) if link.delivery == "lossless" else LiveInputs()


def _count(waiting: Outcome[Received[Heat], Received[Pose]]) -> int:
    return len(waiting.without_left) + len(waiting.without_right)


def _skipped(outcome: Outcome[Received[Heat], Received[Pose]]) -> list[Skipped]:
    skipped = [Skipped(stamp, NO_HEAT) for stamp in outcome.without_left]
    skipped += [Skipped(stamp, NO_POSE) for stamp in outcome.without_right]
    return sorted(skipped, key=lambda frame: frame.stamp_ns)
