"""The account of a stream's frames: each is fused or skipped exactly once, up to the stream's end."""

from collections import Counter
from collections.abc import Mapping

from spot3d_schemas.limits import MAX_COUNT

NEVER_ARRIVED, IN_RESTART = "never arrived", "lost in a restart"
"""Why frames of an ended stream are missing. If fusion was restarted, they were lost with the process before."""


class Ledger:
    """Counts of frames, and whether the stream is complete. Times are monotonic seconds.

    The stream is complete once its source has announced its end and the last frame is accounted for, or nothing has
    come for `patience_s`; missing frames then never arrived. Other data of frames that are accounted for may be waited
    for just as long. in_stream: frames of the stream so far.
    """

    def __init__(self, patience_s: float) -> None:
        self.fused = 0
        self.skipped: Counter[str] = Counter()
        self.last_stamp_ns = 0
        self.complete = False
        self.missing = NEVER_ARRIVED
        self._patience_s = patience_s
        self.in_stream = 0
        self._touched_s = 0.0
        self._end: tuple[int, int] | None = None

    def fuse(self, stamp_ns: int, now_s: float) -> None:
        """Count a frame that is in the map."""
        self.fused += 1
        self._account(stamp_ns, now_s)

    def skip(self, reason: str, stamp_ns: int, now_s: float) -> None:
        """Count a frame that will not be in the map."""
        self.skipped[reason] += 1
        self._account(stamp_ns, now_s)

    def end(self, frames_sent: int, stamp_ns: int, now_s: float) -> bool:
        """Note the end that the source announces; returns whether this end is complete already.

        Of one end a source that was started again may announce another number of frames.
        """
        if self._end is None or self._end[1] != stamp_ns:
            self._touched_s, self.complete = now_s, False
        if not self.complete:
            self._end = (frames_sent, stamp_ns)
        return self.complete

    def extend_patience(self, now_s: float) -> None:
        """Restart the patience, as something that is no frame has come."""
        self._touched_s = now_s

    def due(self, now_s: float, more: bool = False) -> bool:
        """Whether to close the stream: its end is reached or patience is over. more: other data is still to come."""
        if self._end is None or self.complete:
            return False
        frames_sent, stamp_ns = self._end
        reached = frames_sent == 0 or (self.in_stream > 0 and self.last_stamp_ns >= stamp_ns)
        return (reached and not more) or now_s - self._touched_s >= self._patience_s

    def go_on(self, fused: int, skipped: Mapping[str, int], last_stamp_ns: int, in_stream: int) -> None:
        """Continue the account of an earlier process."""
        self.fused, self.skipped = fused, Counter(skipped)
        self.last_stamp_ns, self.in_stream, self.missing = last_stamp_ns, in_stream, IN_RESTART

    def close(self) -> int:
        """Mark the stream as complete; returns how many of its frames are missing."""
        frames_sent, stamp_ns = self._end or (0, 0)
        missing = max(0, frames_sent - self.in_stream)
        if missing:
            # A source may announce any number repeatedly; a message cannot state it.
            self.skipped[self.missing] = min(self.skipped[self.missing] + missing, MAX_COUNT)
        self.last_stamp_ns = max(self.last_stamp_ns, stamp_ns)
        self.complete, self.in_stream = True, 0
        return missing

    def reset(self) -> None:
        """Restart the counts; the stream goes on."""
        self.fused = 0
        self.skipped.clear()

    def _account(self, stamp_ns: int, now_s: float) -> None:
        if self.complete:
            self.complete, self._end = False, None
        self.in_stream += 1
        self.last_stamp_ns = stamp_ns
        self._touched_s = now_s
