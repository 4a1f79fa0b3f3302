"""What the page saves: the files that a run writes, of what is known now."""

import json
import tempfile
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.dashboard.picture import box_of
from spot3d.dashboard.robot import Robot
from spot3d.found_object import FoundObject
from spot3d.run.results import MapSnapshot, RunResult, objects_document, write_ply
from spot3d_schemas import MapPoints


def objects_file(robot: Robot) -> bytes:
    """objects.json of a robot's latest update."""
    objects = robot.objects
    if objects is None:
        return _json(RunResult())
    found = tuple(
        FoundObject(item.id, box_of(item), item.confidence, item.views, item.points) for item in objects.objects
    )
    x, y, z = objects.up.tolist()
    return _json(RunResult(objects=found, up=(x, y, z), frame_count=objects.frame_count))


def map_file(robot: Robot, whole: MapPoints | None) -> bytes:
    """heatmap.ply of the whole map where fusion has given it, else of the dashboard's copy (heat in 256 steps)."""
    if whole is not None:
        points = MapSnapshot(whole.xyz, whole.rgb, whole.heat, whole.frequency, whole.total)
    else:
        xyz, rgb, heat, frequency = robot.map.points()
        points = MapSnapshot(xyz, rgb, (heat / 255).astype(np.float32), frequency, len(xyz))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "heatmap.ply"
        write_ply(path, points)
        return path.read_bytes()


def png_file(view: NDArray[np.uint8]) -> bytes:
    """A PNG of a view, (h, w, 3) uint8 RGB."""
    return bytes(cv2.imencode(".png", cv2.cvtColor(view, cv2.COLOR_RGB2BGR))[1])


def _json(result: RunResult) -> bytes:
    return (json.dumps(objects_document(result), indent=2, allow_nan=False) + "\n").encode()
