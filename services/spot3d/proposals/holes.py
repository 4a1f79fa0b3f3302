"""Inverse depth in the holes of a frame, continued along its colours: where a colour goes on, the surface does too.

After A. Levin et al., *Colorization using Optimization*, SIGGRAPH 2004, with depth and colour in exchanged roles: where
neighbouring pixels are of one colour, their depth is nearly the same. A contour that a hole interrupts goes on in the
filled depth. Without that it falls into pieces, which look like the closed contours of objects of their own.
"""

import numpy as np
from numpy.typing import NDArray

from spot3d.geometry.inverse_depth import fill_inverse_depth
from spot3d.kernel import kernel, part

_SWEEPS = 20
"""Passes over the holes. With 30 % of depth missing on three desks from afar, the heat beside objects is 0.35, 0.34,
0.34 of that on them after 10, 20, 40 passes, and 0.41 if holes only take the farther end of their row; without missing
depth it is 0.33 and 0.32."""
_RELAXATION = np.float32(1.75)
"""Over-relaxation: each pixel moves by this much of the way to its neighbours' mean, and below 2 it converges. After 20
passes a hole of 20 pixels beside a contour is filled with 1.75, and not yet with 1.6 and 1.85."""
_BASELINE = 0.1
"""The two cameras of a depth camera, or its projector and camera, are at most this far apart, metres: 5 to 9.5 cm in
RealSense, Kinect and OAK-D. What one does not see lies beside an edge as a shadow."""
_LEAK = np.float32(1e-3)
"""Least weight of a neighbour: what only other colours surround has depth as well."""


def fill_along_colour(
    depth: NDArray[np.float32], colour: NDArray[np.uint8], focal_length: float, contrast: np.float32
) -> NDArray[np.float32]:
    """Inverse depth (h, w) float32 1/m; where there is no depth, the mean of the neighbours of like colour.

    A shadow beside an object takes the depth of what is behind the object.
    depth: (h, w) float32 metres, 0 = invalid, not all; colour: (h, w, 3) uint8; focal_length: pixels; contrast:
    difference of the colours of neighbouring pixels, grey levels, beyond which they are unlike.
    """
    colour, inverse, is_open = np.ascontiguousarray(colour), np.empty_like(depth), np.zeros(depth.shape, np.bool_)
    fill_inverse_depth(depth, inverse)
    _find_open(depth, colour, np.float32(focal_length * _BASELINE), contrast, is_open)
    holes = np.flatnonzero(is_open).astype(np.int32)
    # Like the squares of a chessboard: no pixel has a neighbour of its own half, so that many are computed at once.
    is_black = (holes // depth.shape[1] + holes % depth.shape[1]) % 2 == 1
    holes = np.concatenate((holes[~is_black], holes[is_black]))
    neighbours, weights = np.empty((holes.size, 4), np.int32), np.empty((holes.size, 4), np.float32)
    _weigh(holes, colour, contrast, neighbours, weights)
    _relax(holes, neighbours, weights, inverse.reshape(-1))
    return inverse


@part()
def _contrast(colour: NDArray[np.uint8], y: int, x: int, v: int, u: int) -> np.int64:
    """The largest difference of two pixels' channels, grey levels."""
    largest = np.int64(0)
    for channel in range(3):
        apart = abs(np.int64(colour[y, x, channel]) - np.int64(colour[v, u, channel]))
        largest = apart if apart > largest else largest
    return largest


@kernel()
def _find_open(
    depth: NDArray[np.float32],
    colour: NDArray[np.uint8],
    parallax: np.float32,
    contrast: np.float32,
    is_open: NDArray[np.bool_],
) -> None:
    """Write which pixels have no depth, and are in no shadow; `is_open` is False before.

    A shadow lies between a nearer and a farther end of its row, is no wider than their parallax, and is of one colour
    with the farther end. parallax: pixels for each 1/m between the ends.
    """
    h, w = depth.shape
    for y in range(h):
        left = -1
        for x in range(w + 1):
            if x < w and depth[y, x] == 0:
                continue
            shadow = left >= 0 and x < w
            if shadow:
                apart = np.float32(1) / depth[y, x] - np.float32(1) / depth[y, left]
                shadow = x - left - 1 <= parallax * abs(apart)
                # From the farther end to the last pixel of the hole: beside the nearer end colour may change.
                first, last = (left + 1, x - 1) if apart > 0 else (left + 2, x)
                for u in range(first, last + 1):
                    shadow = shadow and _contrast(colour, y, u - 1, y, u) <= contrast
            is_open[y, left + 1 : x] = not shadow
            left = x


@kernel()
def _weigh(
    holes: NDArray[np.int32],
    colour: NDArray[np.uint8],
    contrast: np.float32,
    neighbours: NDArray[np.int32],
    weights: NDArray[np.float32],
) -> None:
    """Fill in the four `neighbours` of each of n pixels, and their `weights`, which sum up to one; (n, 4) both."""
    h, w, _ = colour.shape
    apart = np.arange(256).astype(np.float32)
    alike = _LEAK + np.exp(-(apart * apart) / (contrast * contrast))
    for k in range(holes.size):
        y, x = holes[k] // w, holes[k] % w
        total = np.float32(0)
        for side in range(4):
            v, u = y + (side == 1) - (side == 0), x + (side == 3) - (side == 2)
            neighbours[k, side], weights[k, side] = holes[k], 0
            if 0 <= v < h and 0 <= u < w:
                neighbours[k, side] = v * w + u
                weights[k, side] = alike[_contrast(colour, y, x, v, u)]
            total += weights[k, side]
        for side in range(4):
            weights[k, side] /= total


@kernel()
def _relax(
    holes: NDArray[np.int32],
    neighbours: NDArray[np.int32],
    weights: NDArray[np.float32],
    inverse: NDArray[np.float32],
) -> None:
    """Bring the pixels `holes` of the flat `inverse` nearer to their neighbours' weighted mean (Gauss-Seidel)."""
    for _ in range(_SWEEPS):
        for k in range(holes.size):
            mean = weights[k, 0] * inverse[neighbours[k, 0]] + weights[k, 1] * inverse[neighbours[k, 1]]
            mean += weights[k, 2] * inverse[neighbours[k, 2]] + weights[k, 3] * inverse[neighbours[k, 3]]
            p = holes[k]
            inverse[p] += _RELAXATION * (mean - inverse[p])
