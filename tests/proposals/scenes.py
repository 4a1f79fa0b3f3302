"""Made-up RGB-D frames for the proposals stage's tests."""

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics

WALL = 2.0  # metres


def camera(width: int = 320, height: int = 240) -> Intrinsics:
    """A Kinect's field of view at the given size."""
    return Intrinsics(width * 0.82, width * 0.82, width / 2, height / 2, width, height)


def squares(
    *boxes: tuple[int, int, int, int], shape: tuple[int, int] = (240, 320), depth: float = 1.2
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Grey wall at WALL metres with flat grey boxes (x, y, w, h) in front of it."""
    colour, z = np.full((*shape, 3), 128, np.uint8), np.full(shape, WALL, np.float32)
    for x, y, w, h in boxes:
        colour[y : y + h, x : x + w] = 160
        z[y : y + h, x : x + w] = depth
    return colour, z


def overlaps(boxes: NDArray[np.float32], box: tuple[int, int, int, int]) -> NDArray[np.float32]:
    """IoU (n,) of boxes (n, 5) with one box (x, y, w, h)."""
    x, y, w, h = box
    across = np.minimum(boxes[:, 0] + boxes[:, 2], x + w) - np.maximum(boxes[:, 0], x)
    down = np.minimum(boxes[:, 1] + boxes[:, 3], y + h) - np.maximum(boxes[:, 1], y)
    shared = np.clip(across, 0, None) * np.clip(down, 0, None)
    return shared / (boxes[:, 2] * boxes[:, 3] + w * h - shared)
