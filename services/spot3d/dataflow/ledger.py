"""The account of a stream's frames: each is fused or skipped exactly once, up to the stream's end."""

from collections import Counter
from collections.abc import Mapping

from spot3d_schemas.limits import MAX_COUNT

NEVER_ARRIVED, IN_RESTART = "never arrived", "lost in a restart"
"""Why frames of a stream that has ended are missing: where fusion was started again, they went with the one before."""


class Ledger:
    """Counts of frames, and whether the stream is complete. Times are monotonic seconds.

    The stream is complete once its source has announced its end and the last frame is accounted for, or
    nothing has come for `patience_s`: what is missing then never arrived. What belongs to frames that are accounted for
    may be waited for as long. in_stream: frames of the stream so far.
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
        """The frame of this stamp is in the map."""
        self.fused += 1
        self._account(stamp_ns, now_s)

    def skip(self, reason: str, stamp_ns: int, now_s: float) -> None:
        """The frame of this stamp will not be in the map."""
        self.skipped[reason] += 1
        self._account(stamp_ns, now_s)

    def end(self, frames_sent: int, stamp_ns: int, now_s: float) -> bool:
        """The source has announced its end; returns whether this end is complete already."""
        if self._end != (frames_sent, stamp_ns):
            self._end, self._touched_s, self.complete = (frames_sent, stamp_ns), now_s, False
        return self.complete

    def extend_patience(self, now_s: float) -> None:
        """Something has come that is no frame: patience begins anew."""
        self._touched_s = now_s

    def due(self, now_s: float, more: bool = False) -> bool:
        """Whether the announced end has been reached and is to be closed; more: something else is still to come."""
        if self._end is None or self.complete:
            return False
        frames_sent, stamp_ns = self._end
        reached = frames_sent == 0 or (self.in_stream > 0 and self.last_stamp_ns >= stamp_ns)
        return (reached and not more) or now_s - self._touched_s >= self._patience_s

    def go_on(self, fused: int, skipped: Mapping[str, int], last_stamp_ns: int, in_stream: int) -> None:
        """Go on from the account of an earlier process."""
        self.fused, self.skipped = fused, Counter(skipped)
        self.last_stamp_ns, self.in_stream, self.missing = last_stamp_ns, in_stream, IN_RESTART

    def close(self) -> int:
        """The stream is complete; returns how many of its frames are `missing`."""
        frames_sent, stamp_ns = self._end or (0, 0)
        missing = max(0, frames_sent - self.in_stream)
        if missing:
            # A source may say any number, again and again; a message cannot.
            self.skipped[self.missing] = min(self.skipped[self.missing] + missing, MAX_COUNT)
        self.last_stamp_ns = max(self.last_stamp_ns, stamp_ns)
        self.complete, self.in_stream = True, 0
        return missing

    def reset(self) -> None:
        """Counts start anew; the stream goes on."""
        self.fused = 0
        self.skipped.clear()

    def _account(self, stamp_ns: int, now_s: float) -> None:
        if self.complete:
            self.complete, self._end = False, None
        self.in_stream += 1
        self.last_stamp_ns = stamp_ns
        self._touched_s = now_s
