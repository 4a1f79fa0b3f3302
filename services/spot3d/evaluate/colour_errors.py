"""Degrades colour: a dark room, or motion blur."""

import cv2
import numpy as np
from numpy.typing import NDArray


def darkened(colour: NDArray[np.uint8], photons: float, seed: tuple[int, int]) -> NDArray[np.uint8]:
    """Colour with photon noise, at the brightness that it had.

    colour: (h, w, 3) uint8. photons: of a white pixel; others have fewer in proportion, all Poisson distributed; with 0
    the image is black. seed: of the recording, and the frame.
    """
    if not photons:
        return np.zeros_like(colour)
    rng = np.random.default_rng((*seed, 5))
    counted = rng.poisson(colour * (photons / 255))
    return np.asarray(np.clip(np.rint(counted * (255 / photons)), 0, 255), np.uint8)


def blurred(colour: NDArray[np.uint8], length: int, seed: tuple[int, int]) -> NDArray[np.uint8]:
    """Colour averaged along a line of `length` pixels, in another direction in each frame.

    colour: (h, w, 3) uint8. seed: of the recording, and the frame.
    """
    angle = np.random.default_rng((*seed, 6)).uniform(0, np.pi)
    side = 2 * (length // 2) + 1
    end = (length - 1) / 2 * np.array((np.cos(angle), np.sin(angle)))
    first, last = (tuple(np.rint(side // 2 + sign * end).astype(int).tolist()) for sign in (-1, 1))
    line = cv2.line(np.zeros((side, side), np.float32), first, last, 1.0)
    return np.asarray(cv2.filter2D(colour, -1, line / line.sum()), np.uint8)
