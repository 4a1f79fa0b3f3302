"""Image files as arrays."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from spot3d.source.errors import SourceError
from spot3d.source.images import read_colour, read_depth

SPOTS = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
GREY = np.vstack((SPOTS[:24], np.full((24, 64, 3), 128, np.uint8)))
"""An image whose lower half is what a decoder puts where data is missing."""


def test_an_orientation_in_colour_turns_nothing(tmp_path: Path) -> None:
    image = np.zeros((16, 24, 3), np.uint8)
    image[:, :12] = 255
    _, jpeg = cv2.imencode(".jpg", image)
    # Exif's first directory with one entry: orientation 3, turned by 180 degrees.
    tiff = b"II*\0\x08\0\0\0\x01\0" + b"\x12\x01\x03\0\x01\0\0\0\x03\0\0\0" + b"\0\0\0\0"
    exif = b"Exif\0\0" + tiff
    data = jpeg.tobytes()
    path = tmp_path / "turned.jpg"
    path.write_bytes(data[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + data[2:])
    assert cv2.imread(str(path))[0, 0, 0] < 10, "OpenCV turns it by default"
    assert read_colour(path)[0, 0, 0] > 245


@pytest.mark.parametrize(
    "more",
    [[], [cv2.IMWRITE_JPEG_RST_INTERVAL, 2], [cv2.IMWRITE_JPEG_OPTIMIZE, 1], [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]],
)
def test_a_jpeg_that_was_cut_short_is_refused_though_it_has_an_end_mark(more: list[int], tmp_path: Path) -> None:
    _, jpeg = cv2.imencode(".jpg", SPOTS, more)
    path = tmp_path / "cut.jpg"
    path.write_bytes(jpeg.tobytes())
    assert read_colour(path).shape == (48, 64, 3)
    path.write_bytes(jpeg.tobytes()[: len(jpeg) // 2] + b"\xff\xd9")
    with pytest.raises(SourceError, match=r"cut\.jpg is not a readable image"):
        read_colour(path)


@pytest.mark.parametrize("ending", [".jpg", ".png"])
def test_an_image_that_ends_in_grey_is_whole(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"grey{ending}"
    assert cv2.imwrite(str(path), GREY)
    assert (read_colour(path)[-8:] == 128).all()


def test_depth_that_ends_in_grey_is_whole_whatever_its_data_hold(tmp_path: Path) -> None:
    """With the mark of a JPEG's end in them."""
    path = tmp_path / "depth.png"
    depth = np.full((48, 64), 128, np.uint16)
    depth[:24] = 0xFFD9
    assert cv2.imwrite(str(path), depth, [cv2.IMWRITE_PNG_COMPRESSION, 0])
    assert b"\xff\xd9" in path.read_bytes()
    assert (read_depth(path) == depth).all()
