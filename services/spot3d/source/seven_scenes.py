"""Recordings in the layout of Microsoft's 7-Scenes (and 3DMatch, which shares it)."""

import logging
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spot3d.source.calibration import load_calibration
from spot3d.source.errors import SourceError
from spot3d.source.intrinsics_files import FocalAndCentre, intrinsics_for, seven_scenes_values
from spot3d.source.recording import RecordedFrame, Recording, first_readable_shape, with_a_readable_frame
from spot3d.source.text_files import read_pose_matrix, well_formed

log = logging.getLogger(__name__)

RATE_HZ = 30
_LAST = int(np.iinfo(np.int64).max) * RATE_HZ // 10**9
"""The number of the last frame whose time is a timestamp."""
METRES_PER_UNIT = 0.001
INVALID = 65535
_COLOUR_ENDINGS = ("png", "jpg", "jpeg", "PNG", "JPG", "JPEG")
DEPTH_NAME = re.compile(r"frame-(\d+)\.depth\.png")


def is_seven_scenes(folder: Path) -> bool:
    """Whether the folder holds at least one `frame-NNNNNN.depth.png`."""
    return any(DEPTH_NAME.fullmatch(path.name) for path in folder.glob("frame-*.depth.png"))


def open_seven_scenes(folder: Path, intrinsics: FocalAndCentre | None = None) -> Recording:
    """Opens `frame-NNNNNN.{color.png|jpg|jpeg,depth.png,pose.txt}` and `camera-intrinsics.txt`.

    Depth is in mm, 0 and 65535 invalid. Poses and intrinsics are the depth camera's. Frame N has the stamp N / 30 s.
    Colour is registered to depth by `load_calibration`. `intrinsics` (fx, fy, cx, cy) override the file. A frame has no
    true pose if its pose file is missing, holds nan or inf, or is malformed, which is logged. The image size is that of
    the first frame that can be read. Raises SourceError.
    """
    numbered = sorted(
        (int(match[1]), path.name.removesuffix(".depth.png"))
        for path in folder.glob("frame-*.depth.png")
        if (match := DEPTH_NAME.fullmatch(path.name))
    )
    stems = [stem for _, stem in numbered]
    if numbered and numbered[-1][0] > _LAST:
        raise SourceError(
            f"{folder / numbered[-1][1]}.depth.png: frame N is timed at N / {RATE_HZ} s, and this number is too "
            "large; number the frames from 0, or use TUM's layout, which lists timestamps"
        )
    coloured = {path.name.partition(".")[0] for path in folder.glob("frame-*.color.*")}
    if alone := len(coloured.difference(stems)):
        log.warning(
            "%s: %d of %d colour images are left out, as they have no depth image", folder, alone, len(coloured)
        )
    poses = _poses(folder, stems)
    frames = [
        RecordedFrame(
            number * 10**9 // RATE_HZ, _colour_path(folder, stem), folder / f"{stem}.depth.png", poses.get(stem)
        )
        for number, stem in numbered
    ]
    values = intrinsics or seven_scenes_values(folder)
    where = "--intrinsics" if intrinsics else str(folder / "camera-intrinsics.txt")
    camera = intrinsics_for(values, first_readable_shape(frames), where)
    recording = Recording(frames, camera, METRES_PER_UNIT, load_calibration(folder, camera), INVALID)
    return with_a_readable_frame(recording)


def _colour_path(folder: Path, stem: str) -> Path:
    """The frame's colour image, or where it should be."""
    paths = [folder / f"{stem}.color.{ending}" for ending in _COLOUR_ENDINGS]
    return next((path for path in paths if path.is_file()), paths[0])


def _poses(folder: Path, stems: list[str]) -> dict[str, NDArray[np.float64] | None]:
    """T_world_camera (4, 4) of each frame with a pose file. None where tracking was lost."""
    there = [(stem, path) for stem in stems if (path := folder / f"{stem}.pose.txt").is_file()]
    return dict(well_formed(there, lambda pose: (pose[0], read_pose_matrix(pose[1])), f"poses of {folder}"))
