"""Whether a stream's messages come in the order of their capture."""

from dataclasses import dataclass

from spot3d_schemas import Header

RESTART_NS = 1_000_000_000
"""A stamp this far back is no straggler: another recording begins. One this far ahead, beyond twice the time that has
passed and the step before, is in doubt: were it believed, what follows it would be as far back."""
_CONFIRMED_NS = 10_000_000_000
"""The next stamp follows a doubtful one, no further ahead than this: then both are right."""

DUPLICATE, OUT_OF_ORDER, STRAY = "duplicate stamp", "out of order", "stray stamp"


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is to be said of one message.

    refused: why it must not be used, or empty. restarted: its stamps went back, and another recording begins with it
    that no new stream was announced.
    """

    refused: str = ""
    missing: int = 0
    restarted: bool = False


@dataclass(frozen=True, slots=True)
class _Seen:
    """step_ns: how much later its stamp is than the one before."""

    header: Header
    at_s: float
    step_ns: int


class StreamOrder:
    """Watches one input's streams, stamps and sequence numbers.

    confirm: for a live input. A stamp that leaps is refused alone, unless the next message follows it: a camera's clock
    that slips once costs one frame, as does a recording's first step where it is sparse and played fast. Other
    recordings have no such clock, and may have gaps.
    """

    def __init__(self, confirm: bool = False) -> None:
        self._confirm = confirm
        self._last: _Seen | None = None
        self._suspect: Header | None = None

    def check(self, header: Header, now_s: float) -> Verdict:
        """Judge the message that has just come, at `now_s` monotonic seconds.

        missing: messages that the sender counted and that never came (a sender that was started again counts from 0).
        """
        last, suspect = self._last, self._suspect
        if last is None or header.stream != last.header.stream:
            return self._accept(header, now_s, 0)
        ahead_ns = header.stamp_ns - last.header.stamp_ns
        if -RESTART_NS < ahead_ns <= 0:
            return Verdict(OUT_OF_ORDER if ahead_ns else DUPLICATE)
        back = ahead_ns < 0
        leaps = self._confirm and ahead_ns - last.step_ns - 2e9 * (now_s - last.at_s) > RESTART_NS
        if not (back or leaps):
            return self._accept(header, now_s, ahead_ns)
        if not self._confirm:
            # A stream that has a name ends before its stamps go back.
            return Verdict(OUT_OF_ORDER) if header.stream is not None else self._accept(header, now_s, 0, True)
        step_ns = 0 if suspect is None else header.stamp_ns - suspect.stamp_ns
        if 0 < step_ns < _CONFIRMED_NS:
            return self._accept(header, now_s, step_ns, restarted=back)
        self._suspect = header
        return Verdict(STRAY)

    def _accept(self, header: Header, now_s: float, step_ns: int, restarted: bool = False) -> Verdict:
        last, self._last, self._suspect = self._last, _Seen(header, now_s, step_ns), None
        if last is None or header.sender != last.header.sender:
            return Verdict(restarted=restarted)
        return Verdict(missing=max(0, header.seq - last.header.seq - 1), restarted=restarted)
