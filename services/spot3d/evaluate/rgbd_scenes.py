"""RGB-D Scenes Dataset of 2011 (Lai et al., ICRA 2011): single frames with true 2D boxes."""

import re
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.evaluate.labelled import LabelledFrame, Readers
from spot3d.frame import RgbdFrame
from spot3d.source.errors import SourceError
from spot3d.source.images import read_colour, read_depth

FOCAL, CENTRE = 570.3, (320.0, 240.0)
METRES_PER_UNIT = 0.001
SIDES = ("left", "top", "right", "bottom")


def is_rgbd_scenes(folder: Path) -> bool:
    """Whether the folder is a sequence of the data set (`NAME/NAME_1_depth.png`), or holds one up to two below."""
    return next(iter(_depth_images(folder)), None) is not None


def open_rgbd_scenes(folder: Path, every: int = 1, frames: int | None = None) -> Readers:
    """Frames with their annotated boxes, every nth of each sequence, at most `frames` of each.

    Layout, as unpacked: `desk/desk_1/desk_1_N.png` and `desk_1_N_depth.png`, and beside the folder `desk/desk_1.mat`.
    Its `bboxes` is a 1 x frames cell array of struct arrays with category, instance, top, bottom, left and right, in
    pixels that count from 1. Depth is in millimetres, colour registered. Focal length 570.3 and centre (320, 240) are
    those of the data set's own depthToCloud.m. Frames count from 1, as the boxes do. Raises SourceError for missing
    files.
    """
    sequences = sorted({path.parent for path in _depth_images(folder)})
    if not sequences:
        raise SourceError(f"{folder} contains no frames of RGB-D Scenes 2011 (NAME/NAME_1_depth.png)")
    entries: list[tuple[Path, int, NDArray[np.float64]]] = []
    for sequence in sequences:
        boxes = _read_boxes(sequence.parent / f"{sequence.name}.mat")
        for number in range(1, len(boxes) + 1)[::every][:frames]:
            if not (sequence / f"{sequence.name}_{number}.png").is_file():
                raise SourceError(f"{sequence / f'{sequence.name}_{number}.png'} is missing, but it has true boxes")
            entries.append((sequence, number, boxes[number - 1]))

    def read(index: int) -> LabelledFrame:
        sequence, number, boxes = entries[index]
        stem = f"{sequence.name}_{number}"
        colour, depth = read_colour(sequence / f"{stem}.png"), read_depth(sequence / f"{stem}_depth.png")
        if colour.shape[:2] != depth.shape:
            raise SourceError(f"size mismatch: {sequence / stem} differs between colour and depth")
        camera = Intrinsics(FOCAL, FOCAL, *CENTRE, depth.shape[1], depth.shape[0])
        return LabelledFrame(RgbdFrame(index, colour, depth, METRES_PER_UNIT, camera), boxes)

    return tuple(partial(read, index) for index in range(len(entries)))


def _depth_images(folder: Path) -> list[Path]:
    """The first depth image of each sequence: in this folder, or up to two folders below."""
    found = [path for pattern in ("", "*/", "*/*/") for path in folder.glob(f"{pattern}*_1_depth.png")]
    return [path for path in found if re.fullmatch(rf"{re.escape(path.parent.name)}_1_depth\.png", path.name)]


def _read_boxes(path: Path) -> list[NDArray[np.float64]]:
    """(n, 4) [x, y, w, h] of each frame, with pixels counted from 0."""
    if not path.is_file():
        raise SourceError(f"{path} is missing: it holds the true boxes of the frames in {path.with_suffix('')}")
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        cells = loadmat(path, squeeze_me=False, struct_as_record=True)["bboxes"].ravel()
    except (KeyError, MatReadError, NotImplementedError, TypeError, ValueError) as error:
        raise SourceError(f"{path} is not a MATLAB file with bboxes: {error}") from error
    return [_boxes_of(path, cell) for cell in cells]


def _boxes_of(path: Path, cell: NDArray[Any]) -> NDArray[np.float64]:
    if cell.size == 0:
        return np.zeros((0, 4))
    missing = [name for name in SIDES if name not in (cell.dtype.names or ())]
    if missing:
        raise SourceError(f"{path}: a box lacks {', '.join(missing)}")
    rows = [[float(np.asarray(item[name]).item()) for name in SIDES] for item in cell.ravel()]
    left, top, right, bottom = np.array(rows).T
    return np.stack((left - 1, top - 1, right - left + 1, bottom - top + 1), axis=1)
