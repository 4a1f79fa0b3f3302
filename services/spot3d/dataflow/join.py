"""Joins two streams by capture stamp, in bounded memory."""

from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from spot3d.dataflow.order import RESTART_NS

L = TypeVar("L")
R = TypeVar("R")

_EVICTED_REMEMBERED = 1000
"""Evicted stamps that are remembered until their partner comes, so that they count once."""


@dataclass(frozen=True, slots=True)
class Outcome(Generic[L, R]):
    """What one new item led to.

    pair: the two items of one stamp. without_left, without_right: stamps whose items stay without that side.
    """

    pair: tuple[L, R] | None = None
    without_left: list[int] = field(default_factory=list)
    without_right: list[int] = field(default_factory=list)


class Join(Generic[L, R]):
    """Pairs items of equal stamp.

    Each stream's stamps ascend, so that an item whose partner's stream has passed it can go at once: every
    stamp that was seen on either side comes out exactly once, as a pair or as one without its partner.
    Stamps that jump back by RESTART_NS begin another recording.
    """

    def __init__(self, left_size: int, right_size: int) -> None:
        self._left: dict[int, L] = {}
        self._right: dict[int, R] = {}
        self._sizes = (left_size, right_size)
        self._newest: list[int | None] = [None, None]
        self._evicted: dict[int, None] = {}

    def add_left(self, stamp_ns: int, item: L) -> Outcome[L, R]:
        """Take in an item of the left stream."""
        without_right, without_left = self._advance(0, stamp_ns, self._left, self._right)
        if stamp_ns in self._right:
            return Outcome((item, self._right.pop(stamp_ns)), without_left, without_right)
        if stamp_ns in self._evicted:
            del self._evicted[stamp_ns]
        elif self._passed(1, stamp_ns):
            without_right.append(stamp_ns)
        else:
            self._left[stamp_ns] = item
            without_right += self._evict(self._left, self._sizes[0])
        return Outcome(None, without_left, without_right)

    def add_right(self, stamp_ns: int, item: R) -> Outcome[L, R]:
        """Take in an item of the right stream."""
        without_left, without_right = self._advance(1, stamp_ns, self._right, self._left)
        if stamp_ns in self._left:
            return Outcome((self._left.pop(stamp_ns), item), without_left, without_right)
        if stamp_ns in self._evicted:
            del self._evicted[stamp_ns]
        elif self._passed(0, stamp_ns):
            without_left.append(stamp_ns)
        else:
            self._right[stamp_ns] = item
            without_left += self._evict(self._right, self._sizes[1])
        return Outcome(None, without_left, without_right)

    def clear(self) -> Outcome[L, R]:
        """Forget what waits: another stream begins. Returns it as what stays without its other side."""
        outcome: Outcome[L, R] = Outcome(None, list(self._right), list(self._left))
        self._left.clear()
        self._right.clear()
        self._evicted.clear()
        self._newest = [None, None]
        return outcome

    def _passed(self, side: int, stamp_ns: int) -> bool:
        newest = self._newest[side]
        return newest is not None and newest > stamp_ns

    def _advance(
        self, side: int, stamp_ns: int, own: dict[int, Any], other: dict[int, Any]
    ) -> tuple[list[int], list[int]]:
        """Note that `side` has come to this stamp; returns the stamps that go: own, other's."""
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
