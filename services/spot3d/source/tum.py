"""Recordings in the layout of the TUM RGB-D benchmark."""

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spot3d.source.calibration import load_calibration
from spot3d.source.errors import SourceError
from spot3d.source.intrinsics_files import FocalAndCentre, intrinsics_for, tum_values
from spot3d.source.motion import CHECK_POSES, Motion, Pose
from spot3d.source.recording import RecordedFrame, Recording, first_readable_shape, with_a_readable_frame
from spot3d.source.text_files import pose_of_words, read_stamped_lines

log = logging.getLogger(__name__)

METRES_PER_UNIT = 1 / 5000
# The benchmark's own associate.py allows the same difference.
MAX_DIFFERENCE_NS = 20_000_000


def is_tum(folder: Path) -> bool:
    """Whether the folder holds `depth.txt` or `rgb.txt`."""
    return (folder / "depth.txt").is_file() or (folder / "rgb.txt").is_file()


def open_tum(folder: Path, intrinsics: FocalAndCentre | None = None) -> Recording:
    """Opens `rgb.txt`, `depth.txt` and, where there is one, `groundtruth.txt` (`stamp tx ty tz qx qy qz qw`).

    Each depth image is paired with the colour image nearest in time, up to 20 ms off, and with the pose at its time
    (see `_poses_at`). A depth image without colour is skipped, one without pose has no true pose. Stamps are the depth
    images'. Depth is 5000 per metre.
    In the published data colour is registered and lens distortion small, so neither is corrected; `calibration.json`
    states where other colour lies (see `load_calibration`). `intrinsics` (fx, fy, cx, cy) override `intrinsics.txt` and
    the published values. Malformed lines are skipped and logged. The image size is that of the first frame that can be
    read. Raises SourceError.
    """

    def file(words: list[str], _where: str) -> Path:
        spaced = folder / " ".join(words)
        return spaced if len(words) > 1 and spaced.is_file() else folder / words[0]

    depths = read_stamped_lines(folder / "depth.txt", file)
    colours = read_stamped_lines(folder / "rgb.txt", file)
    for name, listed in (("depth.txt", depths), ("rgb.txt", colours)):
        if not listed:
            raise SourceError(f"{folder / name} lists no images; is the recording complete?")
    truth_path = folder / "groundtruth.txt"
    truth = read_stamped_lines(truth_path, pose_of_words) if truth_path.is_file() else []
    stamps = np.array([stamp for stamp, _ in depths], np.int64)
    with_colour = nearest_in_time(stamps, np.array([stamp for stamp, _ in colours], np.int64))
    poses = _poses_at(stamps, truth)
    frames = [
        RecordedFrame(stamp_ns, colours[c][1], depth, pose)
        for (stamp_ns, depth), c, pose in zip(depths, with_colour, poses, strict=True)
        if c >= 0
    ]
    if not frames:
        raise SourceError(
            f"{folder}: no depth image has a colour image within 20 ms; check that depth.txt and rgb.txt use the "
            "same clock"
        )
    if len(frames) < len(depths):
        alone, told = len(depths) - len(frames), "are left out, as they have no colour image within 20 ms"
        log.warning("%s: %d of %d depth images %s", folder, alone, len(depths), told)
    without_pose = sum(pose is None for pose in poses)
    if truth and without_pose:
        log.warning(
            "%s: %d of %d depth images have no pose at their time; %s",
            truth_path,
            without_pose,
            len(depths),
            CHECK_POSES,
        )
    where = "--intrinsics" if intrinsics else str(folder / "intrinsics.txt")
    camera = intrinsics_for(intrinsics or tum_values(folder), first_readable_shape(frames), where)
    return with_a_readable_frame(Recording(frames, camera, METRES_PER_UNIT, load_calibration(folder, None)))


def _poses_at(stamps_ns: NDArray[np.int64], truth: list[tuple[int, Pose]]) -> list[Pose | None]:
    """The pose (4, 4) at each stamp: interpolated, or the nearest one up to 20 ms off at an end or in a gap.

    A body that is carried moves by a centimetre in 20 ms, as far as its poses are true.
    """
    motion = Motion(truth)
    nearest = nearest_in_time(stamps_ns, np.array([stamp for stamp, _ in truth], np.int64))
    poses = []
    for stamp_ns, row in zip(stamps_ns.tolist(), nearest.tolist(), strict=True):
        between = motion.at(stamp_ns)
        poses.append(truth[row][1] if between is None and row >= 0 else between)
    return poses


def nearest_in_time(stamps_ns: NDArray[np.int64], others_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Index (n,) int64 of the nearest of `others_ns` (m,), sorted, for each stamp. -1 if it is over 20 ms off."""
    if not others_ns.size:
        return np.full(stamps_ns.shape, -1, np.int64)
    right = np.clip(np.searchsorted(others_ns, stamps_ns), 0, others_ns.size - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(np.abs(others_ns[left] - stamps_ns) <= np.abs(others_ns[right] - stamps_ns), left, right)
    return np.where(np.abs(others_ns[nearest] - stamps_ns) <= MAX_DIFFERENCE_NS, nearest, -1)
