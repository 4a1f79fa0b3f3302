"""The bridge's process: keeps a crossing to the other side, and makes another one when it falls silent."""

import logging
import threading
import time

import zenoh

from spot3d.bridge.crossing import Crossing
from spot3d.bridge.probe import reachable
from spot3d.bridge.settings import BridgeSettings
from spot3d.dataflow.counters import Counters
from spot3d.dataflow.endpoints import declare_publisher
from spot3d.dataflow.process_use import process_use
from spot3d.dataflow.rate_limited_log import RateLimitedLog
from spot3d.dataflow.session import first_line, open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import stop_on_signals
from spot3d.dataflow.tls import uses_tls, why_refused
from spot3d_schemas import BRIDGE, Header, alive_key, encode

_TICK_S = 0.05
_ASKED_S = 0.3
"""The other side is probed for this long before the old connections are looked at again."""

_MUTE = "connected, but the other side does not answer"
_ROLE = "; check that this side's certificate has a role there ([access])"

log = logging.getLogger("spot3d.bridge")


def run(link: LinkSettings, settings: BridgeSettings, stop: threading.Event | None = None) -> None:
    """Join the router at `link.connect` with that at `settings.ground`, until stopped by `stop`, SIGINT or SIGTERM.

    The robot's own router knows nothing of the link, and its stages go on as if there were none.
    """
    with stop_on_signals(stop) as stopped, open_session(link, stopped) as local:
        _Bridge(local, link, settings).serve(stopped)


class _Bridge:
    def __init__(self, local: zenoh.Session, link: LinkSettings, settings: BridgeSettings) -> None:
        self._local, self._link, self._settings = local, link, settings
        self._started_s = time.monotonic()
        self._counters = Counters(BRIDGE, self._started_s)
        self._health = declare_publisher(local, f"{BRIDGE}/health", link)
        self._healths, self._due_s = 0, self._started_s
        self._limited_log = RateLimitedLog(log)
        self._crossing: Crossing | None = None
        self._lost_s: float | None = self._started_s
        self._why = "not connected yet"

    def serve(self, stop: threading.Event) -> None:
        """Keep the two sides joined."""
        with self._local.liveliness().declare_token(alive_key(self._link.robot, BRIDGE)):
            while not stop.wait(_TICK_S):
                if self._crossing is not None:
                    self._crossing.tick()
                if self._crossing is None or self._crossing.silent_s() > self._settings.silence_s:
                    self._note_silence()
                    self._connect()
                elif self._crossing.answered:
                    self._note_echo()
                self._report()
        if self._crossing is not None:
            self._crossing.close()

    def _connect(self) -> None:
        """Try to connect once. The old connections stay meanwhile: they may recover by themselves."""
        crossing = Crossing(self._local, self._link, self._settings, self._counters)
        try:
            if not reachable(self._settings.ground, _ASKED_S):
                raise TimeoutError("no answer")
            crossing.__enter__()
        except (zenoh.ZError, OSError) as error:
            self._why = self._reason(error)
            self._limited_log.say("no way", self._state(), time.monotonic())
            return
        self._why = _MUTE + _ROLE if any(map(uses_tls, self._settings.ground)) else _MUTE
        old, self._crossing = self._crossing, crossing
        if old is not None:
            # It may hang on a dead connection, for which nobody should wait.
            threading.Thread(target=old.close, name="closing", daemon=True).start()

    def _reason(self, error: Exception) -> str:
        """Why the other side could not be connected to; its own words if it answers and refuses."""
        if isinstance(error, OSError):
            return error.strerror or str(error)
        way = self._link.model_copy(update={"connect": self._settings.ground})
        return why_refused(way) or first_line(error)

    def _state(self) -> str:
        """What is wrong now, for people; empty while the other side is there."""
        if self._lost_s is None:
            return ""
        where, lost_s = ", ".join(self._settings.ground), time.monotonic() - self._lost_s
        return f"no messages to {where} for {lost_s:.0f} s: {self._why}"

    def _note_silence(self) -> None:
        if self._lost_s is None:
            self._lost_s = time.monotonic()
            self._why = "no answer"
            self._counters.event("link lost")
            log.warning("the other side does not answer: trying new connections beside the old ones")

    def _note_echo(self) -> None:
        if self._lost_s is not None:
            log.info("the other side answers again, after %.1f s", time.monotonic() - self._lost_s)
            self._lost_s = None

    def _report(self) -> None:
        now_s = time.monotonic()
        if now_s < self._due_s:
            return
        self._due_s = now_s + self._link.health_interval_s
        header = Header(robot=self._link.robot, seq=self._healths, stamp_ns=time.time_ns(), frame_id=BRIDGE)
        self._healths += 1
        self._health.put(encode(self._counters.health(header, now_s, process_use(), self._state())))
