"""Corrections of a camera that disagrees with the poses given for it, or with itself."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d_schemas.limits import BEND_SHAPE

Bend = tuple[tuple[float, ...], ...]
"""Logarithm of the factor of depth in each part of the image, on top of the factor for all of it: the rows of a lattice
(`BEND_SHAPE`) from the image's upper left corner to its lower right one, bilinear in between. Empty: no bend."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """Corrections of depth, intrinsics and mounting; by default, none.

    depth_factor: factor of depth; turn: rotation vector about the camera's axes, radians, of the camera against the
    frame whose poses are given; centre: how much further to the right and down a point at unit depth lies than the
    intrinsics say: the principal point is off by so many focal lengths; bend: see `Bend`.
    """

    depth_factor: float = 1.0
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    centre: tuple[float, float] = (0.0, 0.0)
    bend: Bend = ()

    def camera(self, told: Intrinsics) -> Intrinsics:
        """The corrected intrinsics for the nominal ones, `told`."""
        x, y = self.centre
        return replace(told, cx=told.cx - x * told.fx, cy=told.cy - y * told.fy)

    def metres(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """The corrected depth for a measured one, (h, w) metres."""
        straight = self.straightened(depth)
        return straight if self.depth_factor == 1 else straight * np.float32(self.depth_factor)

    def straightened(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """The depth (h, w) without its bend, in the unit of the measurement."""
        return depth * _factors(self.bend, depth.shape) if self.bend else depth

    def straighter(self, now: "Calibration") -> NDArray[np.float64] | None:
        """The change of bend from this to `now`, (rows, columns) as in `Bend`; None: no change."""
        if now.bend == self.bend:
            return None
        straight = np.zeros(BEND_SHAPE)
        return np.subtract(now.bend or straight, self.bend or straight)


NOMINAL = Calibration()
"""No correction."""


def bend_of_image(bend: NDArray[np.float64], shape: tuple[int, int]) -> NDArray[np.float64]:
    """The logarithm (h, w) of each pixel's factor of depth; bend: (rows, columns), see `Bend`."""
    down, across = (
        _shares((np.arange(size) + 0.5) / size, count) for size, count in zip(shape, bend.shape, strict=True)
    )
    return np.asarray(down @ bend @ across.T)


def bend_at(bend: NDArray[np.float64], across: NDArray[np.float64], down: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same, (...), at places in the image, each 0..1 of its width and of its height."""
    rows, columns = bend.shape
    return np.asarray(((_shares(down, rows) @ bend) * _shares(across, columns)).sum(axis=-1))


def _shares(places: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Interpolation weights, (..., count), of the lattice's lines at places 0..1; places beyond are clipped."""
    steps = np.clip(places, 0, 1)[..., None] * (count - 1)
    return np.maximum(0.0, 1.0 - np.abs(steps - np.arange(count)))


@lru_cache(maxsize=4)  # a frame's bend is mostly that of the frame before, at one size in each stage
def _factors(bend: Bend, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Each pixel's factor of depth for an image of this shape (h, w)."""
    return np.exp(bend_of_image(np.array(bend), shape)).astype(np.float32)


def sheared(centre: tuple[float, float]) -> NDArray[np.float64]:
    """(3, 3) shear that corrects points in the camera frame for a principal point that is off (see `Calibration`)."""
    return np.array(((1.0, 0.0, centre[0]), (0.0, 1.0, centre[1]), (0.0, 0.0, 1.0)))


def moved_planes(
    planes: NDArray[np.float64], linear: NDArray[np.float64], about: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(k, 4) planes [n, b], n.x + b = 0, after their points move by `linear` (3, 3) about a point (3,).

    Rows of zeros, which are no plane, stay zeros.
    """
    normals = planes[:, :3] @ np.linalg.inv(linear)
    length = np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
    away = (planes[:, 3:] + (planes[:, :3] @ about)[:, None]) / length
    normals = normals / length
    return np.hstack((normals, away - (normals @ about)[:, None]))
