"""A keyframe as fusion keeps it: the segments found in one frame, and that frame's pose."""

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.calibration import NOMINAL, Calibration
from spot3d.camera import Intrinsics, back_project
from spot3d.frame_segments import FrameSegments
from spot3d.fusion.objects.found import STANDS
from spot3d.geometry.standing import stands_on

_STEP = 0.02
"""A depth step of more than this within two pixels leads to another surface, metres: eps_min of the paper."""


@dataclass(frozen=True, slots=True)
class FusedFrame:
    """What is kept of a frame that was fused.

    colour: (h, w, 3) uint8 RGB on fusion's lattice; depth: (h, w) float32 metres, 0 = invalid; camera: of that lattice;
    T_world_camera: (4, 4); T_map_camera: (4, 4), in the map of poses, which moves in the world as its place becomes
    better known. calibration: what depth, camera and poses have been corrected by.
    """

    stamp_ns: int
    colour: NDArray[np.uint8]
    depth: NDArray[np.float32]
    camera: Intrinsics
    T_world_camera: NDArray[np.float64]
    T_map_camera: NDArray[np.float64]
    calibration: Calibration = NOMINAL


@dataclass(frozen=True, slots=True)
class Keyframe:
    """A fused frame with the segments that were found in it alone.

    labels: (h, w) uint8 on the lattice of `depth`, 0 = no object, k = segment k - 1; depth: (h, w) float32 metres, 0 =
    invalid; colour: (h, w, 3) uint8 RGB; camera: of that lattice; T_map_camera: (4, 4) float64, in the map of poses,
    which is the consensus' world: its views must not move against each other. heat, planes (camera frame), stands_on
    and left_out: as in `FrameSegments`. calibration: as in `FusedFrame`.
    """

    stamp_ns: int
    labels: NDArray[np.uint8]
    colour: NDArray[np.uint8]
    depth: NDArray[np.float32]
    camera: Intrinsics
    T_map_camera: NDArray[np.float64]
    heat: NDArray[np.float32]
    planes: NDArray[np.float64]
    stands_on: NDArray[np.int8]
    left_out: dict[str, int] = field(default_factory=dict)
    calibration: Calibration = NOMINAL

    def supports(self) -> NDArray[np.float64]:
        """(k, 4) the planes on which something stands, camera frame, the main one first."""
        return self.planes[np.unique(self.stands_on[self.stands_on >= 0])]


def keyframe_of(frame: FusedFrame, segments: FrameSegments) -> Keyframe:
    """The keyframe of a frame and its segments, on the frame's lattice."""
    seen = segments.seen_by(frame.camera)
    labels = seen.labels
    if segments.camera != frame.camera:
        off = min(np.ceil(frame.camera.fx / segments.camera.fx), max(labels.shape))  # the whole lattice at most
        labels = without_spill(labels, frame.depth, int(off))
    image = labels, frame.colour, frame.depth, frame.camera
    found = seen.heat, seen.planes, seen.stands_on, seen.left_out
    return Keyframe(frame.stamp_ns, *image, frame.T_map_camera, *found, frame.calibration)


def with_support(keyframe: Keyframe, plane: NDArray[np.float64]) -> Keyframe:
    """The keyframe with one plane, (4,) camera frame, facing the camera, as the support of what stands on it.

    For segments whose segmenter gives none: a learned segmenter knows masks, and no planes.
    """
    points = back_project(keyframe.depth, keyframe.camera)
    height = points @ plane[:3] + plane[3]
    labels = np.where(keyframe.depth > 0, keyframe.labels, 0).ravel()
    parts = (np.flatnonzero(labels == number + 1) for number in range(len(keyframe.heat)))
    stand = [stands_on(pixels, height, points, plane[:3], STANDS) for pixels in parts]
    return replace(keyframe, planes=plane[None], stands_on=np.where(stand, 0, -1).astype(np.int8))


def without_spill(labels: NDArray[np.uint8], depth: NDArray[np.float32], width: int) -> NDArray[np.uint8]:
    """Labels without pixels along the outline that lie in front of or behind their own segment.

    labels: (h, w), drawn on another lattice; depth: (h, w) metres; width: pixels that an outline may be off. Such
    pixels lie on the wall behind or on what is in front, and a box would reach for them, however few. A segment without
    an inside stays.
    """
    around, reach = (np.ones((side, side), np.uint8) for side in (2 * width + 1, 4 * width + 1))
    kept = labels.copy()
    for label in np.unique(labels[labels > 0]).tolist():
        x, y, w, h = cv2.boundingRect((labels == label).astype(np.uint8))
        part = np.s_[max(0, y - 1) : y + h + 1, max(0, x - 1) : x + w + 1]
        own, z = labels[part] == label, depth[part]
        inside = (cv2.erode(own.astype(np.uint8), around) > 0) & (z > 0)
        near = cv2.erode(np.where(inside, z, np.float32(np.inf)), reach)
        far = cv2.dilate(np.where(inside, z, np.float32(0)), reach)
        kept[part][own & (far > 0) & ((z < near - _STEP) | (z > far + _STEP))] = 0
    return kept
