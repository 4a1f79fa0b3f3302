"""Publishes a recording again at its own pace."""

import logging
import threading
import time
import uuid
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass

import zenoh

from spot3d.dataflow.alive import stages_by_robot
from spot3d.dataflow.endpoints import declare_publisher
from spot3d.dataflow.pace import Pace
from spot3d.dataflow.rate_limited_log import RateLimitedLog
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import stop_on_signals
from spot3d.recorder.keyboard import on_key
from spot3d.recorder.mcap_contents import McapContents
from spot3d.recorder.relabel import Labels
from spot3d_schemas import STAGES, TOPICS, End, Header, alive_key, encode, peek_header, process_key

log = logging.getLogger("spot3d.play")

_FRAME, _END = "source/frame", "source/end"
_TOKEN_S = 5.0
"""Longest wait for the liveliness query."""


class StageAliveError(RuntimeError):
    """A stage whose topics are to be played is alive: both would publish."""


@dataclass(frozen=True, slots=True)
class Playing:
    """What to play, and how. rate: times as fast; start_s, end_s: seconds from the recording's beginning."""

    topics: tuple[str, ...]
    rate: float = 1.0
    loop: bool = False
    start_s: float = 0.0
    end_s: float | None = None


def play(contents: McapContents, playing: Playing, link: LinkSettings, stop: threading.Event | None = None) -> int:
    """Publish a recording's messages under the robot of `link`, once or in a loop. Returns how many were sent.

    The space bar pauses and resumes. Damaged parts of the file are skipped and logged. Raises StageAliveError.
    """
    with stop_on_signals(stop) as stopped, ExitStack() as stack:
        session = stack.enter_context(open_session(link, stopped))
        player = _Player(contents, playing, link, session, stack)
        stack.enter_context(on_key(lambda pressed: player.pace.toggle() if pressed == " " else None))
        player.run(stopped)
        return player.sent.total()
    return 0  # stopped before a router was found


class _Player:
    def __init__(
        self, contents: McapContents, playing: Playing, link: LinkSettings, session: zenoh.Session, stack: ExitStack
    ) -> None:
        limited_log = RateLimitedLog(log)
        self.pace = Pace(playing.rate, lambda kind, text: limited_log.say(kind, text, time.monotonic()))
        self.sent: Counter[str] = Counter()
        self._contents, self._playing, self._link = contents, playing, link
        # Topics of a later version of spot3d, for example.
        if unknown := [topic for topic in playing.topics if topic not in TOPICS]:
            log.warning("%s is left out: this version of spot3d does not know the topic", ", ".join(unknown))
        known = tuple(topic for topic in playing.topics if topic in TOPICS)
        self._topic_of = {number: topic for topic, number in contents.topics.items() if topic in known}
        # Without the bridge: replayed messages cross no link.
        stages = {TOPICS[topic].producer for topic in known} & set(STAGES)
        _refuse_alive(session, link.robot, stages)
        # An end follows the frames even if none was recorded.
        topics = {*known, _END} if _FRAME in known else known
        self._publishers = {topic: declare_publisher(session, topic, link) for topic in topics}
        for publisher in self._publishers.values():
            stack.callback(publisher.undeclare)
        self._sender = uuid.uuid4().hex[:12]
        for stage in sorted(stages):
            # Dashboards, sources and stages detect each other by these tokens.
            for token in (alive_key(link.robot, stage), process_key(link.robot, stage, self._sender)):
                stack.enter_context(session.liveliness().declare_token(token))

    def run(self, stop: threading.Event) -> None:
        """Play once, or in a loop."""
        self._once(stop)
        while self._playing.loop and self.sent and not stop.is_set():
            self._once(stop)

    def _once(self, stop: threading.Event) -> None:
        playing, start_ns = self._playing, self._contents.start_ns
        first_ns = start_ns + round(1e9 * playing.start_s)
        last_ns = self._contents.end_ns if playing.end_s is None else start_ns + round(1e9 * playing.end_s)
        self.pace.restart()
        frames, last_frame, labels = 0, b"", Labels(self._link.robot, self._sender)
        for message in self._contents.between(first_ns, last_ns, log.warning):
            topic = self._topic_of.get(message.channel_id)
            # The recorded end counts frames that may not all be played.
            if topic is None or topic == _END:
                continue
            if not self.pace.wait(1e-9 * (message.log_time - first_ns), stop):
                return
            data = labels.on(message.data, time.time_ns())
            self._publishers[topic].put(data)
            self.sent[topic] += 1
            if topic == _FRAME:
                frames, last_frame = frames + 1, data
        if frames:
            # The end has the robot, stream and sender of the frames.
            header = Header(**peek_header(last_frame).model_dump(exclude={"schema_name", "version", "trace"}))
            self._publishers[_END].put(encode(End(header=header, frames_sent=frames)))
            self.sent[_END] += 1


def _refuse_alive(session: zenoh.Session, robot: str, stages: set[str]) -> None:
    alive = stages & stages_by_robot(session, _TOKEN_S, robot).get(robot, frozenset())
    if alive:
        raise StageAliveError(
            f"{', '.join(sorted(alive))} of robot {robot!r} is running; play under another name with "
            "--robot, or omit its topics with --topics"
        )
