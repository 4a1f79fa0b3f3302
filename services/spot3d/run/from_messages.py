"""Converts a robot's messages to the types of a run: objects, and the map, which is queried."""

import numpy as np
import zenoh

from spot3d.boxes import Box3D
from spot3d.dataflow.payload import decoded
from spot3d.found_object import FoundObject
from spot3d.run.results import MapSnapshot, RunResult
from spot3d_schemas import MapPoints, Objects, key


def asked_map(session: zenoh.Session, robot: str, timeout_s: float, stream: str | None) -> MapSnapshot | None:
    """The map of a stream, queried from a robot's fusion; None if it does not answer or is in another stream."""
    for reply in session.get(key(robot, "fusion/map"), timeout=timeout_s):
        message = decoded(reply.ok.payload, MapPoints) if reply.ok is not None else None
        if message is not None and message.header.stream in (None, stream):
            return MapSnapshot(message.xyz, message.rgb, message.heat, message.frequency, message.total)
    return None


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
