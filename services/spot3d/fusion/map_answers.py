"""Answers to queries for the map's points, beside the fusing of further frames, and for its changes."""

import threading
import time
from dataclasses import dataclass
from queue import SimpleQueue

import numpy as np
import zenoh

from spot3d.dataflow.node import Node
from spot3d.dataflow.stopping import end_threads
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.map.map_arrays import R, X
from spot3d.fusion.map.selection import FrequentPoints, counting
from spot3d_schemas import Header, MapChanges, MapPoints
from spot3d_schemas.limits import MAX_COUNT, MAX_MAP_CHANGES, MAX_MAP_POINTS

TOPIC = "fusion/map"
_FRESH_S = 1.0
"""Clients that ask within this time of each other get the same points: a crowd costs no more than one."""
_WAITING = 8
"""Most queries that wait for an answer; others are told to ask again."""


@dataclass(frozen=True, slots=True)
class _Copy:
    """The map's points at `at_s`, monotonic seconds; complete: whether the stream had ended."""

    at_s: float
    complete: bool
    points: FrequentPoints
    total: int
    header: Header
    epoch: str


class MapAnswers:
    """One thread that answers one query at a time."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._copy: _Copy | None = None
        self._queries = SimpleQueue[tuple[zenoh.Query, _Copy] | None]()
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="map", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread; queries that still wait get no answer."""
        self._closed = True
        self._queries.put(None)
        end_threads((self._thread,))

    def forget(self) -> None:
        """Forget the copy, which is of another map."""
        self._copy = None

    def submit(self, query: zenoh.Query, fusion: Fusion, header: Header, epoch: str, complete: bool) -> None:
        """Answer a query with the map as it is now, or was within the last second.

        complete: whether the stream has ended, and the map is final.
        """
        if self._queries.qsize() >= _WAITING:
            self._node.refuse(query, TOPIC, "too many requests for the map; ask again in a second")
            return
        copy, now_s = self._copy, time.monotonic()
        if copy is None or now_s - copy.at_s > _FRESH_S or copy.complete != complete:
            copy = _Copy(now_s, complete, fusion.frequent_points(), fusion.heatmap.count, header, epoch)
            self._copy = copy
        self._queries.put((query, copy))

    def _work(self) -> None:
        while (asked := self._queries.get()) is not None and not self._closed:
            query, copy = asked
            self._node.reply(query, TOPIC, _message(copy, _limit(query)))


def _limit(query: zenoh.Query) -> int:
    try:
        return int(query.parameters.get("limit") or MAX_MAP_POINTS)
    except ValueError:
        return MAX_MAP_POINTS


def _message(copy: _Copy, limit: int) -> MapPoints:
    count = max(0, min(len(copy.points), limit, MAX_MAP_POINTS))
    # Evenly spread over the map, whose points are about in the order in which they were first seen.
    points = copy.points.take(np.linspace(0, len(copy.points) - 1, count).astype(np.int64))
    return MapPoints(
        header=copy.header,
        xyz=points.xyz,
        rgb=np.clip(np.rint(points.colour), 0, 255).astype(np.uint8),
        heat=points.heat,
        frequency=points.frequency.astype(np.uint32),
        total=copy.total,
        epoch=copy.epoch,
    )


def changes_message(fusion: Fusion, parameters: zenoh.Parameters, header: Header, epoch: str) -> MapChanges:
    """What changed in the map after what the client has, as the query's parameters say (see `MapChanges`).

    Missing or non-numeric parameters count as a client that has nothing. One that claims more than there is has all.
    """
    generation, since = _number(parameters, "generation", 0), _number(parameters, "since", 0)
    limit = max(1, min(_number(parameters, "limit", MAX_MAP_CHANGES), MAX_MAP_CHANGES))
    changes, heatmap = fusion.map_changes, fusion.heatmap
    rows = heatmap.points()
    least, tau = counting(fusion.frame_count, fusion.settings)
    known = since if generation == changes.generation else 0
    chosen, cursor, behind = changes.after(known, limit, rows, least, tau)
    heat, frequency = changes.as_sent(chosen)
    points = rows[chosen]
    return MapChanges(
        header=header,
        generation=changes.generation,
        cursor=cursor,
        behind=behind,
        number=chosen.astype(np.uint32),
        xyz=np.ascontiguousarray(points[:, X : X + 3]),
        rgb=np.clip(np.rint(points[:, R : R + 3]), 0, 255).astype(np.uint8),
        heat=heat,
        frequency=frequency,
        planes=fusion.supports.planes(),
        total=heatmap.count,
        epoch=epoch,
    )


def _number(parameters: zenoh.Parameters, name: str, otherwise: int) -> int:
    text = parameters.get(name) or ""
    return min(int(text), MAX_COUNT) if text.isdecimal() and len(text) < 20 else otherwise
