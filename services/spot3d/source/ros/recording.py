"""A bag as a sequence of frames: colour is paired with depth by stamp, and registered where it is not yet."""

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame
from spot3d.source.calibration import ColourCamera
from spot3d.source.errors import SourceError
from spot3d.source.intrinsics_files import HINT, FocalAndCentre, intrinsics_for
from spot3d.source.motion import CHECK_POSES
from spot3d.source.recording import of_first_readable
from spot3d.source.ros.bag import Bag, BagTopic
from spot3d.source.ros.images import MILLIMETRES, colour_image, depth_image
from spot3d.source.ros.poses import PoseAt, poses_of, transform_tree
from spot3d.source.ros.topics import CameraTopics, TopicNames, find_topics
from spot3d.source.sequence import FrameSequence
from spot3d.source.tum import nearest_in_time

log = logging.getLogger(__name__)

_SAME_PX = 0.5
"""Largest difference between the intrinsics of registered images, due to rounding."""
_BENT = 0.05
"""Distortion coefficients beyond this distort an image by pixels."""


@dataclass(frozen=True, slots=True)
class _Camera:
    """Frame in /tf of an image topic, empty if unknown, and its intrinsics, None without a valid camera_info."""

    frame: str
    intrinsics: Intrinsics | None


def open_bag(path: Path, names: TopicNames, intrinsics: FocalAndCentre | None = None) -> "BagRecording":
    """Opens a bag. intrinsics: the depth camera's (fx, fy, cx, cy), instead of its camera_info.

    One pass through the bag reads the stamps. Images are read on access. Raises SourceError.
    """
    bag = Bag(path)
    topics = find_topics(bag.types, names)
    images = bag.stamps(topics.colour, topics.depth)
    colours, depths = images[topics.colour], images[topics.depth]
    rows, of_depth, of_colour = _paired(depths.stamps_ns, colours.stamps_ns)
    if not len(rows):
        raise SourceError(
            f"{path}: none of {len(depths)} images of {topics.depth} is within 20 ms of one of the {len(colours)} of "
            f"{topics.colour}; check that both use the same clock, or choose others with --depth-topic and "
            "--colour-topic"
        )
    if len(rows) < len(depths):
        alone, text = len(depths) - len(rows), "are left out: no colour image within 20 ms, or a duplicate timestamp"
        log.warning("%s: %d of %d depth images %s", path, alone, len(depths), text)
    needed = intrinsics is None
    depth_camera, colour_camera = (_camera(bag, topic, needed) for topic in (topics.depth_info, topics.colour_info))
    stated = None if intrinsics is not None else depth_camera.intrinsics
    shape, *frames = _first_readable(depths, colours, of_depth, of_colour, stated)
    depth_camera = replace(depth_camera, frame=frames[0] or depth_camera.frame)
    colour_camera = replace(colour_camera, frame=frames[1] or colour_camera.frame)
    if intrinsics is not None:
        camera = intrinsics_for(intrinsics, shape, "--intrinsics")
    elif stated is not None:
        camera = stated
    else:
        raise SourceError(f"{path}: there is no camera_info with intrinsics beside {topics.depth}; {HINT}")
    pose_at = poses_of(bag, names.pose, depth_camera.frame) if names.pose else None
    without_pose = 0 if pose_at is None else sum(pose_at(int(stamp_ns)) is None for stamp_ns in rows)
    if without_pose == len(rows):
        raise SourceError(f"{path}: {names.pose} has no pose at the time of any frame; {CHECK_POSES}")
    if without_pose:
        text = "depth images have no pose at their time"
        log.warning("%s: %d of %d %s; %s", names.pose, without_pose, len(rows), text, CHECK_POSES)
    return BagRecording(
        depths=depths,
        colours=colours,
        rows=np.column_stack((rows, of_depth, of_colour)),
        intrinsics=camera,
        colour_camera=_unregistered(bag, topics, camera, depth_camera, colour_camera),
        pose_at=pose_at,
    )


@dataclass(eq=False)
class BagRecording(FrameSequence):
    """A sequence of RgbdFrame in the depth camera's geometry. Images are read on access.

    rows: (n, 3) int64, a frame's stamp in ns (its depth image's), and the indices of its depth and its colour image.
    colour_camera: the calibration to register colour with, or None if it is registered already.
    """

    depths: BagTopic
    colours: BagTopic
    rows: NDArray[np.int64]
    intrinsics: Intrinsics
    colour_camera: ColourCamera | None
    pose_at: PoseAt | None

    def __post_init__(self) -> None:
        self.stamps_ns = self.rows[:, 0].tolist()
        self._registration = None
        if self.colour_camera is not None:
            from spot3d.source.colour_registration import ColourRegistration  # numba takes a second to import

            self._registration = ColourRegistration(self.intrinsics, self.colour_camera)

    @property
    def has_true_poses(self) -> bool:
        """Whether poses are taken from the bag."""
        return self.pose_at is not None

    def true_pose(self, index: int) -> NDArray[np.float64] | None:
        return None if self.pose_at is None else self.pose_at(self.stamps_ns[index])

    def __getitem__(self, index: int) -> RgbdFrame:
        """Reads one frame. Raises SourceError if it cannot be read, or an image's size is not the intrinsics'."""
        stamp_ns, of_depth, of_colour = (int(value) for value in self.rows[index])
        depth, colour = depth_image(self.depths[of_depth]), colour_image(self.colours[of_colour])
        scale = MILLIMETRES if depth.dtype == np.uint16 else 1.0
        if self._registration is not None:
            colour = self._registration.register(colour, depth.astype(np.float32) * np.float32(scale))
        try:
            return RgbdFrame(stamp_ns, colour, depth, scale, self.intrinsics, self.true_pose(index))
        except ValueError as error:
            raise SourceError(f"{self.depths.name}, image {of_depth}: {error}") from error


