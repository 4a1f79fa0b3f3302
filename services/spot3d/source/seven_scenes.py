"""Recordings in the layout of Microsoft's 7-Scenes (and 3DMatch, which shares it)."""

import re
from pathlib import Path

from spot3d.source.calibration import load_calibration
from spot3d.source.errors import SourceError
from spot3d.source.images import read_depth
from spot3d.source.intrinsics_files import FocalAndCentre, intrinsics_for, seven_scenes_values
from spot3d.source.recording import RecordedFrame, Recording
from spot3d.source.text_files import read_pose_matrix

RATE_HZ = 30
METRES_PER_UNIT = 0.001
INVALID = 65535
DEPTH_NAME = re.compile(r"frame-(\d+)\.depth\.png")


def is_seven_scenes(folder: Path) -> bool:
    """Whether the folder holds at least one `frame-NNNNNN.depth.png`."""
    return any(DEPTH_NAME.fullmatch(path.name) for path in folder.glob("frame-*.depth.png"))


def open_seven_scenes(folder: Path, intrinsics: FocalAndCentre | None = None) -> Recording:
    """Opens `frame-NNNNNN.{color.jpg|color.png,depth.png,pose.txt}` and `camera-intrinsics.txt`.

    Depth is in mm, 0 and 65535 invalid; poses and intrinsics are the depth camera's; frame N has the stamp
    N / 30 s. Colour is registered to depth by `load_calibration`. `intrinsics` (fx, fy, cx, cy) override
    the file. A frame without pose file, or with a pose of nan or inf, has no true pose. Raises SourceError.
    """
    numbered = sorted(
        (int(match[1]), path.name.removesuffix(".depth.png"))
        for path in folder.glob("frame-*.depth.png")
        if (match := DEPTH_NAME.fullmatch(path.name))
    )
    if not numbered:
        raise SourceError(f"{folder} holds no frame-NNNNNN.depth.png; is it a sequence folder of 7-Scenes?")
    frames = []
    for number, stem in numbered:
        pose = folder / f"{stem}.pose.txt"
        frames.append(
            RecordedFrame(
                stamp_ns=number * 10**9 // RATE_HZ,
                colour=_colour_path(folder, stem),
                depth=folder / f"{stem}.depth.png",
                T_world_camera=read_pose_matrix(pose) if pose.is_file() else None,
            )
        )
    values = intrinsics or seven_scenes_values(folder)
    where = "--intrinsics" if intrinsics else str(folder / "camera-intrinsics.txt")
    camera = intrinsics_for(values, read_depth(frames[0].depth).shape, where)
    return Recording(frames, camera, METRES_PER_UNIT, load_calibration(folder, camera), INVALID)


def _colour_path(folder: Path, stem: str) -> Path:
    for suffix in ("color.jpg", "color.png"):
        if (path := folder / f"{stem}.{suffix}").is_file():
            return path
    raise SourceError(f"{folder / stem}.color.jpg (or .png) is missing; each depth image needs its colour image")
