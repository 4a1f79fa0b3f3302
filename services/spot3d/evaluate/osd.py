"""The Object Segmentation Database (Richtsfeld et al. 2012), and others in its layout: frames with instance masks."""

from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.evaluate.labelled import LabelledFrame, Readers, mask_boxes
from spot3d.frame import RgbdFrame
from spot3d.source.errors import SourceError
from spot3d.source.images import read_colour, read_depth
from spot3d.source.intrinsics_files import HINT, FocalAndCentre, intrinsics_for, seven_scenes_values

OSD_CAMERA: FocalAndCentre = (525.0, 525.0, 319.5, 239.5)
OSD_SHAPE = (480, 640)
CAMERA_FILE = "camera-intrinsics.txt"
METRES_PER_UNIT = 0.001
# Label 1 is the table.
UNJUDGED, FIRST_OBJECT = 0, 2
# The data set's folder `disparity` holds depth in millimetres as well, despite its name.
DEPTH_FOLDERS = ("depth", "disparity")


def is_osd(folder: Path) -> bool:
    """Whether the folder has the data set's layout, complete or not."""
    return (folder / "image_color").is_dir() or (folder / "annotation").is_dir()


def open_osd(
    folder: Path, every: int = 1, frames: int | None = None, intrinsics: FocalAndCentre | None = None
) -> Readers:
    """Frames with boxes around their instance masks (label 2 and up), every nth, at most `frames`.

    Layout: `image_color/NAME.png`, `annotation/NAME.png`, and `depth/NAME.png` or `disparity/NAME.png`, 16-bit
    millimetres registered with colour. Label 0 is unannotated, 1 the table and everything else that is no object.
    intrinsics: fx, fy, cx, cy; by default those of `camera-intrinsics.txt` (a 3x3 matrix, as in 7-Scenes) if it is
    there, else OSD's own. Raises SourceError for missing or malformed files.
    """
    for needed in ("image_color", "annotation"):
        if not (folder / needed).is_dir():
            raise SourceError(f"{folder} is not a complete OSD: the folder {needed} is missing")
    depth_folder = next((folder / name for name in DEPTH_FOLDERS if (folder / name).is_dir()), None)
    if depth_folder is None:
        raise SourceError(f"{folder} is not a complete OSD: it needs a folder {' or '.join(DEPTH_FOLDERS)}")
    where = "--intrinsics"
    if intrinsics is None and (folder / CAMERA_FILE).is_file():
        intrinsics, where = seven_scenes_values(folder), str(folder / CAMERA_FILE)
    names = sorted((path.name for path in (folder / "image_color").glob("*.png")), key=_natural)[::every][:frames]
    if not names:
        raise SourceError(f"{folder / 'image_color'} contains no PNG files")
    for name in names:
        for inner in (depth_folder, folder / "annotation"):
            if not (inner / name).is_file():
                raise SourceError(f"{inner / name} is missing, but image_color has it")

    def read(index: int) -> LabelledFrame:
        name = names[index]
        annotation = _read_annotation(folder / "annotation" / name)
        colour, depth = read_colour(folder / "image_color" / name), read_depth(depth_folder / name)
        if colour.shape[:2] != depth.shape or annotation.shape != depth.shape:
            raise SourceError(f"size mismatch: {name} differs between image_color, {depth_folder.name} and annotation")
        if intrinsics is None and depth.shape != OSD_SHAPE:
            raise SourceError(
                f"{name} is {depth.shape[1]}x{depth.shape[0]}, and OSD's own intrinsics are for 640x480: write "
                f"{folder / CAMERA_FILE}, or {HINT}"
            )
        camera = intrinsics_for(intrinsics or OSD_CAMERA, depth.shape, where)
        frame = RgbdFrame(index, colour, depth, METRES_PER_UNIT, camera)
        return LabelledFrame(frame, mask_boxes(annotation, FIRST_OBJECT), annotation == UNJUDGED)

    return tuple(partial(read, index) for index in range(len(names)))


def _read_annotation(path: Path) -> NDArray[np.integer]:
    mask = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if mask is None or mask.ndim != 2 or mask.dtype not in (np.uint8, np.uint16):
        raise SourceError(
            f"{path} is not a mask of instances with one channel; save the objects' numbers as grey levels, without a "
            "palette"
        )
    return np.asarray(mask, np.int64)


def _natural(name: str) -> tuple[int, str]:
    """Sort key that puts learn2 before learn10."""
    return len(name), name
