"""The objects of successive keyframes, found with the help of the frames before each."""

import numpy as np
from numpy.typing import NDArray

from spot3d.calibration import NOMINAL, Calibration
from spot3d.frame import RgbdFrame
from spot3d.frame_segments import FrameSegments
from spot3d.geometry.downsampling import to_lattice
from spot3d.segments.finder import candidate_planes, find_on_lattice
from spot3d.segments.keyframes import Keyframes
from spot3d.segments.recent_depth import RecentDepth
from spot3d.segments.settings import SegmentsSettings
from spot3d.segments.supports import clearly_faces
from spot3d.segments.up_direction import UpDirection
from spot3d.segments.upper_side import UpperSide


class KeyframeSegments:
    """Finds the objects of keyframes; remembers the depth of recent frames, and from keyframes which way is up.

    For every frame with a pose, in order, call `wants`, and `find` if that returns True.
    """

    def __init__(self, settings: SegmentsSettings) -> None:
        self._settings = settings
        self._upper_side = UpperSide(settings.image_up)
        self._is_keyframe = False
        self._begin(None)

    def _begin(self, world: str | None) -> None:
        self._world = world
        self._keyframes, self._recent = Keyframes(self._settings), RecentDepth(self._settings)
        self._up_direction = UpDirection()

    @property
    def side_up(self) -> str:
        """The side of the image that seems to be up though `image_up` names another; empty where none does."""
        return self._upper_side.found

    def wants(self, stamp_ns: int, T_world_camera: NDArray[np.float64], world: str | None = None) -> bool:
        """Whether `find` needs the images of the frame with this timestamp and (4, 4) pose.

        world: name of the pose's world frame. When it changes, earlier frames and keyframes are forgotten.
        """
        if world != self._world:
            self._begin(world)
        self._is_keyframe = self._keyframes.is_keyframe(stamp_ns, T_world_camera)
        return self._is_keyframe or (self._settings.enabled and self._recent.wants(stamp_ns))

    def find(
        self,
        frame: RgbdFrame,
        heat: NDArray[np.uint8],
        T_world_camera: NDArray[np.float64],
        calibration: Calibration = NOMINAL,
    ) -> FrameSegments | None:
        """The objects of a frame for which `wants` was True; None if it is no keyframe.

        heat: (h, w) uint8, 255ths; T_world_camera: (4, 4) float64; calibration: makes the frame agree with the poses.
        The bend of depth is removed; lengths stay in the unit of depth as it was measured.
        """
        settings, found = self._settings, None
        if self._is_keyframe:
            size, grazing_cos = settings.lattice_width, settings.grazing_cos
            depth = calibration.straightened(frame.depth_metres())
            lattice = to_lattice(frame.colour, depth, heat, frame.intrinsics, size, grazing_cos)
            filled = self._recent.filled(lattice, T_world_camera, frame.stamp_ns, calibration.depth_factor)
            candidates, up = candidate_planes(filled, settings), self._up_direction.in_camera(T_world_camera)
            found = find_on_lattice(filled, candidates, settings, up)
            self._upper_side.learn(candidates.planes, candidates.heat, up)
            if clearly_faces(found.planes, settings.image_up):
                self._up_direction.learn(T_world_camera[:3, :3] @ found.planes[0, :3])
        if self._recent.wants(frame.stamp_ns):
            self._recent.remember(frame, heat, T_world_camera, calibration)
        return found
