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
"""Passes over the holes. With 30 % of depth missing, on desks, bookcases, rooms, clutter and redkitchen, the heat
beside objects is 0.34 to 0.66 of that on them after 5 passes, 0.34 to 0.58 after 10, 0.34 to 0.59 after 20, and 0.39 to
0.73 if holes only take the farther end of their row."""
_RELAXATION = np.float32(1.75)
"""Over-relaxation: each pixel moves by this much of the way to its neighbours' mean, and below 2 it converges. After 20
passes a hole of 20 pixels beside a contour is filled with 1.75, and not yet with 1.6 and 1.85. From 1.5 to 1.85 the
share of heat above changes by at most 0.04, and with `_LEAK` from 0.0001 to 0.01 as little."""
_LEAK = np.float32(1e-3)
"""Least weight of a neighbour: what only other colours surround has depth as well."""


def fill_along_colour(
    depth: NDArray[np.float32], colour: NDArray[np.uint8], contrast: np.float32
) -> NDArray[np.float32]:
    """Inverse depth (h, w) float32 1/m; where there is no depth, the mean of the neighbours of like colour.

    depth: (h, w) float32 metres, 0 = invalid, not all; colour: (h, w, 3) uint8; contrast: difference of the colours of
    neighbouring pixels, grey levels, beyond which they are unlike.
    """
    inverse = np.empty_like(depth)
    fill_inverse_depth(depth, inverse)
    holes = np.flatnonzero(depth == 0).astype(np.int32)
    # Like the squares of a chessboard: no pixel has a neighbour of its own half, so that many are computed at once.
    is_black = (holes // depth.shape[1] + holes % depth.shape[1]) % 2 == 1
    holes = np.concatenate((holes[~is_black], holes[is_black]))
    neighbours, weights = np.empty((holes.size, 4), np.int32), np.empty((holes.size, 4), np.float32)
    _weigh(holes, np.ascontiguousarray(colour), contrast, neighbours, weights)
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
    holes: NDArray[np.int32], neighbours: NDArray[np.int32], weights: NDArray[np.float32], inverse: NDArray[np.float32]
) -> None:
    """Bring the pixels `holes` of the flat `inverse` nearer to their neighbours' weighted mean (Gauss-Seidel)."""
    for _ in range(_SWEEPS):
        for k in range(holes.size):
            mean = weights[k, 0] * inverse[neighbours[k, 0]] + weights[k, 1] * inverse[neighbours[k, 1]]
            mean += weights[k, 2] * inverse[neighbours[k, 2]] + weights[k, 3] * inverse[neighbours[k, 3]]
            p = holes[k]
            inverse[p] += _RELAXATION * (mean - inverse[p])
