"""Whether a stream's messages come in the order of their capture."""

from dataclasses import dataclass

RESTART_NS = 1_000_000_000
"""A stamp this far back is no straggler: another recording begins."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """What is to be said of one message. refused: why it must not be used, or empty."""

    refused: str = ""
    missing: int = 0
    restarted: bool = False


class StreamOrder:
    """Watches one input's stamps and sequence numbers."""

    def __init__(self) -> None:
        self._stamp_ns: int | None = None
        self._seq = 0

    def check(self, seq: int, stamp_ns: int) -> Arrival:
        """Judge the message that has just come.

        missing: messages that the sender counted and that never came (an anew started sender counts from 0).
        """
        last, last_seq = self._stamp_ns, self._seq
        if last is not None and stamp_ns <= last and last - stamp_ns < RESTART_NS:
            return Arrival("duplicate stamp" if stamp_ns == last else "out of order")
        self._stamp_ns, self._seq = stamp_ns, seq
        if last is None:
            return Arrival()
        return Arrival(missing=max(0, seq - last_seq - 1), restarted=stamp_ns < last)
