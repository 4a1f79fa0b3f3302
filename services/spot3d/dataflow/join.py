"""Joins the messages of two topics by capture stamp, in bounded memory."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from spot3d.dataflow.node import Received
from spot3d.dataflow.order import RESTART_NS
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import Heat, Message, Pose

L = TypeVar("L", bound=Message)
R = TypeVar("R", bound=Message)

NO_HEAT, NO_POSE = "no heat", "no pose"
"""Reasons to skip a frame: its heat or its pose did not come."""

HEATS_WAITING = 16
"""Live: number of heats that may wait for their poses, which mostly come first but may come from another program, half
a second late; 30 MB at VGA."""
_POSES_WAITING = 256
_EVICTED_REMEMBERED = 1000
"""Number of evicted stamps remembered until their partner comes, so that each counts once."""


def images_waiting(live: int, link: LinkSettings) -> int:
    """Maximum number of images waiting in a join: `live`, but in a lossless run at least all that are in flight."""
    return max(live, 2 * link.in_flight) if link.delivery == "lossless" else live


@dataclass(frozen=True, slots=True, order=True)
class Skipped:
    """A frame that is not processed, and why."""

    stamp_ns: int
    reason: str


@dataclass(frozen=True, slots=True)
class Outcome(Generic[L, R]):
    """The result of adding one message.

    pair: the two messages of one stamp. skipped: frames that stay without their other side.
    """

    pair: tuple[Received[L], Received[R]] | None
    skipped: list[Skipped]


class Join(Generic[L, R]):
    """Pairs messages of equal stamp from two streams.

    Each stream's stamps ascend, so a message can be given up once the other stream has passed its stamp: every stamp
    seen on either side comes out exactly once, as a pair or as skipped.
    Stamps that jump back by RESTART_NS begin another recording. no_left, no_right: why a frame without that side is
    skipped.
    """

    def __init__(self, left_size: int, right_size: int, no_left: str, no_right: str) -> None:
        self._waiting: tuple[dict[int, Received[L]], dict[int, Received[R]]] = ({}, {})
        self._sizes = (left_size, right_size)
        self._no_left, self._no_right = no_left, no_right
        self._newest: list[int | None] = [None, None]
        self._evicted: dict[int, None] = {}

    def add_left(self, given: Received[L]) -> Outcome[L, R]:
        """Take in a message of the left stream."""
        partner, alone, others = self._add(0, given.message.header.stamp_ns, given)
        return Outcome(None if partner is None else (given, partner), self._skipped(others, alone))

    def add_right(self, given: Received[R]) -> Outcome[L, R]:
        """Take in a message of the right stream."""
        partner, alone, others = self._add(1, given.message.header.stamp_ns, given)
        return Outcome(None if partner is None else (partner, given), self._skipped(alone, others))

    def clear(self) -> list[Skipped]:
        """Forget all waiting messages, as another stream begins; returns them as skipped frames."""
        left, right = self._waiting
        skipped = self._skipped(right, left)
        left.clear()
        right.clear()
        self._evicted.clear()
        self._newest = [None, None]
        return skipped

    def _skipped(self, without_left: Iterable[int], without_right: Iterable[int]) -> list[Skipped]:
        skipped = [Skipped(stamp, self._no_left) for stamp in without_left]
        return skipped + [Skipped(stamp, self._no_right) for stamp in without_right]

    def _add(self, side: int, stamp_ns: int, item: Any) -> tuple[Any | None, list[int], list[int]]:
        """Take in an item; returns its partner, and the stamps that stay without one on this side and on the other."""
        own: dict[int, Any] = self._waiting[side]
        other: dict[int, Any] = self._waiting[1 - side]
        alone, others = self._advance(side, stamp_ns, own, other)
        if stamp_ns in other:
            return other.pop(stamp_ns), alone, others
        if stamp_ns in self._evicted:
            del self._evicted[stamp_ns]
        elif self._passed(1 - side, stamp_ns):
            alone.append(stamp_ns)
        else:
            own[stamp_ns] = item
            alone += self._evict(own, self._sizes[side])
        return None, alone, others

    def _passed(self, side: int, stamp_ns: int) -> bool:
        newest = self._newest[side]
        return newest is not None and newest > stamp_ns

    def _advance(
        self, side: int, stamp_ns: int, own: dict[int, Any], other: dict[int, Any]
    ) -> tuple[list[int], list[int]]:
        """Record that `side` has reached this stamp; returns the stamps given up on this side and on the other."""
        gone_own: list[int] = []
        gone_other = [stamp for stamp in other if stamp < stamp_ns]
        newest = self._newest[side]
        if newest is not None and stamp_ns < newest:
            self._evicted.clear()
            gone_own = list(own)
            gone_other = [stamp for stamp in other if abs(stamp - stamp_ns) >= RESTART_NS]
            reached = self._newest[1 - side]
            if reached is not None and reached - stamp_ns >= RESTART_NS:
                # The other stream is still in the old recording and has not passed anything of the new one.
                self._newest[1 - side] = None
        self._newest[side] = stamp_ns
        for stamp in gone_own:
            del own[stamp]
        for stamp in gone_other:
            del other[stamp]
        return gone_own, gone_other

    def _evict(self, waiting: dict[int, Any], size: int) -> list[int]:
        """Drop the oldest beyond `size`; returns their stamps."""
        oldest = list(waiting)[: max(0, len(waiting) - size)]
        for stamp in oldest:
            del waiting[stamp]
            self._evicted[stamp] = None
        for stamp in list(self._evicted)[:-_EVICTED_REMEMBERED]:
            del self._evicted[stamp]
        return oldest


def heat_pose_join(link: LinkSettings) -> Join[Heat, Pose]:
    """The join of each frame's heat with its pose."""
    return Join(images_waiting(HEATS_WAITING, link), _POSES_WAITING, NO_HEAT, NO_POSE)
