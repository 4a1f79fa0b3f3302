"""The source's credit in a lossless run: how many frames may be in flight."""


class Credit:
    """The frames sent but not yet accounted for by fusion's progress; the sender limits them to `in_flight`."""

    def __init__(self, in_flight: int) -> None:
        self.in_flight = in_flight
        self._outstanding: list[int] = []

    @property
    def outstanding(self) -> int:
        """Number of frames in flight."""
        return len(self._outstanding)

    def sent(self, stamp_ns: int) -> None:
        """Record a sent frame."""
        self._outstanding.append(stamp_ns)

    def answered(self, last_stamp_ns: int) -> None:
        """Release every frame up to this stamp."""
        self._outstanding = [stamp for stamp in self._outstanding if stamp > last_stamp_ns]

    def give_up(self) -> list[int]:
        """Release the frames in flight, because nobody answers; returns their stamps."""
        lost, self._outstanding = self._outstanding, []
        return lost