def _paired(
    depth_ns: NDArray[np.int64], colour_ns: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Stamps of the frames, ascending, and the indices of each one's depth image and nearest colour image."""
    stamps, of_depth = np.unique(depth_ns, return_index=True)
    order = np.argsort(colour_ns, kind="stable")
    nearest = nearest_in_time(stamps, colour_ns[order])
    has_colour = nearest >= 0
    return stamps[has_colour], of_depth[has_colour], order[nearest[has_colour]]


def _first_readable(
    depths: BagTopic,
    colours: BagTopic,
    of_depth: NDArray[np.int64],
    of_colour: NDArray[np.int64],
    stated: Intrinsics | None,
) -> tuple[tuple[int, int], str, str]:
    """Shape (h, w) of depth in the first frame with readable images, and the frames in /tf of its depth and its colour.

    stated: intrinsics from depth's camera_info, whose size depth must have. Raises SourceError if no frame is readable.
    """

    def read(pair: tuple[int, int]) -> tuple[tuple[int, int], str, str]:
        depth, colour = depths[pair[0]], colours[pair[1]]
        colour_image(colour)
        height, width = depth_image(depth).shape
        if stated is not None and (height, width) != stated.shape:
            size = f"{stated.width}x{stated.height}"
            raise SourceError(f"{depths.name} is {width}x{height}, but its camera_info is for {size}; {HINT}")
        return (height, width), depth.header.frame_id, colour.header.frame_id

    pairs = list(zip(of_depth.tolist(), of_colour.tolist(), strict=True))
    return of_first_readable(pairs, read, f"image pairs of {depths.name} and {colours.name} can be read")


def _camera(bag: Bag, info_topic: str | None, needed: bool) -> _Camera:
    """Frame and intrinsics from the first camera_info with valid ones.

    If all are invalid, raises SourceError where they are needed, and has none elsewhere.
    """
    frame, refused = "", None
    for _, _, info in bag.messages(info_topic) if info_topic else ():
        frame = frame or info.header.frame_id
        try:
            return _Camera(info.header.frame_id, _intrinsics(str(info_topic), info))
        except SourceError as error:
            refused = refused or error
    if refused is not None and needed:
        raise refused
    return _Camera(frame, None)


def _intrinsics(info_topic: str, info: Any) -> Intrinsics:
    """Intrinsics from a camera_info. Raises SourceError if they are invalid."""
    # ROS 1 names the matrices in capitals.
    k = np.asarray(info.k if hasattr(info, "k") else info.K, np.float64)
    coefficients = np.asarray(info.d if hasattr(info, "d") else info.D, np.float64)
    if "rect" not in info_topic and np.abs(coefficients).max(initial=0) > _BENT:
        log.warning("%s: the images have lens distortion, which is ignored; use rectified images", info_topic)
    fx, fy, cx, cy = (float(k[place]) for place in (0, 4, 2, 5))
    try:
        return intrinsics_for((fx, fy, cx, cy), (info.height, info.width), info_topic)
    except SourceError as error:
        raise SourceError(f"{error}; calibrate the camera, or {HINT}") from error


def _unregistered(
    bag: Bag, topics: CameraTopics, camera: Intrinsics, depth: _Camera, colour: _Camera
) -> ColourCamera | None:
    """The colour camera relative to depth, or None if colour is registered with depth."""
    same_frame = depth.frame.removeprefix("/") == colour.frame.removeprefix("/")
    if colour.intrinsics is None:
        if same_frame:
            return None
        raise SourceError(
            f"{bag.path}: {topics.colour} is not registered with depth, and has no valid camera_info; record one, or "
            "depth registered with colour"
        )
    if same_frame:
        return None if _same_pixels(camera, colour.intrinsics) else ColourCamera(colour.intrinsics, np.eye(4))
    T_colour_depth = transform_tree(bag, dynamic=False).fixed_between(colour.frame, depth.frame)
    if T_colour_depth is None:
        raise SourceError(
            f"{bag.path}: {topics.depth} ({depth.frame}) is not registered with {topics.colour} ({colour.frame}), "
            "and /tf_static does not connect the two frames; record it as well, or depth registered with colour"
        )
    return ColourCamera(colour.intrinsics, T_colour_depth)


def _same_pixels(one: Intrinsics, other: Intrinsics) -> bool:
    apart = np.array((one.fx, one.fy, one.cx, one.cy)) - (other.fx, other.fy, other.cx, other.cy)
    return one.shape == other.shape and bool(np.abs(apart).max() <= _SAME_PX)
