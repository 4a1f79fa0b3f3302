"""When the next image may go over a thin link, so that images never wait on the way.

The rate follows the delay, as in TCP Vegas (Brakmo and Peterson 1995) and LEDBAT (RFC 6817): images that wait in
buffers take longer than one that travels alone. What they take does not depend on losses that TCP mends.
"""

from collections import deque
from statistics import median

_HIGH_S, _LOW_S = 0.04, 0.02
"""Images that wait for longer than the first are sent more seldom, for less than the second more often, seconds.

Below them lie a link's jitter and one image's time on it; above, poses behind the images would show it.
"""
_SLOWER, _FASTER = 1.15, 0.97
"""What the interval between two images is multiplied by: at most once in a delay, and with each image that is there."""
_JUDGED = 5
"""The median delay of so many images counts: one in three may be late because TCP sends a lost packet again."""
_ALONE = 5
"""The median delay of so many images that travelled alone is that of the way, TCP's repairs included ..."""
_ALONE_EVERY_S = 10.0
"""... and one does at least this often, for the way may have become longer."""
_LOST_S = 2.0
"""An image of which nothing was heard for so long is on the way no more."""
_SLOWEST_S, _FIRST_S = 0.5, 1 / 30
_OFTENER = 1.25
"""The rate allowed is at most so many times that at which images come: it must not have grown when they are larger."""


class Pacing:
    """Says of each image whether it goes, and learns from when images arrive; for one connection. Monotonic seconds."""

    def __init__(self) -> None:
        self._offered_s: float | None = None
        self._gap_s = _FIRST_S
        self.interval_s = _FIRST_S
        self._number = 0
        self._on_the_way: deque[tuple[int, float, bool]] = deque()
        self._delays: deque[float] = deque(maxlen=_JUDGED)
        self._alone: deque[float] = deque(maxlen=_ALONE)
        self._due_s = self._alone_s = self._slowed_s = float("-inf")

    def may_send(self, now_s: float) -> bool:
        """Whether an image that is there now goes; ask once for each."""
        if self._offered_s is not None:
            self._gap_s += 0.1 * (min(now_s - self._offered_s, _SLOWEST_S) - self._gap_s)
        self._offered_s = now_s
        if now_s < self._due_s:
            return False
        while self._on_the_way and now_s - self._on_the_way[0][1] > _LOST_S:
            self._on_the_way.popleft()
        if not self._alone or now_s - self._alone_s > _ALONE_EVERY_S:
            return not self._on_the_way
        if not self._on_the_way:
            return True
        way_s = median(self._alone)
        # Nothing more goes behind one that is late: the link may be gone.
        late = now_s - self._on_the_way[0][1] > way_s + 2 * _HIGH_S
        return not late and len(self._on_the_way) < (way_s + _HIGH_S) / self.interval_s

    def sent(self, now_s: float) -> int:
        """An image goes; returns its number, for `arrived`."""
        # An image that came late may be made good by the next one, no more.
        self._due_s = max(self._due_s, now_s - self.interval_s) + self.interval_s
        alone = not self._on_the_way
        if alone:
            self._alone_s = now_s
        self._number += 1
        self._on_the_way.append((self._number, now_s, alone))
        return self._number

    def arrived(self, number: int, now_s: float) -> None:
        """The other side has the image of this number, and all before it."""
        while self._on_the_way and self._on_the_way[0][0] <= number:
            which, sent_s, alone = self._on_the_way.popleft()
            if which == number:
                self._learn(now_s - sent_s, alone, now_s)

    def _learn(self, delay_s: float, alone: bool, now_s: float) -> None:
        self._delays.append(delay_s)
        if alone:
            if not self._alone:
                # One after the other at first: nothing is known of how many the link takes.
                self.interval_s = max(self.interval_s, delay_s)
            self._alone.append(delay_s)
        if not self._alone:
            return
        waiting_s = median(self._delays) - median(self._alone)
        if waiting_s > _HIGH_S and now_s - self._slowed_s > delay_s:
            self.interval_s, self._slowed_s = min(self.interval_s * _SLOWER, _SLOWEST_S), now_s
        elif waiting_s < _LOW_S:
            self.interval_s = max(self.interval_s * _FASTER, self._gap_s / _OFTENER)
