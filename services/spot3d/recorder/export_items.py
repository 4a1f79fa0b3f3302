"""The visible data of a run or a recording, in the order of capture: frames, poses, objects and points."""

import heapq
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import back_project
from spot3d.dataflow.conversion import rgbd_frame
from spot3d.frame import RgbdFrame
from spot3d.recorder.mcap_contents import McapContents
from spot3d.run.from_messages import found_objects
from spot3d.run.growing_files import TRAJECTORY, UPDATES
from spot3d.run.results import RunResult, found_in, read_ply
from spot3d.settings import load_settings
from spot3d.source.errors import SourceError
from spot3d.source.selected import Selection, open_selection
from spot3d.trajectory import read_tum
from spot3d_schemas import TOPICS, CodecError, Frame, Heat, Objects, Pose, decode

_CLOUD_INTERVAL_NS = 500_000_000
_CLOUD_STEP = 4
"""Every nth pixel of a frame's rows and columns becomes a point."""


@dataclass(frozen=True, slots=True)
class Cloud:
    """Points in the world, or in the camera's frame at this capture. xyz: (n, 3) metres; rgb: (n, 3) uint8."""

    in_camera: bool
    xyz: NDArray[np.float32]
    rgb: NDArray[np.uint8]


ExportItem = RgbdFrame | NDArray[np.float64] | RunResult | Cloud
"""A frame, the camera's pose T_world_camera (4, 4), the objects of one update, or points."""


def items_of_run(folder: Path, complain: Callable[[str], None]) -> Iterator[tuple[int, ExportItem]]:
    """Stamp and sight from the files of a run. Frames come from its input, if that is still there.

    Raises SourceError if the folder holds no run's results.
    """
    report = folder / "report.json"
    if not report.is_file():
        raise SourceError(f"{folder} is not a folder of results: report.json is missing")
    try:
        stamps, poses = read_tum(folder / TRAJECTORY)
        final = found_in(json.loads((folder / "objects.json").read_text(encoding="utf-8")))
        lines = (folder / UPDATES).read_text(encoding="utf-8").splitlines() if (folder / UPDATES).exists() else []
        updates = [(document["stamp_ns"], found_in(document)) for document in map(json.loads, lines)]
        cloud = read_ply(folder / "heatmap.ply")
    except (KeyError, ValueError) as error:
        raise SourceError(f"{folder}: {error}") from error
    first, last = (stamps[0], stamps[-1]) if stamps else (0, 0)
    if len(cloud.xyz):
        yield first, Cloud(False, cloud.xyz, cloud.rgb)
    yield from heapq.merge(
        zip(stamps, poses, strict=True),
        _frames_of_run(folder, complain),
        updates,
        [(max([last, *(stamp for stamp, _ in updates)]), final)] if final.frame_count else [],
        key=lambda item: item[0],
    )


def _frames_of_run(folder: Path, complain: Callable[[str], None]) -> Iterator[tuple[int, RgbdFrame]]:
    try:
        report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
        chosen = report["selection"]
        sequence = open_selection(Selection(**chosen), load_settings(folder / "settings.toml").source)
    except (SourceError, KeyError, TypeError, ValueError) as error:
        complain(f"without images: {error}")
        return
    for index in range(len(sequence)):
        try:
            frame = sequence[index]
        except SourceError as error:
            complain(f"without the image of frame {index}: {error}")
            continue
        yield frame.stamp_ns, frame


def items_of_recording(contents: McapContents, complain: Callable[[str], None]) -> Iterator[tuple[int, ExportItem]]:
    """Stamp and sight from the messages of a recording. Every half second a frame becomes points.

    complain: called with what cannot be read.
    """
    if not contents.complete:
        complain(f"{contents.path} is incomplete: its last {contents.lost_bytes} bytes are lost")
    topic_of = {number: topic for topic, number in contents.topics.items()}
    images = "source/frame" if "source/frame" in contents.topics else "heatmap/heat"
    wanted = {images, "pose/pose", "fusion/objects"}
    cloud_ns: int | None = None
    for message in contents.between(contents.start_ns, contents.end_ns, complain):
        topic = topic_of.get(message.channel_id, "")
        if topic not in wanted:
            continue
        try:
            decoded = decode(message.data, TOPICS[topic].message)
        except CodecError as error:
            complain(f"left out a message: {error}")
            continue
        stamp_ns = decoded.header.stamp_ns
        if isinstance(decoded, Pose) and decoded.status == "ok":
            yield stamp_ns, decoded.T_world_camera
        elif isinstance(decoded, Objects):
            yield stamp_ns, found_objects(decoded)
        elif isinstance(decoded, Frame | Heat):
            frame = rgbd_frame(decoded)
            yield stamp_ns, frame
            if cloud_ns is None or not 0 <= stamp_ns - cloud_ns < _CLOUD_INTERVAL_NS:
                cloud_ns = stamp_ns
                yield stamp_ns, _cloud(frame)


def _cloud(frame: RgbdFrame) -> Cloud:
    depth = frame.depth_metres()
    xyz = back_project(depth, frame.intrinsics)[::_CLOUD_STEP, ::_CLOUD_STEP]
    seen = depth[::_CLOUD_STEP, ::_CLOUD_STEP] > 0
    return Cloud(True, xyz[seen], frame.colour[::_CLOUD_STEP, ::_CLOUD_STEP][seen])
