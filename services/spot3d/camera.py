"""The pinhole camera: intrinsics for exactly one image size."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from spot3d.depth_noise import KINECT_V1, DepthNoise

_OFF_CENTRE = 0.2
"""Share of the image's sides: depth cameras' principal points lie within a few hundredths of its middle."""


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """Pinhole intrinsics in pixels of a `width` x `height` image, and the noise of the depth in it.

    Optical frame: x right, y down, z forward; pixel centres are at integer coordinates. Equality ignores the noise.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    noise: DepthNoise = field(default=KINECT_V1, compare=False)

    def __post_init__(self) -> None:
        if not (self.fx > 0 and self.fy > 0 and np.isfinite([self.fx, self.fy, self.cx, self.cy]).all()):
            given = f"fx {self.fx:g}, fy {self.fy:g}, cx {self.cx:g}, cy {self.cy:g}"
            raise ValueError(f"focal lengths must be positive and all values finite, in pixels; got {given}")
        if self.width < 1 or self.height < 1:
            raise ValueError(f"image size must be positive, got {self.width}x{self.height}")

    @property
    def shape(self) -> tuple[int, int]:
        """Image shape (height, width), as NumPy states it."""
        return (self.height, self.width)

    def halved(self) -> "Intrinsics":
        """Intrinsics of the image that keeps every second pixel, starting with the first, of each axis."""
        return self.thinned(2)

    def thinned(self, step: int, first: float = 0.0) -> "Intrinsics":
        """Intrinsics of the image that keeps every nth pixel of each axis, from the first one on.

        first: its column and row; of n x n pixels' means, the middle of the first n.
        """
        return replace(
            self,
            fx=self.fx / step,
            fy=self.fy / step,
            cx=(self.cx - first) / step,
            cy=(self.cy - first) / step,
            width=-(-self.width // step),
            height=-(-self.height // step),
        )


def off_centre(camera: Intrinsics) -> str:
    """A warning for users that the intrinsics hardly belong to the image; empty if they may.

    Intrinsics for another size or crop place the principal point far from the image's middle.
    """
    u, v = (camera.cx + 0.5) / camera.width, (camera.cy + 0.5) / camera.height
    if max(abs(u - 0.5), abs(v - 0.5)) <= _OFF_CENTRE:
        return ""
    place = f"({camera.cx:g}, {camera.cy:g})"
    return (
        f"the principal point {place} is far from the centre of the {camera.width}x{camera.height} image: check that "
        "the intrinsics are those of images of this size"
    )


def back_project(depth: NDArray[np.float32], camera: Intrinsics) -> NDArray[np.float32]:
    """Points of a depth image in the camera frame (paper, Sec. V, pi^-1 before the pose).

    depth: (h, w) float32 metres, 0 = invalid. Returns (h, w, 3) float32 metres; invalid pixels give zeros.
    """
    if depth.shape != camera.shape:
        raise ValueError(f"depth is {depth.shape}, but the intrinsics are for {camera.shape}")
    u = (np.arange(camera.width, dtype=np.float32) - np.float32(camera.cx)) / np.float32(camera.fx)
    v = (np.arange(camera.height, dtype=np.float32) - np.float32(camera.cy)) / np.float32(camera.fy)
    return np.stack((depth * u[None, :], depth * v[:, None], depth), axis=-1)


def invert(T_target_source: NDArray[np.float64]) -> NDArray[np.float64]:
    """T_source_target of a rigid (4, 4) transform."""
    inverse = np.eye(4)
    inverse[:3, :3] = T_target_source[:3, :3].T
    inverse[:3, 3] = -inverse[:3, :3] @ T_target_source[:3, 3]
    return inverse
