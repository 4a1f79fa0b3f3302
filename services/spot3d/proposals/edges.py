"""One thin edge map from colour and depth: gradients of colour, jumps and creases of inverse depth."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.depth_noise import KINECT_V1, DepthNoise
from spot3d.kernel import kernel
from spot3d.proposals.holes import fill_along_colour
from spot3d.proposals.inverse_depth import depth_strength
from spot3d.proposals.settings import EdgeSettings

COLOUR_WEIGHT = np.float32(0.5)  # largest magnitude of a colour edge in a frame that has depth
ALONG = 2.0  # standard deviation, pixels, of the smoothing whose ridges give the edges' orientation


class EdgeMap(NamedTuple):
    """Edges one pixel wide: magnitude (h, w) float32 in [0, 1], 0 = none, and orientation (h, w) float32.

    The orientation is that of the edge's normal, radians in [0, pi), 0 along x.
    """

    magnitude: NDArray[np.float32]
    orientation: NDArray[np.float32]


def detect_edges(
    colour: NDArray[np.uint8],
    depth: NDArray[np.float32],
    focal_length: float,
    settings: EdgeSettings,
    noise: DepthNoise = KINECT_V1,
) -> EdgeMap:
    """Thin edges of a registered RGB-D frame: the stronger of colour and depth at each pixel, thinned.

    colour: (h, w, 3) uint8 RGB; depth: (h, w) float32 metres, 0 = invalid; focal_length: pixels. Colour alone
    counts, at full weight, where no pixel has depth or `settings.depth` is off.
    """
    least, contrast = np.float32(settings.min_magnitude), np.float32(settings.colour_contrast)
    has_depth = settings.depth and bool(depth.any())
    smooth = np.asarray(cv2.GaussianBlur(colour, (5, 5), 1.0), np.uint8)
    weight = COLOUR_WEIGHT if has_depth else np.float32(1)
    strength = np.zeros(depth.shape, np.float32)
    if weight > least:
        weakest = np.int32(4 * (contrast * least / (weight - least)) ** 2)
        _colour_strength(smooth, weight, contrast, weakest, strength)
    if has_depth:
        inverse = fill_along_colour(depth, smooth, settings.colour_contrast * least / (1 - least))
        of_depth = depth_strength(inverse, focal_length, noise)
        strength = np.maximum(strength, np.where(of_depth >= least, of_depth, 0))
    ridges = np.asarray(cv2.GaussianBlur(strength, (0, 0), ALONG), np.float32)
    edges = EdgeMap(np.zeros_like(strength), np.zeros_like(strength))
    thin(strength, ridges, *edges)
    return edges


@kernel()
def _colour_strength(
    smooth: NDArray[np.uint8],
    weight: np.float32,
    contrast: np.float32,
    weakest: np.int32,
    strength: NDArray[np.float32],
) -> None:
    """Strength (h, w) of colour edges, weight * g / (g + contrast), where g is large enough; it is 0 before.

    g: largest gradient of the three channels, grey levels per pixel; weakest: its least, as the square of a difference
    over two pixels.
    """
    h, w = strength.shape
    for y in range(1, h - 1):
        for x in range(1, w - 1):
            best = np.int32(0)
            for k in range(3):
                gx = np.int32(smooth[y, x + 1, k]) - np.int32(smooth[y, x - 1, k])
                gy = np.int32(smooth[y + 1, x, k]) - np.int32(smooth[y - 1, x, k])
                squared = gx * gx + gy * gy
                if squared > best:
                    best = squared
            if best > weakest:
                g = np.float32(0.5) * np.sqrt(np.float32(best))
                strength[y, x] = weight * g / (g + contrast)


@kernel()
def thin(
    strength: NDArray[np.float32],
    smooth: NDArray[np.float32],
    magnitude: NDArray[np.float32],
    orientation: NDArray[np.float32],
) -> None:
    """Fill in the fields of EdgeMap, which are 0, at pixels that are maxima of `strength` across their edge.

    Its normal is along the sharpest bend of the smoothed map. All (h, w); the outermost pixels have no edges.
    """
    h, w = strength.shape
    zero, one, half, quarter, tiny = np.float32(0), np.float32(1), np.float32(0.5), np.float32(0.25), np.float32(1e-30)
    for y in range(1, h - 1):  # loops that are free of branches run several pixels at once
        kept, slope = magnitude[y], orientation[y]
        b0, b1, b2 = smooth[y - 1], smooth[y], smooth[y + 1]
        for x in range(1, w - 1):
            # Eigenvector of the most negative second derivative: across the ridge.
            diff = half * (b1[x + 1] + b1[x - 1] - b2[x] - b0[x])
            cross = quarter * (b2[x + 1] + b0[x - 1] - b2[x - 1] - b0[x + 1])
            bend = np.sqrt(diff * diff + cross * cross) + abs(diff) + tiny
            steep = diff > zero
            slope[x] = (bend if steep else -cross) / (-cross if steep else bend)
        s0, s1, s2 = strength[y - 1], strength[y], strength[y + 1]
        for x in range(1, w - 1):
            # Neighbours one step along the normal's larger component, interpolated across the smaller.
            east, west, south, north = s1[x + 1], s1[x - 1], s2[x], s0[x]
            south_east, north_west, south_west, north_east = s2[x + 1], s0[x - 1], s2[x - 1], s0[x + 1]
            m = slope[x]
            size = abs(m)
            along_x, falling = size <= one, m > zero
            t = size if along_x else one / size
            ahead, behind = east if along_x else south, west if along_x else north
            right, left = south_east if falling else north_east, north_west if falling else south_west
            swap = falling | along_x  # the normal of a rising edge that points down points to the left
            ahead = (one - t) * ahead + t * (right if swap else left)
            behind = (one - t) * behind + t * (left if swap else right)
            s = s1[x]
            peak = (s > ahead) & (s >= behind)  # of two equal neighbours, one stays
            kept[x] = s if peak else zero
        for x in range(1, w - 1):
            angle = np.arctan(slope[x]) if kept[x] > zero else zero
            slope[x] = angle if angle >= zero else angle + np.float32(np.pi)
