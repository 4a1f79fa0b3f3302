"""Converts a robot's messages to the types of a run: objects, and the map, which is queried."""

import time

import numpy as np
import zenoh

from spot3d.boxes import Box3D
from spot3d.dataflow.payload import decoded, refusal
from spot3d.found_object import FoundObject
from spot3d.run.results import MapSnapshot, RunResult
from spot3d_schemas import MapPoints, Objects, key

_AGAIN_S = 0.5
"""Time until a refused query is repeated: fusion refuses while it sends maps to others, which takes some tenths of a
second each."""


class NoMapError(Exception):
    """A robot's fusion has not given the map of a stream; the text says why."""


def asked_map(session: zenoh.Session, robot: str, timeout_s: float, stream: str | None) -> MapSnapshot:
    """The map of a stream, queried from a robot's fusion; while that refuses, again, until the time is over.

    Raises NoMapError if it does not answer, keeps refusing, or is in another stream.
    """
    end_s, why, again = time.monotonic() + timeout_s, "fusion does not answer", True
    while again and (left_s := end_s - time.monotonic()) > 0:
        again = False
        for reply in session.get(key(robot, "fusion/map"), timeout=left_s):
            if reply.ok is None:
                if said := refusal(reply):
                    why, again = f"fusion refuses: {said}", True
                continue
            message = decoded(reply.ok.payload, MapPoints)
            if message is None:
                why = "fusion's answer is no valid map"
            elif message.header.stream in (None, stream):
                return MapSnapshot(message.xyz, message.rgb, message.heat, message.frequency, message.total)
            else:
                why = "fusion is in another stream"
        if again:
            time.sleep(_AGAIN_S)
    raise NoMapError(why)


def found_objects(message: Objects) -> RunResult:
    """The objects of an update."""
    return RunResult(
        objects=tuple(
            FoundObject(
                item.id,
                Box3D(item.centre, item.size, item.rotation),
                item.confidence,
                item.views,
                item.points,
                np.array(item.colour, np.float64),
            )
            for item in message.objects
        ),
        up=(float(message.up[0]), float(message.up[1]), float(message.up[2])),
        frame_count=message.frame_count,
        left_out=dict(message.left_out),
        keyframes_dropped=message.keyframes_dropped,
        map_limit_reached=message.map_limit_reached,
    )
