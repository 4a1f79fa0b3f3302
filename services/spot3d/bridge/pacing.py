"""Decides when the next image may go over a thin link, so that images never wait on the way.

The rate follows the delay, as in TCP Vegas (Brakmo and Peterson 1995) and LEDBAT (RFC 6817): images queued in buffers
take longer than one that travels alone. The rate does not depend on losses that TCP repairs.
"""

from collections import deque
from statistics import median

_HIGH_S, _LOW_S = 0.04, 0.02
"""Queueing delays above which images are sent less often, and below which more often, seconds.

Less would be within a link's jitter and one image's time on it; with more, poses behind the images would suffer.
"""
_SLOWER, _FASTER = 1.15, 0.97
"""Factors of the interval between two images: slower once per delay at most, faster with each image that arrives."""
_JUDGED = 5
"""Images whose median delay counts: one in three may be late because TCP sends a lost packet again."""
_ALONE = 5
"""Images sent alone whose median delay is that of the path itself, including TCP's repairs."""
_ALONE_EVERY_S = 10.0
"""An image is sent alone at least this often: the path may have become slower."""
_LOST_S = 2.0
"""An image of which nothing is heard for this long is no longer in flight."""
_SLOWEST_S, _FIRST_S = 0.5, 1 / 30
_OFTENER = 1.25
"""The allowed rate is at most this many times that of images: it must not have grown when they get larger."""


class Pacing:
    """Decides for each image whether it is sent, and learns from arrival times; one connection. Monotonic seconds."""

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
        """Whether to send an image that is available now; ask once for each."""
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
        # Nothing is sent behind a late image: the link may be gone.
        late = now_s - self._on_the_way[0][1] > way_s + 2 * _HIGH_S
        return not late and len(self._on_the_way) < (way_s + _HIGH_S) / self.interval_s

    def sent(self, now_s: float) -> int:
        """Record a sent image; returns its number, for `arrived`."""
        # The next image may make up for one that came late, but for no more.
        self._due_s = max(self._due_s, now_s - self.interval_s) + self.interval_s
        alone = not self._on_the_way
        if alone:
            self._alone_s = now_s
        self._number += 1
        self._on_the_way.append((self._number, now_s, alone))
        return self._number

    def arrived(self, number: int, now_s: float) -> None:
        """Record that the image of this number has arrived, and all before it."""
        while self._on_the_way and self._on_the_way[0][0] <= number:
            which, sent_s, alone = self._on_the_way.popleft()
            if which == number:
                self._learn(now_s - sent_s, alone, now_s)

    def _learn(self, delay_s: float, alone: bool, now_s: float) -> None:
        self._delays.append(delay_s)
        if alone:
            if not self._alone:
                # One at a time at first: how many the link takes is not known.
                self.interval_s = max(self.interval_s, delay_s)
            self._alone.append(delay_s)
        if not self._alone:
            return
        waiting_s = median(self._delays) - median(self._alone)
        if waiting_s > _HIGH_S and now_s - self._slowed_s > delay_s:
            self.interval_s, self._slowed_s = min(self.interval_s * _SLOWER, _SLOWEST_S), now_s
        elif waiting_s < _LOW_S:
            self.interval_s = max(self.interval_s * _FASTER, self._gap_s / _OFTENER)
