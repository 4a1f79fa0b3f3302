"""Colour that is worse than the camera's: of a dark room, or of a camera that moves while it exposes."""

import cv2
import numpy as np
from numpy.typing import NDArray


def darkened(colour: NDArray[np.uint8], photons: float, seed: tuple[int, int]) -> NDArray[np.uint8]:
    """Colour of which a white pixel has so many photons, and others as many fewer, raised to the brightness it had.

    colour: (h, w, 3) uint8. Photons come by chance (Poisson); of none all is black. seed: of the recording, and the
    frame.
    """
    if not photons:
        return np.zeros_like(colour)
    rng = np.random.default_rng((*seed, 5))
    counted = rng.poisson(colour * (photons / 255))
    return np.asarray(np.clip(np.rint(counted * (255 / photons)), 0, 255), np.uint8)


def blurred(colour: NDArray[np.uint8], length: int, seed: tuple[int, int]) -> NDArray[np.uint8]:
    """Colour that is the mean along a line of so many pixels, in another direction in each frame.

    colour: (h, w, 3) uint8. seed: of the recording, and the frame.
    """
    angle = np.random.default_rng((*seed, 6)).uniform(0, np.pi)
    side = 2 * (length // 2) + 1
    end = (length - 1) / 2 * np.array((np.cos(angle), np.sin(angle)))
    first, last = (tuple(np.rint(side // 2 + sign * end).astype(int).tolist()) for sign in (-1, 1))
    line = cv2.line(np.zeros((side, side), np.float32), first, last, 1.0)
    return np.asarray(cv2.filter2D(colour, -1, line / line.sum()), np.uint8)
