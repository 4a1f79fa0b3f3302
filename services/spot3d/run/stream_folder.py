"""The results of one stream of frames, in a folder of their own."""

import re
import shutil
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spot3d.run.growing_files import GrowingFiles
from spot3d.run.overview import View, write_overview
from spot3d.run.results import MapSnapshot, RunResult, objects_document, write_json, write_ply
from spot3d_schemas import Progress

_PLACES = 4000
"""Maximum number of camera positions in an overview."""
_NAME = re.compile(r"\d{8}-\d{6}-\w{1,8}")
"""Start of the stream, UTC, and its name."""


class StreamFolder:
    """Writes the results of a stream: the trajectory and the updates line by line, the rest at `write`.

    no_map: why there is no map, for people. Raises OSError where the folder cannot be made.
    """

    def __init__(self, parent: Path, robot: str, stream: str | None, began_s: float) -> None:
        self.robot, self.stream = robot, stream
        label = re.sub(r"\W", "_", stream or "unnamed")[:8]
        self.path = parent / f"{time.strftime('%Y%m%d-%H%M%S', time.gmtime(began_s))}-{label}"
        self.path.mkdir(parents=True, exist_ok=True)
        self._files = GrowingFiles(self.path)
        self._places: list[NDArray[np.float64]] = []
        self._place_step, self._tracked, self._lost, self._lost_because = 1, 0, 0, ""
        self.result = RunResult()
        self.progress: Progress | None = None
        self.complete = False
        self.no_map = ""

    def pose(self, stamp_ns: int, T_world_camera: NDArray[np.float64] | None, reason: str = "") -> None:
        """Add a frame's camera pose, (4, 4); None: it is lost, and `reason` says why."""
        if T_world_camera is None:
            self._lost, self._lost_because = self._lost + 1, reason
            return
        self._files.add_pose(stamp_ns, T_world_camera)
        if self._tracked % self._place_step == 0:
            self._places.append(T_world_camera[:3, 3])
        if len(self._places) > _PLACES:
            self._places, self._place_step = self._places[::2], 2 * self._place_step
        self._tracked += 1

    def update(self, stamp_ns: int, found: RunResult, complete: bool) -> None:
        """Add the objects after the frame of this stamp."""
        self.result, self.complete = found, complete
        self._files.add_update(stamp_ns, found, complete)

    def write(self, points: MapSnapshot | None = None, views: Sequence[View] | None = None) -> None:
        """Write objects.json and stream.json; with `points` heatmap.ply, with `views` overview.png. Raises OSError."""
        write_json(self.path / "objects.json", objects_document(self.result))
        progress, events = self.progress, [*self._files.notices(), *filter(None, [self.no_map])]
        document = {
            "robot": self.robot,
            "stream": self.stream,
            "complete": self.complete,
            "fused": 0 if progress is None else progress.fused,
            "skipped": {} if progress is None else dict(progress.skipped),
            "lost_poses": self._lost,
            "lost_because": self._lost_because or None,
            "objects": len(self.result.objects),
            "left_out": self.result.left_out,
            "events": events,
        }
        if points is not None:
            write_ply(self.path / "heatmap.ply", points)
        if views is not None:
            drawn = self.result if points is None else replace(self.result, points=points)
            places = np.array(self._places).reshape(-1, 3)
            if not_drawn := write_overview(self.path / "overview.png", self.path.name, views, drawn, places):
                events.append(not_drawn)
        # Last: a reader that sees that a stream is complete finds all of its files.
        write_json(self.path / "stream.json", document)

    def close(self) -> None:
        """Close the files."""
        self._files.close()


def drop_oldest(parent: Path, keep: int, latest: Path) -> list[Path]:
    """Delete the folders of the oldest streams until there are `keep`; returns those deleted.

    latest: a folder that stays, whatever the clock says of its start.
    """
    folders = sorted(path for path in parent.iterdir() if path.is_dir() and _NAME.fullmatch(path.name))
    others = [path for path in folders if path != latest]
    gone = others[: max(0, len(folders) - keep)]
    for path in gone:
        shutil.rmtree(path, ignore_errors=True)
    return gone
