"""Image files as arrays."""

from pathlib import Path

import cv2
import numpy as np

from spot3d.source.images import read_colour


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
