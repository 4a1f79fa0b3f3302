"""The fusion stage's core: frames with heat and pose in, 3D objects with stable numbers out (paper, Sec. V)."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import moved
from spot3d.calibration import NOMINAL, Calibration
from spot3d.camera import Intrinsics, back_project, invert
from spot3d.camera_pose import CameraPose
from spot3d.depth_noise import DepthNoise
from spot3d.found_object import FoundObject
from spot3d.frame_segments import NO_SUPPORT, FrameSegments
from spot3d.fusion.map.changes import ChangeLog
from spot3d.fusion.map.heatmap3d import Heatmap3D
from spot3d.fusion.map.index_map import IndexMap, MatchCounts
from spot3d.fusion.map.selection import FrequentPoints, frequent_points
from spot3d.fusion.objects.added_support import with_support
from spot3d.fusion.objects.consensus import ViewConsensus
from spot3d.fusion.objects.identity import Identities
from spot3d.fusion.objects.keyframes import FusedFrame, FusedFrames, Keyframe, keyframe_of
from spot3d.fusion.paper.density import find_by_density
from spot3d.fusion.paper.ransac import planes_by_ransac
from spot3d.fusion.paper.removal import project_inliers
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.supports import RecentSupports
from spot3d.geometry.downsampling import to_lattice
from spot3d.geometry.planes import dominant_planes, on_plane, supporting_plane, transform_plane
from spot3d.pose_corrections import PoseCorrections

_AWAITING_SEGMENTS = 60
"""Fused frames that segments may still come for: a learned segmenter may take two seconds of a camera; 0.5 MB each."""
_REMEMBERED = 10_000
"""Most removed planes kept; beyond, every second one goes."""


@dataclass(frozen=True, slots=True)
class FoundObjects:
    """The objects of one update; up: (3,) unit, world; frame_count: frames fused so far.

    left_out: what was taken for an object at first, by the reason why it is none (see `reasons`). keyframes_dropped:
    those that were forgotten because there were more than `keyframe_limit`.
    """

    objects: list[FoundObject]
    up: NDArray[np.float64]
    frame_count: int
    left_out: Counter[str] = field(default_factory=Counter)
    keyframes_dropped: int = 0


@dataclass(frozen=True, slots=True)
class MapState:
    """A map that another fusion can go on from.

    rows: (n, 16) float32 points and keys: (n,) int64 the voxel of each (see `Heatmap3D.held`); removed, candidates:
    (k, 4) planes, world; supporting: (4,) or None; T_world_map: (4, 4) where the map of poses lay by the last frame;
    poses_of: whose poses these were; T_theirs_map: (4, 4) the map of poses in theirs. calibration: of keyframes;
    calibrated_by: who gave it.
    """

    rows: NDArray[np.float32]
    keys: NDArray[np.int64]
    evicted: int
    frame_count: int
    removed: NDArray[np.float64]
    candidates: NDArray[np.float64]
    supporting: NDArray[np.float64] | None
    T_world_map: NDArray[np.float64]
    poses_of: str | None
    T_theirs_map: NDArray[np.float64]
    calibration: Calibration
    calibrated_by: str | None


ObjectsTask = Callable[[], FoundObjects]
"""Finds the objects of one moment, numbered as in the tasks that ran before. Tasks run one at a time, in the order of
their snapshots."""


class Fusion:
    """Fuses frames into the 3D heatmap and finds the objects in it."""

    def __init__(self, settings: FusionSettings) -> None:
        self.settings = settings
        self.heatmap = Heatmap3D(settings.map_limit, settings.voxel)
        self.map_changes = ChangeLog()
        self._begin()

    def reset(self) -> None:
        """Forget everything; object numbers start anew."""
        self.heatmap.clear()
        self.map_changes.clear()
        self._begin()

    def _begin(self) -> None:
        """What is known with an empty map: nothing."""
        self.frame_count = 0
        self.supports = RecentSupports()
        self.consensus = ViewConsensus(self.settings)
        self.identities = Identities()
        self._fused = FusedFrames(_AWAITING_SEGMENTS)
        self._index_map = IndexMap(self.settings)
        self._removed: list[NDArray[np.float64]] = []
        self._candidates = np.zeros((0, 4))
        self._supporting: NDArray[np.float64] | None = None
        self._inliers = np.zeros((0, 3), np.float32)  # the last keyframe's points on it, world
        self._T_world_map = self._T_theirs_map = np.eye(4)
        self._poses_of: str | None = None
        self._calibration = NOMINAL
        self._calibrated_by: str | None = None
        self._corrections: PoseCorrections | None = None

    def map_state(self) -> MapState:
        """The map as it is now, copied, without its objects."""
        rows, keys = self.heatmap.held()
        return MapState(
            rows=rows,
            keys=keys,
            evicted=self.heatmap.evicted,
            frame_count=self.frame_count,
            removed=np.array(self._removed).reshape(-1, 4),
            candidates=self._candidates,
            supporting=self._supporting,
            T_world_map=self._T_world_map,
            poses_of=self._poses_of,
            T_theirs_map=self._T_theirs_map,
            calibration=self._calibration,
            calibrated_by=self._calibrated_by,
        )

    def resume(self, state: MapState, consensus: ViewConsensus, identities: Identities) -> None:
        """Go on from another fusion's map, and from the objects that belong to it."""
        self.reset()
        self.heatmap.restore(state.rows, state.keys)
        self.heatmap.evicted, self.frame_count = state.evicted, state.frame_count
        self._removed = list(state.removed)
        self._candidates, self._supporting = state.candidates, state.supporting
        self._T_world_map, self._poses_of, self._T_theirs_map = state.T_world_map, state.poses_of, state.T_theirs_map
        self._calibration, self._calibrated_by = state.calibration, state.calibrated_by
        self.consensus, self.identities = consensus, identities

    def fuse(
        self,
        colour: NDArray[np.uint8],
        depth: NDArray[np.float32],
        heat: NDArray[np.uint8],
        camera: Intrinsics,
        pose: CameraPose,
        stamp_ns: int | None = None,
    ) -> MatchCounts:
        """Take in one frame: supporting plane, its removal from the heat, registration with the map.

        colour: (h, w, 3) uint8 RGB; depth: (h, w) float32 metres, 0 = invalid; heat: (h, w) uint8, 255ths. stamp_ns: by
        which `observe` finds the frame for a while; None: it does not.
        """
        T_world_camera = pose.T_world_camera.copy()
        if pose.calibration != NOMINAL or pose.given_by == self._calibrated_by:
            # Who gives poses anew does not know it at first; who gave it may take it back.
            self._calibration, self._calibrated_by = pose.calibration, pose.given_by
        if pose.corrections is not None or pose.given_by != self._poses_of:
            # What one knew of its poses says nothing of another's, whose frames come after them.
            self._corrections = pose.corrections
        known = replace(self._calibration, turn=pose.calibration.turn)
        depth = known.metres(depth)
        frame = to_lattice(colour, depth, heat, camera, self.settings.lattice_width, self.settings.grazing_cos)
        frame = replace(frame, camera=known.camera(frame.camera))
        warm = frame.heat
        if self.settings.plane_removal:
            points = back_project(frame.depth, frame.camera)
            if self.frame_count % self.settings.keyframe_interval == 0:
                self._keyframe(points, frame.heat, T_world_camera, camera.noise)
            if self._supporting is not None:
                plane = transform_plane(self._supporting, invert(T_world_camera))
                on = on_plane(plane, points, self.settings, camera.noise)
                if self.settings.plane_pixels == "keyframe" and len(self._inliers):  # a map that is resumed has none
                    on = project_inliers(self._inliers, T_world_camera, frame.camera)
                warm = np.where(on, np.uint8(0), frame.heat)
        elif self._supporting is None:
            self._keyframe(back_project(frame.depth, frame.camera), frame.heat, T_world_camera, camera.noise)
        self._follow_map(np.eye(4) if pose.T_world_map is None else pose.T_world_map, pose.given_by)
        self.frame_count += 1
        # The images are kept until the next frame, and longer with a stamp; at full size they may be the caller's own.
        theirs = np.may_share_memory(frame.colour, colour) or np.may_share_memory(frame.depth, depth)
        seen = (frame.colour.copy(), frame.depth.copy()) if theirs else (frame.colour, frame.depth)
        if stamp_ns is not None:
            T_map_camera = invert(self._T_world_map) @ T_world_camera
            self._fused.add(FusedFrame(stamp_ns, *seen, frame.camera, T_world_camera, T_map_camera, known))
        return self._index_map.register(self.heatmap, self.frame_count, *seen, warm, frame.camera, T_world_camera)

    def _follow_map(self, T_world_theirs: NDArray[np.float64], poses_of: str | None) -> None:
        """Say where the map of poses lies by now, in which keyframes are; theirs: the map of who gives the poses."""
        if self.frame_count and poses_of != self._poses_of:
            self._T_theirs_map = invert(T_world_theirs) @ self._T_world_map
        self._poses_of = poses_of
        self._T_world_map = T_world_theirs @ self._T_theirs_map

    def observe(self, segments: FrameSegments, stamp_ns: int) -> bool:
        """Take in the objects of a single frame that has been fused with this stamp.

        Segments that bring no planes stand on the supporting plane that is known here, as far as they do. Returns
        False, and does nothing, where the frame is none of the last 60 fused, or has been observed already.
        """
        frame = self._fused.take(stamp_ns)
        if frame is None:
            return False
        keyframe = keyframe_of(frame, segments.calibrated(frame.calibration))
        if len(segments) and not len(segments.planes) and self._supporting is not None:
            keyframe = with_support(keyframe, transform_plane(self._supporting, invert(frame.T_world_camera)))
        self.consensus.add(keyframe)
        for plane in keyframe.supports()[::-1]:
            self.supports.add(transform_plane(plane, frame.T_world_camera), frame.T_world_camera[:3, 3])
        return True

    def frequent_points(self) -> FrequentPoints:
        """A copy of the map's points that were seen often enough."""
        return frequent_points(self.heatmap.points(), self.frame_count, self.settings)

    def snapshot(self) -> ObjectsTask:
        """What finding the objects needs, copied: it may run beside the fusing of further frames.

        Every task must be run: the keyframes that came since the last one are this one's.
        """
        if self.settings.clustering == "density":
            removed = np.array(self._removed).reshape(-1, 4)
            return partial(
                _found_by_density, self.frequent_points(), removed, self.identities, self.settings, self.frame_count
            )
        return partial(
            _found_by_consensus,
            self.consensus,
            self.consensus.take_waiting(),
            self._T_world_map,
            self._calibration,
            self._corrections,
            self.frame_count,
        )

    def objects(self) -> FoundObjects:
        """The objects as the map now shows them."""
        return self.snapshot()()

    def _keyframe(
        self,
        points: NDArray[np.float32],
        heat: NDArray[np.uint8],
        T_world_camera: NDArray[np.float64],
        noise: DepthNoise,
    ) -> None:
        """Estimate the supporting plane anew, from the planes known here, and remember all (paper, Sec. V-A)."""
        T_camera_world = invert(T_world_camera)
        known = np.array([transform_plane(plane, T_camera_world) for plane in self._candidates]).reshape(-1, 4)
        known = known[known[:, 3] > 0]  # what the camera has passed through faces away
        rng = np.random.default_rng((self.settings.seed, self.frame_count))
        if self.settings.plane_search == "triples":
            planes = planes_by_ransac(points, self.settings, rng)
        else:
            planes = dominant_planes(points, self.settings, rng, known, noise)
        chosen = supporting_plane(planes, points, heat, self.settings, noise)
        self._candidates = np.array([transform_plane(plane, T_world_camera) for plane in planes]).reshape(-1, 4)
        if chosen is None:
            return
        self._supporting = transform_plane(chosen[0], T_world_camera)
        if self.settings.plane_pixels == "keyframe":
            inliers = points[on_plane(chosen[0], points, self.settings, noise)]
            self._inliers = (inliers @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]).astype(np.float32)
        self._removed.append(self._supporting)
        if len(self._removed) > _REMEMBERED:
            self._removed = self._removed[::2]


def _found_by_consensus(
    consensus: ViewConsensus,
    keyframes: list[Keyframe],
    T_world_map: NDArray[np.float64],
    calibration: Calibration,
    corrections: PoseCorrections | None,
    frame_count: int,
) -> FoundObjects:
    """The views' consensus, with the keyframes that came since the last task, in the map of poses as it lies now."""
    R_world_map = T_world_map[:3, :3]
    in_map = None if corrections is None else corrections.seen_from(R_world_map)
    agreed = consensus.update(keyframes, calibration, in_map)
    objects = [replace(item, box=moved(item.box, T_world_map)) for item in agreed.objects]
    return FoundObjects(objects, R_world_map @ agreed.up, frame_count, agreed.left_out, agreed.dropped)


def _found_by_density(
    points: FrequentPoints,
    keyframe_planes: NDArray[np.float64],
    identities: Identities,
    settings: FusionSettings,
    frame_count: int,
) -> FoundObjects:
    """The paper's way over the map's points."""
    found, up, left_out = find_by_density(points, keyframe_planes, settings)
    if len(keyframe_planes) == 0:
        left_out[NO_SUPPORT] = -(-frame_count // settings.keyframe_interval)
    return FoundObjects(identities.assign(found), up, frame_count, +left_out)
