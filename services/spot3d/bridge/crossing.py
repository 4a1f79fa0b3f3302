"""One pair of connections to the other side of a thin link, and all that is forwarded by them."""

import json
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import Self

import zenoh

from spot3d.bridge.flow import Flow, Put, QueryForwarder, TokenMirror
from spot3d.bridge.pacing import Pacing
from spot3d.bridge.settings import BridgeSettings
from spot3d.dataflow.counters import Counters
from spot3d.dataflow.lingering import disable_linger
from spot3d.dataflow.session import zenoh_config
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import BRIDGE, TOPICS, Topic

_PACED = "block first"
"""Topics with this congestion control can fill a link: they have a connection of their own, and skip messages while it
is full."""

_PING_S = 0.1
_LEASE_MS = 10_000
"""The other side considers us gone after this time; we detect by ourselves when it is gone."""


class Crossing:
    """Connections to the router on the other side, and what is forwarded by them until they are closed.

    Images go by one connection, everything else by another, so that TCP makes no pose wait for an image. The echoes of
    each come back over the other: they show that both work, and how long images take. On the other side only the router
    takes part in that. Enter it to connect; raises zenoh.ZError where that fails.
    """

    def __init__(self, local: zenoh.Session, link: LinkSettings, settings: BridgeSettings, counters: Counters) -> None:
        self._local, self._link, self._settings, self._counters = local, link, settings, counters
        self._pacing = Pacing()
        self._sending, self._learning = threading.Lock(), threading.Lock()
        self._exit = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._prompt, self._bulk = self._open_both(stack)
            self._begun_s = time.monotonic()
            self._heard_s = dict.fromkeys(("prompt", "bulk"), self._begun_s)
            self._asked_s = float("-inf")
            self._declare_echoes()
            self._flows = self._declare_flows(stack)
            self._exit = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop forwarding, then close the connections, which may take seconds if the link is gone."""
        self._exit.close()

    @property
    def answered(self) -> bool:
        """Whether an echo has come back over both connections."""
        return min(self._heard_s.values()) > self._begun_s

    def silent_s(self) -> float:
        """Seconds since the last echo, halved for the images' connection, where it may take twice as long."""
        now_s = time.monotonic()
        return max(now_s - self._heard_s["prompt"], (now_s - self._heard_s["bulk"]) / 2)

    def tick(self) -> None:
        """Ask for an echo of either connection, and update what is forwarded; call it some twenty times a second."""
        if (now_s := time.monotonic()) - self._asked_s > _PING_S:
            self._asked_s = now_s
            for ping in self._pings:
                ping.put(b"")
        for flow in self._flows:
            flow.follow()

    def _open_both(self, stack: ExitStack) -> list[zenoh.Session]:
        way = {"mode": "client", "connect": self._settings.ground, "listen": (), "shared_memory": False}
        config = zenoh_config(self._link.model_copy(update=way))
        config.insert_json5("connect/timeout_ms", json.dumps(round(1000 * self._settings.attempt_s)))
        # A router on the other side that closes a connection to us while the link is gone may stall after that.
        config.insert_json5("transport/link/tx/lease", str(_LEASE_MS))
        with ThreadPoolExecutor(2) as pool:
            tries = [pool.submit(zenoh.open, config) for _ in range(2)]
        for one in tries:
            if one.exception() is None:
                stack.callback(one.result().close)
        opened = [one.result() for one in tries]
        disable_linger()
        return opened

    def _declare_echoes(self) -> None:
        prompt, bulk = (f"spot3d/{self._link.robot}/bridge/echo/{name}" for name in ("prompt", "bulk"))
        quick, last = zenoh.Priority.INTERACTIVE_HIGH, zenoh.Priority.DATA_LOW
        drop, block = zenoh.CongestionControl.DROP, zenoh.CongestionControl.BLOCK
        self._pings = (
            self._prompt.declare_publisher(prompt, priority=quick, congestion_control=drop),
            self._bulk.declare_publisher(bulk, priority=last, congestion_control=drop),
        )
        # In the same queue behind the images: with an image's number it says that this image has arrived.
        self._mark = self._bulk.declare_publisher(bulk, priority=last, congestion_control=block)
        self._bulk.declare_subscriber(prompt, self._hear_prompt)
        self._prompt.declare_subscriber(bulk, self._hear_bulk)

    def _hear_prompt(self, _sample: zenoh.Sample) -> None:
        self._heard_s["prompt"] = time.monotonic()

    def _hear_bulk(self, sample: zenoh.Sample) -> None:
        now_s = self._heard_s["bulk"] = time.monotonic()
        number = sample.payload.to_bytes()
        if number:
            with self._learning:
                self._pacing.arrived(int.from_bytes(number, "little"), now_s)

    def _declare_flows(self, stack: ExitStack) -> list[Flow]:
        local, robot, flows = self._local, self._link.robot, []
        here = (BRIDGE, *self._settings.stages)
        for topic in TOPICS.values():
            far = self._bulk if topic.kind == "query" or topic.congestion == _PACED else self._prompt
            origin, target = (local, far) if topic.producer in here else (far, local)
            if topic.kind == "query":
                stack.callback(QueryForwarder(topic, origin, target, robot).stop)
                continue
            forward = self._paced if target is self._bulk else self._send
            flows.append(Flow(topic, origin, target, self._link, forward, self._counters.error))
            stack.callback(flows[-1].stop)
        stack.callback(TokenMirror(local, self._prompt, robot, lambda stage: stage in here).stop)
        stack.callback(TokenMirror(self._prompt, local, robot, lambda stage: stage not in here).stop)
        # Undone first: while connections end, which may take seconds, late subscribers must not be given old messages.
        for flow in flows:
            if flow.target is local:
                stack.callback(flow.withdraw)
        return flows

    def _send(self, topic: Topic, payload: bytes, put: Put) -> None:
        put(payload)
        self._counters.published(topic.name, len(payload))

    def _paced(self, topic: Topic, payload: bytes, put: Put) -> None:
        """Send an image, or skip it if the link cannot take it now. In a lossless run nothing is skipped."""
        with self._sending:
            now_s = time.monotonic()
            with self._learning:
                goes = self._pacing.may_send(now_s) or self._link.delivery == "lossless"
                number = self._pacing.sent(now_s) if goes else 0
            if not goes:
                self._counters.drop(f"{topic.name} skipped")
                return
            put(payload)
            self._mark.put(number.to_bytes(8, "little"))
        self._counters.published(topic.name, len(payload))
