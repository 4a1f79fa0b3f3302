"""Where the intrinsics come from: an option, a file of the recording, or published values."""

import logging
import re
from pathlib import Path

import numpy as np

from spot3d.camera import Intrinsics, off_centre
from spot3d.source.errors import SourceError
from spot3d.source.text_files import numbers_of, read_text

log = logging.getLogger(__name__)

FocalAndCentre = tuple[float, float, float, float]

# https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats, "Intrinsic Camera Calibration of the
# Kinect".
TUM_PUBLISHED: dict[str, FocalAndCentre] = {
    "1": (517.3, 516.5, 318.6, 255.3),
    "2": (520.9, 521.0, 325.1, 249.7),
    "3": (535.4, 539.2, 320.1, 247.6),
}
_FOCAL_LEAST, _FOCAL_MOST = 0.05, 50.0
"""Focal lengths per image width: fields of view of 169 and of 1 degrees."""
_SKEW_MOST_PX = 0.5
_FORMS = "expected fx fy cx cy, or [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
HINT = "give them as --intrinsics fx,fy,cx,cy (pixels)"


def parse_intrinsics(text: str) -> FocalAndCentre:
    """(fx, fy, cx, cy) in pixels from `fx,fy,cx,cy`, split at commas or spaces. Raises SourceError if malformed."""
    try:
        fx, fy, cx, cy = (float(word) for word in text.replace(",", " ").split())
    except ValueError:
        raise SourceError(f"--intrinsics: {text.strip()!r} is not four numbers; give fx,fy,cx,cy in pixels") from None
    return fx, fy, cx, cy


def seven_scenes_values(folder: Path) -> FocalAndCentre:
    """(fx, fy, cx, cy) of the folder's `camera-intrinsics.txt`, which are the depth camera's.

    Raises SourceError if it is missing or malformed.
    """
    path = folder / "camera-intrinsics.txt"
    if not path.is_file():
        raise SourceError(f"no intrinsics: {path} is missing; {HINT}; 7-Scenes' own are 585,585,320,240")
    return _values_of_file(path)


def tum_values(folder: Path) -> FocalAndCentre:
    """(fx, fy, cx, cy) from `intrinsics.txt`, else TUM's published values.

    `freiburg1..3` (or `fr1..3`) in the folder's name selects the published values. Raises SourceError if neither is
    there or the file is malformed.
    """
    path = folder / "intrinsics.txt"
    if path.is_file():
        return _values_of_file(path)
    match = re.search(r"(?:freiburg|(?<![a-z])fr)([123])(?!\d)", folder.resolve().name.lower())
    if match is None:
        raise SourceError(
            f"no intrinsics: {path} is missing, and the folder name {folder.resolve().name!r} does not contain a TUM "
            f"camera (freiburg1, 2 or 3); {HINT}"
        )
    return TUM_PUBLISHED[match[1]]


def _values_of_file(path: Path) -> FocalAndCentre:
    """(fx, fy, cx, cy) of a file with these four numbers, or with a 3x3 matrix. `#` starts a comment.

    Raises SourceError if it is missing or holds anything else.
    """
    text = " ".join(line.split("#")[0] for line in read_text(path).splitlines())
    values = numbers_of(text, path, _FORMS)
    if values.size == 4:
        fx, fy, cx, cy = values.tolist()
        return fx, fy, cx, cy
    if values.size != 9:
        raise SourceError(f"{path} is malformed: it has {values.size} numbers; {_FORMS}")
    (fx, skew, cx), (zero, fy, cy), last = values.reshape(3, 3).tolist()
    if not (np.allclose(last, [0, 0, 1]) and zero == 0 and abs(skew) <= _SKEW_MOST_PX):
        raise SourceError(f"{path} is malformed: {_FORMS}")
    return fx, fy, cx, cy


def intrinsics_for(values: FocalAndCentre, shape: tuple[int, int], where: str) -> Intrinsics:
    """Intrinsics for an image of `shape` (h, w). Raises SourceError if they cannot belong to that size."""
    fx, fy, cx, cy = values
    height, width = shape
    try:
        intrinsics = Intrinsics(fx, fy, cx, cy, width, height)
    except ValueError as error:
        raise SourceError(f"{where}: {error}") from error
    if not all(_FOCAL_LEAST < focal / width < _FOCAL_MOST for focal in (fx, fy)):
        raise SourceError(
            f"{where}: focal lengths of {fx:g} and {fy:g} pixels are implausible for images of {width}x{height} "
            "pixels; give them in pixels"
        )
    if not (0 <= cx < width and 0 <= cy < height):
        raise SourceError(
            f"{where}: the principal point ({cx:g}, {cy:g}) is outside the {width}x{height} image; give the "
            "intrinsics of images of this size"
        )
    if doubt := off_centre(intrinsics):
        log.warning("%s: %s; otherwise all boxes are distorted", where, doubt)
    return intrinsics
