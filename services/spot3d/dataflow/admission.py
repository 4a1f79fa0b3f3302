"""Decides which messages of a stage's inputs are accepted: those of one producer per topic, in order of capture."""

from collections.abc import Iterable

from spot3d.dataflow.alive import Alive
from spot3d.dataflow.capture_stamps import CaptureLag, StampPace
from spot3d.dataflow.counters import Counters
from spot3d.dataflow.order import StreamOrder, Verdict
from spot3d.dataflow.producers import Producers
from spot3d.dataflow.rate_limited_log import RateLimitedLog
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import Header

PER_FRAME = frozenset(("source/frame", "pose/pose", "proposals/boxes", "heatmap/heat", "segments/segments"))
"""Topics with one message per capture, whose stamps therefore ascend."""
SECOND = "of a second producer"
_CAPTURES = "source/frame"


class Admission:
    """Judges each input's messages, and counts and logs what is refused. One thread per input; monotonic seconds."""

    def __init__(
        self, inputs: Iterable[str], link: LinkSettings, alive: Alive, counters: Counters, limited_log: RateLimitedLog
    ) -> None:
        live = link.delivery == "live"
        self._orders = {topic: StreamOrder(confirm=live) for topic in inputs if topic in PER_FRAME}
        self._paces = (StampPace(), CaptureLag()) if live else ()
        self._producers = Producers(alive)
        self._counters, self._limited_log = counters, limited_log

    def judge(self, topic: str, header: Header, now_s: float) -> Verdict:
        """The verdict on a message that has just arrived."""
        if not self._producers.admit(topic, header.sender, now_s):
            self._counters.drop(f"{topic} {SECOND}")
            text = f"{topic}: messages of a second sender (process {header.sender}) are refused; end one of the two"
            self._limited_log.say(f"{topic} {SECOND}", text, now_s)
            return Verdict(refused=SECOND)
        if topic == _CAPTURES:
            for pace in self._paces:
                pace.observe(header, now_s)
        order = self._orders.get(topic)
        if order is None:
            return Verdict()
        arrival = order.check(header, now_s)
        self._counters.drop(f"{topic} lost on the way", arrival.missing)
        if arrival.restarted:
            self._counters.event("another recording")
            text = f"{topic}: timestamps went back: a new recording begins"
            self._limited_log.say("another recording", text, now_s)
        if arrival.refused:
            self._counters.drop(f"{topic} {arrival.refused}")
        return arrival

    def stamps(self, now_s: float) -> str:
        """A warning that the stamps of a camera's frames are wrong, or that frames are sent late; else empty."""
        return next(filter(None, (pace.notice(now_s) for pace in self._paces)), "")

    def contested(self, now_s: float) -> list[str]:
        """The topics that a second producer has published recently."""
        return self._producers.contested(now_s)
