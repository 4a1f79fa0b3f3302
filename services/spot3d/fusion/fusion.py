"""The fusion stage's core: frames with heat and pose in, 3D objects with stable numbers out (paper, Sec. V)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import moved
from spot3d.calibration import NOMINAL, Calibration
from spot3d.camera import Intrinsics, invert
from spot3d.camera_pose import CameraPose
from spot3d.found_object import FoundObjects
from spot3d.frame_segments import NO_SUPPORT, FrameSegments
from spot3d.fusion.map.changes import ChangeLog
from spot3d.fusion.map.heatmap3d import Heatmap3D
from spot3d.fusion.map.index_map import IndexMap, MatchCounts
from spot3d.fusion.map.selection import FrequentPoints, frequent_points
from spot3d.fusion.objects.consensus import ViewConsensus
from spot3d.fusion.objects.identity import Identities
from spot3d.fusion.objects.keyframes import FusedFrame, Keyframe, keyframe_of, with_support
from spot3d.fusion.paper.density import find_by_density
from spot3d.fusion.pose_frame import PoseFrame
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.supporting_plane import SupportingPlane
from spot3d.fusion.supports import RecentSupports
from spot3d.geometry.downsampling import to_lattice
from spot3d.geometry.planes import transform_plane
from spot3d.pose_corrections import PoseCorrections

_AWAITING_SEGMENTS = 60
"""Fused frames kept for their segments: a learned segmenter may take two seconds of a camera; 0.5 MB each."""


@dataclass(frozen=True, slots=True)
class MapState:
    """A map that another fusion can resume from.

    rows: (n, 16) float32 points and keys: (n,) int64, their voxels' (see `Heatmap3D.held`); removed, candidates,
    supporting: of `SupportingPlane`; poses: as of the last frame; calibration: of keyframes; calibrated_by: its
    provider.
    """

    rows: NDArray[np.float32]
    keys: NDArray[np.int64]
    evicted: int
    frame_count: int
    removed: NDArray[np.float64]
    candidates: NDArray[np.float64]
    supporting: NDArray[np.float64] | None
    poses: PoseFrame
    calibration: Calibration
    calibrated_by: str | None


ObjectsTask = Callable[[], FoundObjects]
"""Finds the objects of one moment; numbers continue from the tasks run before. Tasks run one at a time, in the order of
their snapshots."""


class Fusion:
    """Fuses frames into the 3D heatmap and finds the objects in it."""

    def __init__(self, settings: FusionSettings) -> None:
        self.settings = settings
        self.heatmap = Heatmap3D(settings.map_limit, settings.voxel)
        self.map_changes = ChangeLog(settings.map_limit)
        self._begin()

    def reset(self) -> None:
        """Forget everything; object numbers restart."""
        self.heatmap.clear()
        self.map_changes.clear()
        self._begin()

    def _begin(self) -> None:
        """Set the state of an empty map."""
        self.frame_count = 0
        self.supports = RecentSupports()
        self.consensus = ViewConsensus(self.settings)
        self.identities = Identities()
        self._fused: dict[int, FusedFrame] = {}  # by stamp, in the order in which they were fused
        self._index_map = IndexMap(self.settings)
        self._supporting = SupportingPlane(self.settings)
        self._poses = PoseFrame()
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
            removed=np.array(self._supporting.removed).reshape(-1, 4),
            candidates=self._supporting.candidates,
            supporting=self._supporting.plane,
            poses=self._poses,
            calibration=self._calibration,
            calibrated_by=self._calibrated_by,
        )

    def resume(self, state: MapState, consensus: ViewConsensus, identities: Identities) -> None:
        """Resume from another fusion's map and its objects."""
        self.reset()
        self.heatmap.restore(state.rows, state.keys)
        self.heatmap.evicted, self.frame_count = state.evicted, state.frame_count
        self._supporting.resume(state.supporting, state.candidates, state.removed)
        self._poses = state.poses
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
        """Take in one frame: estimate the supporting plane, remove it from the heat, register the frame with the map.

        colour: (h, w, 3) uint8 RGB; depth: (h, w) float32 metres, 0 = invalid; heat: (h, w) uint8, 255ths. stamp_ns: by
        which `observe` finds the frame for a while; None: it cannot.
        """
        T_world_camera = pose.T_world_camera.copy()
        if pose.calibration != NOMINAL or pose.given_by == self._calibrated_by:
            # A new provider of poses lacks the calibration at first; the one that gave it may revoke it.
            self._calibration, self._calibrated_by = pose.calibration, pose.given_by
        if pose.corrections is not None or pose.given_by != self._poses.given_by:
            # One provider's corrections say nothing of another's poses, whose frames come later.
            self._corrections = pose.corrections
        known = replace(self._calibration, turn=pose.calibration.turn)
        depth = known.metres(depth)
        frame = to_lattice(colour, depth, heat, camera, self.settings.lattice_width, self.settings.grazing_cos)
        frame = replace(frame, camera=known.camera(frame.camera))
        warm = self._supporting.remaining_heat(frame, T_world_camera, self.frame_count)
        self._poses = self._poses.followed(pose.T_world_map, pose.given_by, begun=self.frame_count > 0)
        self.frame_count += 1
        # The images are kept until the next frame, and longer with a stamp; at full size they may be the caller's own.
        theirs = np.may_share_memory(frame.colour, colour) or np.may_share_memory(frame.depth, depth)
        seen = (frame.colour.copy(), frame.depth.copy()) if theirs else (frame.colour, frame.depth)
        if stamp_ns is not None:
            T_map_camera = invert(self._poses.T_world_map) @ T_world_camera
            self._fused.pop(stamp_ns, None)
            self._fused[stamp_ns] = FusedFrame(stamp_ns, *seen, frame.camera, T_world_camera, T_map_camera, known)
            if len(self._fused) > _AWAITING_SEGMENTS:
                del self._fused[next(iter(self._fused))]
        return self._index_map.register(self.heatmap, self.frame_count, *seen, warm, frame.camera, T_world_camera)

    def observe(self, segments: FrameSegments, stamp_ns: int) -> bool:
        """Take in the segments of a frame that was fused with this stamp.

        Segments without planes are placed on the supporting plane known here, if they stand on it. Returns False, and
        does nothing, if the frame is not among the last 60 without an answer: observed, forgotten, or too old.
        """
        frame = self._fused.pop(stamp_ns, None)
        if frame is None:
            return False
        keyframe = keyframe_of(frame, segments.calibrated(frame.calibration))
        plane = self._supporting.seen_from(frame.T_world_camera)
        if len(segments) and not len(segments.planes) and plane is not None:
            keyframe = with_support(keyframe, plane)
        if self.settings.clustering == "consensus":
            self.consensus.add(keyframe)
        for plane in keyframe.supports()[::-1]:
            self.supports.add(transform_plane(plane, frame.T_world_camera), frame.T_world_camera[:3, 3])
        return True

    def forget(self, stamp_ns: int) -> None:
        """Keep no images of the frame that was fused with this stamp: it is no keyframe, and no segments will come."""
        self._fused.pop(stamp_ns, None)

    def frequent_points(self) -> FrequentPoints:
        """A copy of the map's points that were seen often enough."""
        return frequent_points(self.heatmap.points(), self.frame_count, self.settings)

    def snapshot(self, lasting: bool = False) -> ObjectsTask:
        """A task that finds the objects, with copies of what it needs: it may run while frames are fused.

        lasting: objects of the views' consensus that no task before found wait for the next one.
        Every task must be run: it takes over the keyframes that came since the last one.
        """
        if self.settings.clustering == "density":
            removed = np.array(self._supporting.removed).reshape(-1, 4)
            return partial(
                _found_by_density, self.frequent_points(), removed, self.identities, self.settings, self.frame_count
            )
        return partial(
            _found_by_consensus,
            self.consensus,
            self.consensus.take_waiting(),
            self._poses.T_world_map,
            self._calibration,
            self._corrections,
            self.frame_count,
            lasting,
        )

    def objects(self, lasting: bool = False) -> FoundObjects:
        """The objects in the map as it is now; lasting: see `snapshot`."""
        return self.snapshot(lasting)()


