"""The results of a run, and their files."""

import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.calibration import NOMINAL, Calibration
from spot3d.found_object import FoundObject
from spot3d.whole_file import whole_file

RESULTS = ("objects.json", "heatmap.ply")
"""The files that `write_results` writes."""
_VERTEX = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3), ("heat", "<f4"), ("frequency", "<u4")])
"""One point of heatmap.ply."""
_HEADER = """ply
format binary_little_endian 1.0
comment spot3d 3D heatmap, world frame, metres
element vertex {count}
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
property float heat
property uint frequency
end_header
"""


@dataclass(frozen=True, slots=True)
class MapSnapshot:
    """Points of the 3D heatmap.

    xyz: (n, 3) float32 world metres; rgb: (n, 3) uint8; heat: (n,) float32 pseudo-average confidence;
    frequency: (n,) uint32 frames that saw the point; total: points of the whole map.
    """

    xyz: NDArray[np.float32]
    rgb: NDArray[np.uint8]
    heat: NDArray[np.float32]
    frequency: NDArray[np.uint32]
    total: int


def empty_snapshot() -> MapSnapshot:
    """The snapshot of a map without points."""
    return MapSnapshot(
        np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8), np.zeros(0, np.float32), np.zeros(0, np.uint32), 0
    )


@dataclass(frozen=True, slots=True)
class TrackedFrame:
    """Pose of one frame: T_world_camera (4, 4), trusted only where `lost` is False.

    delay_s: by how much its pose was extrapolated. calibration: the camera's, at this frame.
    """

    stamp_ns: int
    T_world_camera: NDArray[np.float64]
    lost: bool
    delay_s: float = 0.0
    calibration: Calibration = NOMINAL


@dataclass(frozen=True, slots=True)
class RunResult:
    """The objects found, the camera's trajectory and the map.

    up: (3,) unit normal of the supporting plane, world. frame_count: frames fused. trajectory: by stamp; of a long run
    its end. left_out: candidates that are no objects, by reason. keyframes_dropped: keyframes forgotten because there
    were too many. map_limit_reached: points of the map were, too.
    """

    objects: tuple[FoundObject, ...] = ()
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    frame_count: int = 0
    trajectory: tuple[TrackedFrame, ...] = ()
    points: MapSnapshot = field(default_factory=empty_snapshot)
    left_out: dict[str, int] = field(default_factory=dict)
    keyframes_dropped: int = 0
    map_limit_reached: bool = False

    def path(self) -> list[TrackedFrame]:
        """The frames whose pose is trusted."""
        return [item for item in self.trajectory if not item.lost]

    def delay_s(self) -> float:
        """How much older than their images the given poses are, as known in the end."""
        return next((item.delay_s for item in reversed(self.trajectory) if not item.lost), 0.0)

    def calibration(self) -> Calibration:
        """The corrections of the camera by which it agrees with the given poses, as known in the end."""
        return next((item.calibration for item in reversed(self.trajectory) if not item.lost), NOMINAL)


def write_results(folder: Path, result: RunResult) -> None:
    """Write objects.json and heatmap.ply. Each file appears whole or not at all."""
    write_json(folder / "objects.json", objects_document(result))
    write_ply(folder / "heatmap.ply", result.points)


def objects_document(result: RunResult) -> dict[str, Any]:
    """The document of objects.json; metres, world frame, rotation by rows with the box's axes as columns."""
    return {
        "objects": [
            {
                "id": item.id,
                "centre": item.box.centre.tolist(),
                "size": item.box.size.tolist(),
                "rotation": item.box.rotation.tolist(),
                "points": item.points,
                "confidence": item.confidence,
                "views": item.views,
            }
            for item in result.objects
        ],
        "up": list(result.up),
        "frame_count": result.frame_count,
    }


def found_in(document: Any) -> RunResult:
    """The objects of a document of `objects_document`. Raises ValueError if it is none."""
    try:
        x, y, z = map(float, document["up"])
        found = tuple(
            FoundObject(
                id=item["id"],
                box=Box3D(np.array(item["centre"]), np.array(item["size"]), np.array(item["rotation"])),
                confidence=item["confidence"],
                views=item["views"],
                points=item["points"],
            )
            for item in document["objects"]
        )
        return RunResult(objects=found, up=(x, y, z), frame_count=int(document["frame_count"]))
    except (KeyError, TypeError) as error:
        raise ValueError(f"not a valid objects.json of a run: {type(error).__name__} {error}") from error


def json_bytes(document: dict[str, Any]) -> bytes:
    """A JSON document, indented. Raises ValueError for numbers that JSON does not know."""
    return (json.dumps(document, indent=2, allow_nan=False) + "\n").encode()


def write_json(path: Path, document: dict[str, Any]) -> None:
    """Write a JSON document, indented. Raises ValueError for numbers that JSON does not know."""
    with whole_file(path) as stream:
        stream.write(json_bytes(document))


def ply_bytes(points: MapSnapshot) -> bytes:
    """Binary little-endian PLY: x y z (float), red green blue (uchar), heat (float), frequency (uint)."""
    rows = np.empty(len(points.xyz), _VERTEX)
    rows["xyz"], rows["rgb"] = points.xyz, points.rgb
    rows["heat"], rows["frequency"] = points.heat, points.frequency
    return _HEADER.format(count=len(rows)).encode("ascii") + rows.tobytes()


def write_ply(path: Path, points: MapSnapshot) -> None:
    """Write the points as PLY."""
    with whole_file(path) as stream:
        stream.write(ply_bytes(points))


def read_ply(path: Path) -> MapSnapshot:
    """The points of a file of `write_ply`. Raises ValueError if it is another file, or cut off."""
    header, found, body = path.read_bytes().partition(b"end_header\n")
    count = re.search(rb"^element vertex (\d+)$", header, re.MULTILINE)
    if not found or b"comment spot3d 3D heatmap" not in header or count is None:
        raise ValueError(f"{path} is not a heatmap.ply of a run")
    if len(body) != int(count[1]) * _VERTEX.itemsize:
        raise ValueError(f"{path} is truncated")
    rows = np.frombuffer(body, _VERTEX)
    xyz, rgb, heat, frequency = (rows[name].copy() for name in ("xyz", "rgb", "heat", "frequency"))
    return MapSnapshot(xyz, rgb, heat, frequency, len(rows))
