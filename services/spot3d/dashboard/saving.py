"""Files saved from the page: those that a run writes, with the latest state."""

import numpy as np

from spot3d.dashboard.robot import Robot
from spot3d.run.from_messages import found_objects
from spot3d.run.results import MapSnapshot, RunResult, json_bytes, objects_document, ply_bytes
from spot3d_schemas import MapPoints


def objects_file(robot: Robot) -> bytes:
    """objects.json of a robot's latest update."""
    found = RunResult() if robot.objects is None else found_objects(robot.objects)
    return json_bytes(objects_document(found))


def map_file(robot: Robot, whole: MapPoints | None) -> bytes:
    """heatmap.ply of the whole map if fusion sent it, else of the dashboard's copy (heat in 256 steps)."""
    if whole is not None:
        return ply_bytes(MapSnapshot(whole.xyz, whole.rgb, whole.heat, whole.frequency, whole.total))
    xyz, rgb, heat, frequency = robot.map.points()
    return ply_bytes(MapSnapshot(xyz, rgb, (heat / 255).astype(np.float32), frequency, len(xyz)))