def _found_by_consensus(
    consensus: ViewConsensus,
    keyframes: list[Keyframe],
    T_world_map: NDArray[np.float64],
    calibration: Calibration,
    corrections: PoseCorrections | None,
    frame_count: int,
    lasting: bool,
) -> FoundObjects:
    """The objects of the views' consensus, with the keyframes since the last task, at the map's present pose."""
    R_world_map = T_world_map[:3, :3]
    in_map = None if corrections is None else corrections.seen_from(R_world_map)
    agreed = consensus.update(keyframes, calibration, in_map, lasting)
    objects = [replace(item, box=moved(item.box, T_world_map)) for item in agreed.objects]
    return replace(agreed, objects=objects, up=R_world_map @ agreed.up, frame_count=frame_count)


def _found_by_density(
    points: FrequentPoints,
    keyframe_planes: NDArray[np.float64],
    identities: Identities,
    settings: FusionSettings,
    frame_count: int,
) -> FoundObjects:
    """The paper's objects, from the map's points."""
    found, up, left_out = find_by_density(points, keyframe_planes, settings)
    if len(keyframe_planes) == 0:
        left_out[NO_SUPPORT] = -(-frame_count // settings.keyframe_interval)
    return FoundObjects(identities.assign(found), up, frame_count, +left_out)
