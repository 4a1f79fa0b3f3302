"""Exports a run or a recording to an MCAP file in Foxglove's schemas."""

from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Protocol

import numpy as np
from foxglove import Schema
from foxglove.messages import CameraCalibration, CompressedImage, FrameTransforms, PointCloud, SceneUpdate

import spot3d
from spot3d.frame import RgbdFrame
from spot3d.recorder import foxglove_messages as made
from spot3d.recorder.export_items import Cloud, ExportItem, items_of_recording, items_of_run
from spot3d.recorder.mcap_contents import open_mcap
from spot3d.recorder.mcap_writer import McapWriter
from spot3d.source.errors import SourceError


class _Encoded(Protocol):
    @staticmethod
    def get_schema() -> Schema: ...

    def encode(self) -> bytes: ...


_CHANNELS: dict[str, type[_Encoded]] = {
    "/camera/image": CompressedImage,
    "/camera/calibration": CameraCalibration,
    "/tf": FrameTransforms,
    "/points": PointCloud,
    "/objects": SceneUpdate,
    "/objects/edges": PointCloud,
}


def export(source: Path, out: Path, complain: Callable[[str], None]) -> dict[str, int]:
    """Write the results folder of a run, or a recording, as Foxglove messages. Log times are capture times.

    Returns the number of messages of each topic. complain: called with what had to be skipped. Raises SourceError where
    `source` cannot be read or holds nothing to export, FileExistsError, and OSError where the disk is full.
    """
    if source.is_dir():
        sights: Iterable[tuple[int, ExportItem]] = items_of_run(source, complain)
    else:
        sights = items_of_recording(open_mcap(source), complain)
    writer = McapWriter(out, "", f"spot3d {spot3d.__version__}")
    try:
        exporter = _Exporter(writer)
        for stamp_ns, sight in sights:
            exporter.add(stamp_ns, sight)
        if not any(exporter.written.values()):
            raise SourceError(f"{source} has nothing to export: no frames, poses or objects")
        writer.close()
    except BaseException:
        with suppress(OSError):
            writer.close()
        # An incomplete export would be taken for a complete one.
        out.unlink(missing_ok=True)
        raise
    return exporter.written


class _Exporter:
    def __init__(self, writer: McapWriter) -> None:
        self.written = dict.fromkeys(_CHANNELS, 0)
        self._writer = writer
        self._shown: set[int] = set()
        self._channels: dict[str, int] = {}
        for topic, message in _CHANNELS.items():
            schema = message.get_schema()
            self._channels[topic] = writer.channel(topic, schema.name, schema.data, schema.encoding, "protobuf", {})

    def add(self, stamp_ns: int, sight: ExportItem) -> None:
        """Write the messages that show one sight."""
        if isinstance(sight, RgbdFrame):
            self._put("/camera/image", stamp_ns, made.image(stamp_ns, sight.colour))
            self._put("/camera/calibration", stamp_ns, made.calibration(stamp_ns, sight.intrinsics))
        elif isinstance(sight, Cloud):
            frame_id = made.CAMERA if sight.in_camera else made.WORLD
            self._put("/points", stamp_ns, made.points(stamp_ns, frame_id, sight.xyz, sight.rgb))
        elif isinstance(sight, np.ndarray):
            self._put("/tf", stamp_ns, made.camera_pose(stamp_ns, sight))
        else:
            found = {item.id for item in sight.objects}
            self._put("/tf", stamp_ns, made.upright(stamp_ns, sight.up))
            scene = made.scene(stamp_ns, sight.objects, sight.up, sorted(self._shown - found))
            self._put("/objects", stamp_ns, scene)
            # Rerun does not support SceneUpdate.
            xyz, rgb = made.edge_points(sight.objects)
            self._put("/objects/edges", stamp_ns, made.points(stamp_ns, made.WORLD, xyz, rgb))
            self._shown = found

    def _put(self, topic: str, stamp_ns: int, message: _Encoded) -> None:
        count = self.written[topic]
        self._writer.add(self._channels[topic], stamp_ns, stamp_ns, count, message.encode())
        self.written[topic] = count + 1
