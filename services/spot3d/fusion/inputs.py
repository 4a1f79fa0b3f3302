"""Which frames may be fused now: joins heat, pose and segments of one stamp, which arrive separately."""

from dataclasses import dataclass, field

from spot3d.dataflow.join import Join, Outcome, Skipped, heat_pose_join
from spot3d.dataflow.node import Received
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import Heat, Pose, Segments

NO_SEGMENTS, WITHOUT_FRAME = "no segments", "segments without their frame"
"""What else may be missing. Lossless: a frame's segments. Live: the frame of segments, which was skipped, or fused too
long ago."""

_ANSWERS_WAITING = 256
"""Lossless: most answers of the segments stage that wait for heat and pose."""
_EARLY = 16
"""Live: most keyframes' segments that wait for their frame to be fused; 0.1 MB each."""


@dataclass(frozen=True, slots=True)
class Ready:
    """A frame to be fused, with its segments if they are there; the stamp is that of `heat`."""

    heat: Received[Heat]
    pose: Received[Pose]
    segments: Received[Segments] | None


@dataclass(slots=True)
class Arrival:
    """The result of one message.

    frames: to be fused or skipped, in order, with none outstanding before them. late: segments of a frame fused before.
    drops: the reason for each other missing input.
    """

    frames: list[Ready | Skipped] = field(default_factory=list)
    late: Received[Segments] | None = None
    drops: list[str] = field(default_factory=list)


class LiveInputs:
    """Live: a frame is ready when heat and pose are there; segments may arrive at any time.

    alone: frames that were ready since the last message of the segments stage.
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
        """Take in a frame's segments; those of a frame that is no keyframe are discarded."""
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
        """Whether the segments stage has not reached the last frame yet: it may be busy with keyframes before it."""
        return self._last_ns is not None and (self._answered_ns is None or self._answered_ns < self._last_ns)

    def rest(self) -> list[Ready | Skipped]:
        """The frames that still wait for heat or pose when the stream has ended."""
        return [*sorted(self._pairs.clear())]

    def clear(self) -> int:
        """Discard what waits, as another stream begins; returns the number of frames."""
        self._early.clear()
        self._last_ns = self._answered_ns = None
        self.alone = 0
        return len(self.rest())

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
    """Lossless: a frame is ready when heat, pose and the segments stage's answer are there.

    A skipped frame waits for those before it: all frames up to the last reported one are accounted for.
    alone, unanswered: constant, as no ready frame lacks an answer.
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
        """Take in the answer of the segments stage to a frame."""
        arrival = Arrival()
        self._answered(arrival, self._answers.add_right(given))
        return arrival

    def rest(self) -> list[Ready | Skipped]:
        """Frames that still wait when the stream has ended: those without segments, with those skipped behind them, and
        those without heat or pose.
        """
        frames: list[Ready | Skipped] = []
        for stamp in list(self._waiting):
            frames += self._leaving(stamp, None)
        self._answers.clear()
        return frames + sorted(self._pairs.clear())

    def clear(self) -> int:
        """Discard what waits, as another stream begins; returns the number of frames."""
        return len(self.rest())

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
        """Release the answered frame, after those that will get no answer, which are older."""
        for frame in outcome.skipped:
            if frame.reason == NO_SEGMENTS:
                arrival.frames += self._leaving(frame.stamp_ns, None)
                arrival.drops.append(NO_SEGMENTS)
        if outcome.pair is not None:
            heat, segments = outcome.pair
            arrival.frames += self._leaving(heat.message.header.stamp_ns, segments)

    def _leaving(self, stamp_ns: int, segments: Received[Segments] | None) -> list[Ready | Skipped]:
        """Release a waiting frame, and those that were skipped behind it."""
        heat, pose = self._waiting.pop(stamp_ns)
        return [Ready(heat, pose, segments), *self._behind.pop(stamp_ns, ())]


def inputs_of(link: LinkSettings) -> LiveInputs | LosslessInputs:
    """The inputs for the link's delivery."""
    return LosslessInputs(link) if link.delivery == "lossless" else LiveInputs(link)
