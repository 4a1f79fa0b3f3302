"""Checks that a stream's messages come in order of capture."""

from dataclasses import dataclass, replace

from spot3d_schemas import Header

RESTART_NS = 1_000_000_000
"""A stamp this far back is no late message: another recording begins. A stamp this far ahead, beyond twice the elapsed
time and the previous step, is in doubt: were it accepted, the next one would be as far back."""
_CONFIRMED_NS = 10_000_000_000
"""If the next stamp follows a doubtful one by less than this, both are right. So they are in a sparse recording, if it
follows by less than twice the step to the doubtful one or, where that goes back, the step before."""

DUPLICATE, OUT_OF_ORDER, STRAY = "duplicate stamp", "out of order", "stray stamp"


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict on one message.

    refused: why it must not be used, or empty. restarted: its stamp went back, and another recording begins with it
    that no new stream has announced.
    """

    refused: str = ""
    missing: int = 0
    restarted: bool = False


@dataclass(frozen=True, slots=True)
class _Seen:
    """step_ns: its stamp minus that of the message before."""

    header: Header
    at_s: float
    step_ns: int


class StreamOrder:
    """Checks one input's streams, stamps and sequence numbers. A message without a stream goes on with the last one.

    confirm: for a live input. A stamp that leaps is refused, unless the next message follows it: a camera's clock that
    slips once costs one frame, as does the first step of a sparse recording that is played fast. Recordings that are
    not live have no such clock, and may have gaps.
    """

    def __init__(self, confirm: bool = False) -> None:
        self._confirm = confirm
        self._last: _Seen | None = None
        self._suspect: Header | None = None
        self._numbered: Header | None = None

    def check(self, header: Header, now_s: float) -> Verdict:
        """Judge the message that has just arrived, at `now_s` monotonic seconds.

        missing: messages that the sender numbered and that never arrived (a restarted sender counts from 0).
        """
        verdict, before = self._judge(header, now_s), self._numbered
        if before is None or header.sender != before.sender:
            self._numbered = header
            return verdict
        if header.seq > before.seq or not verdict.refused:
            self._numbered = header
        return replace(verdict, missing=max(0, header.seq - before.seq - 1))

    def _judge(self, header: Header, now_s: float) -> Verdict:
        """The verdict but for missing messages."""
        last, suspect = self._last, self._suspect
        if last is None or header.stream not in (None, last.header.stream):
            return self._accept(header, now_s, 0)
        ahead_ns = header.stamp_ns - last.header.stamp_ns
        if -RESTART_NS < ahead_ns <= 0:
            return Verdict(OUT_OF_ORDER if ahead_ns else DUPLICATE)
        back = ahead_ns < 0
        leaps = self._confirm and ahead_ns - last.step_ns - 2e9 * (now_s - last.at_s) > RESTART_NS
        if not (back or leaps):
            return self._accept(header, now_s, ahead_ns)
        if not self._confirm:
            # A named stream ends before its stamps go back.
            return Verdict(OUT_OF_ORDER) if header.stream is not None else self._accept(header, now_s, 0, True)
        if suspect is not None:
            step_ns = header.stamp_ns - suspect.stamp_ns
            usual_ns = max(last.step_ns, suspect.stamp_ns - last.header.stamp_ns)
            if 0 < step_ns < max(_CONFIRMED_NS, 2 * usual_ns):
                return self._accept(header, now_s, step_ns, restarted=back)
        self._suspect = header
        return Verdict(STRAY)

    def _accept(self, header: Header, now_s: float, step_ns: int, restarted: bool = False) -> Verdict:
        self._last, self._suspect = _Seen(header, now_s, step_ns), None
        return Verdict(restarted=restarted)
