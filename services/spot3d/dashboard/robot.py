"""The dashboard's state of one robot."""

from collections import OrderedDict, deque

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.dashboard.health import StageRecords
from spot3d.dashboard.points import MapCopy
from spot3d.dashboard.world import Trail
from spot3d.dataflow.clocks import one_clock
from spot3d.dataflow.conversion import calibration_of
from spot3d.run.report import HopTimes
from spot3d_schemas import Health, MapChanges, Message, Object3D, Objects, Pose, Preview, Progress

_POSES = 120
"""Poses kept for previews that come later: four seconds of a camera."""
_WITHOUT_POSE_S = 1.0
"""A preview whose pose has not come after this time is shown without boxes."""
_COMING = 8
"""Most previews that wait for their poses: more than come in that time, at five a second."""
_HEAT_APART_NS = 1_000_000_000
"""Largest time between a preview and the heat that is overlaid on it."""
_TIMES = 300
"""Latencies kept of each hop: ten seconds of a camera."""


class Robot:
    """State from all messages of one robot, bounded in size. Times are monotonic seconds."""

    def __init__(self, name: str, points_max: int) -> None:
        self.name = name
        self.alive: frozenset[str] = frozenset()
        self.alive_s = float("-inf")
        """When a stage of it was last alive."""
        self.records = StageRecords()
        self.map = MapCopy(points_max)
        self.objects: Objects | None = None
        self._up: NDArray[np.float64] | None = None
        self.pose: Pose | None = None
        self.lost = ""
        self.trail = Trail()
        self.planes: NDArray[np.float64] = np.zeros((0, 4))
        self.progress: Progress | None = None
        self.heat: Preview | None = None
        self.shown: tuple[Preview, NDArray[np.float64] | None] | None = None
        self.frame_s: float | None = None
        self.hops = HopTimes(_TIMES)
        self._coming: deque[tuple[Preview, float]] = deque()
        self._poses: OrderedDict[int, Pose] = OrderedDict()

    @property
    def complete(self) -> bool:
        """Whether the last objects of a run have come."""
        return self.objects is not None and self.objects.complete

    def present(self, stages: frozenset[str], now_s: float) -> None:
        """Set which of its stages are alive now."""
        self.alive = stages
        if stages:
            self.alive_s = now_s

    def receive(self, topic: str, message: Message, now_s: float) -> None:
        """Process a message of this robot."""
        if isinstance(message, Health):
            self.records.receive(message, now_s)
        elif isinstance(message, Objects):
            self._found(message)
        elif isinstance(message, Pose):
            self._posed(message)
        elif isinstance(message, Preview):
            if topic == "heatmap/preview":
                self.heat = message
            else:
                self.frame_s = now_s
                self._coming.append((message, now_s))
        elif isinstance(message, Progress):
            self.progress = message
            self._timed(message)
        elif isinstance(message, MapChanges):
            self._changed(message)
        self._pair(now_s)

    def objects_from(self, confidence: float) -> list[Object3D]:
        """The objects of at least this confidence, the most confident first."""
        known = () if self.objects is None else self.objects.objects
        chosen = [item for item in known if item.confidence >= confidence]
        return sorted(chosen, key=lambda item: (-item.confidence, item.id))

    def heat_of(self, preview: Preview) -> Preview | None:
        """Heat to be overlaid on this preview: of its frame, or of one shortly before or after."""
        if self.heat is None or abs(self.heat.header.stamp_ns - preview.header.stamp_ns) > _HEAT_APART_NS:
            return None
        return self.heat

    def up(self) -> NDArray[np.float64] | None:
        """Up (3,) in this robot's world; before any object is known, up in the camera's image."""
        if self._up is not None:
            return self._up
        return None if self.pose is None else -self.pose.T_world_camera[:3, 1]

    def _posed(self, pose: Pose) -> None:
        self.lost = pose.reason or "no reason given" if pose.status == "lost" else ""
        if self.lost:
            return
        self.pose = pose
        self.trail.add(pose.T_world_camera[:3, 3])
        self._poses[pose.header.stamp_ns] = pose
        while len(self._poses) > _POSES:
            self._poses.popitem(last=False)

    def _pair(self, now_s: float) -> None:
        """Show the newest waiting preview whose pose is known, or has not come for too long."""
        for later in range(len(self._coming)):
            preview, came_s = self._coming[-1 - later]
            pose = self._poses.get(preview.header.stamp_ns)
            if pose is not None:
                self.shown = _calibrated(preview, pose), pose.T_world_camera
            elif now_s - came_s > _WITHOUT_POSE_S or later >= _COMING or self.lost:
                self.shown = preview, None
            else:
                continue
            while len(self._coming) > later:
                self._coming.popleft()
            return

    def _timed(self, progress: Progress) -> None:
        trace = progress.header.trace
        if not one_clock(trace):
            self.hops = HopTimes(_TIMES)
        else:
            self.hops.add(trace, f"{trace[0].stage} to {trace[-1].stage}, in all" if len(trace) > 2 else "")

    def _found(self, objects: Objects) -> None:
        if self.objects is not None and objects.epoch != self.objects.epoch:
            self.trail = Trail()
        self.objects = objects
        if objects.objects:
            self._up = objects.up

    def _changed(self, changes: MapChanges) -> None:
        """Apply changes of the map. Objects of its epoch are kept: they may come before it, and outlive a restart."""
        another = self.map.apply(changes)
        if another and self.objects is not None and self.objects.epoch != changes.epoch:
            self.objects, self.trail = None, Trail()
        self.planes = changes.planes


def _calibrated(preview: Preview, pose: Pose) -> Preview:
    """The preview with intrinsics corrected by its pose's calibration, so that boxes fit the image."""
    known, told = calibration_of(pose), preview.intrinsics
    camera = known.camera(Intrinsics(**told.model_dump()))
    return preview.model_copy(update={"intrinsics": told.model_copy(update={"cx": camera.cx, "cy": camera.cy})})
