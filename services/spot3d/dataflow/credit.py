"""The source's credit in a lossless run: how many frames may be on their way."""


class Credit:
    """Which frames are sent and not yet accounted for by fusion's progress; who sends holds them to `in_flight`."""

    def __init__(self, in_flight: int) -> None:
        self.in_flight = in_flight
        self.lost = 0
        self._outstanding: list[int] = []

    @property
    def outstanding(self) -> int:
        """Frames on their way."""
        return len(self._outstanding)

    def sent(self, stamp_ns: int) -> None:
        """A frame is on its way."""
        self._outstanding.append(stamp_ns)

    def answered(self, last_stamp_ns: int) -> int:
        """Every frame up to this stamp is accounted for; returns how many of them were on their way."""
        waiting = [stamp for stamp in self._outstanding if stamp > last_stamp_ns]
        answered = len(self._outstanding) - len(waiting)
        self._outstanding = waiting
        return answered

    def give_up(self) -> list[int]:
        """Nobody answers: count the frames on their way as lost; returns their stamps."""
        lost, self._outstanding = self._outstanding, []
        self.lost += len(lost)
        return lost
