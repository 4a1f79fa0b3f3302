"""Supports of a view below the main one: the floor around a table, with a bag and a chest on it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.depth_noise import DepthNoise
from spot3d.segments.hanging import STANDS
from spot3d.segments.settings import SegmentsSettings
from spot3d.segments.supports import above_extent, heights_and_tolerance

_LEVEL = np.cos(np.radians(15))
"""Supports whose normals agree to 15 degrees are level alike (see `up_direction`). Walls are long, too."""

LongPieces = tuple[NDArray[np.float64], NDArray[np.bool_]]
"""A plane (4,), camera frame, and (h, w) bool, the pixels of its pieces that are longer than an object."""


@dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """The support that each pixel of a view is above: the main one or a lower one.

    planes: (p, 4) camera frame, the main support first, then from the highest to the lowest. number: (h, w) int8, the
    row of `planes` that a pixel is above. height, tolerance: (h, w) float32 metres above it, and how much of that may
    be noise (see `noise_height`). A pixel above none of them is assigned to the main one, below which it is.
    """

    planes: NDArray[np.float64]
    number: NDArray[np.int8]
    height: NDArray[np.float32]
    tolerance: NDArray[np.float32]

    def of(self, pixels: NDArray[np.int64], trim: float) -> int:
        """The row of the lowest plane that more than a share `trim` of (n,) flat pixel indices are above."""
        counts = np.bincount(self.number.ravel()[pixels], minlength=len(self.planes))
        return int(np.flatnonzero(counts > trim * len(pixels))[-1])


def with_lower(
    main: Levels,
    beside: NDArray[np.bool_],
    others: list[LongPieces],
    points: NDArray[np.float32],
    settings: SegmentsSettings,
    noise: DepthNoise,
) -> Levels:
    """The main support together with the lower ones: level planes with pieces that are longer than an object.

    beside: (h, w) bool, pixels lower than the main support and not beneath it (see `beside_support`): only these are
    assigned to a lower one, the highest that reaches there; points: (h, w, 3) float32, camera frame.
    """
    up = main.planes[0, :3]
    lower = []
    for plane, pieces in others:
        if plane[:3] @ up > _LEVEL and pieces.any() and (below := float(np.median(main.height[pieces]))) < -STANDS:
            lower.append((below, plane, pieces))
    planes, free = list(main.planes), beside.copy()
    number, height, tolerance = main.number.copy(), main.height.copy(), main.tolerance.copy()
    for _, plane, pieces in sorted(lower, key=lambda one: -one[0]) if free.any() else ():
        over, slack = heights_and_tolerance(points, plane, settings, noise)
        above = free & (over >= -slack)
        above[above] = above_extent(points[above], points[pieces], up)
        number[above], height[above], tolerance[above] = len(planes), over[above], slack[above]
        free &= ~above
        planes.append(plane)
    return Levels(np.array(planes), number, height, tolerance)
