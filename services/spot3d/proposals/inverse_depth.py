"""Depth edges: inverse depth is linear on planes, so its jumps and bends are edges of objects."""

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.depth_noise import DepthNoise
from spot3d.kernel import kernel

FINE, COARSE = 1.0, 2.0  # standard deviations of the two smoothings, pixels
SUPPORT = 13  # width of the coarser filter, pixels
# The jump that counts as a full edge: tangent of the angle between viewing ray and normal of a surface that would
# bridge it, 80 degrees; and the bend that does: change of that tangent across it.
JUMP_SLOPE, CREASE_SLOPE = 6.0, 1.0
CONVEX = np.float32(0.5)  # weight of convex bends, within objects, against concave ones, between them
NOISE_GATE = 3.0  # standard deviations of depth noise that are subtracted from an edge
# Peak responses of the filters to a unit step or a unit change of slope, and to noise of one (the crease's is three
# times that of white noise: errors of neighbouring pixels of a depth camera are correlated).
JUMP_RESPONSE, JUMP_NOISE = np.float32(0.133), np.float32(0.15)
CREASE_RESPONSE, CREASE_NOISE = np.float32(0.2), np.float32(0.09)
LOBES = np.float32(0.5)  # curvature beside a jump over the jump's own response


def depth_strength(inverse: NDArray[np.float32], focal_length: float, noise: DepthNoise) -> NDArray[np.float32]:
    """Strength (h, w) float32 of the jump or crease at each pixel: v / sqrt(1 + v^2), v = 1 for a full edge.

    Inverse depth is linear on planes: a peak of its gradient above the slope around it is a jump, a peak of
    its curvature a crease; both are judged against the sensor's noise at that depth.
    inverse: (h, w) float32 1/m without holes; focal_length: pixels.
    """
    fine = np.asarray(cv2.GaussianBlur(inverse, (7, 7), FINE), np.float32)
    coarse = np.asarray(cv2.GaussianBlur(inverse, (SUPPORT, SUPPORT), COARSE), np.float32)
    jumps, creases = np.zeros_like(inverse), np.zeros_like(inverse)
    _jumps_and_creases(fine, coarse, jumps, creases)
    scale = (
        focal_length / (JUMP_RESPONSE * JUMP_SLOPE),
        focal_length / (CREASE_RESPONSE * CREASE_SLOPE),
        NOISE_GATE * noise.floor,
        NOISE_GATE * noise.growth,
        noise.at,
    )
    # Curvature has a lobe on either side of a jump: a response no stronger than that is no crease.
    near_jumps = np.asarray(cv2.dilate(jumps, np.ones((SUPPORT, SUPPORT), np.uint8)), np.float32)
    strength = np.empty_like(inverse)
    _judge(jumps, creases, near_jumps, coarse, np.array(scale, np.float32), strength)
    return strength


@kernel()
def _jumps_and_creases(
    fine: NDArray[np.float32], coarse: NDArray[np.float32], jumps: NDArray[np.float32], creases: NDArray[np.float32]
) -> None:
    """Responses (h, w) float32 of the filters for jumps and for creases, 1/m per pixel and per pixel squared.

    fine, coarse: (h, w) float32 1/m, inverse depth smoothed with FINE and COARSE. jumps, creases: 0, and
    left so at the image's border.
    """
    h, w = coarse.shape
    tiny, quarter, half, two = np.float32(1e-12), np.float32(0.25), np.float32(0.5), np.float32(2)
    for y in range(1, h - 1):
        jump_row, crease_row = jumps[y], creases[y]
        f0, f1, f2 = fine[y - 1], fine[y], fine[y + 1]
        c0, c1, c2 = coarse[y - 1], coarse[y], coarse[y + 1]
        for x in range(1, w - 1):  # free of branches, so that it runs several pixels at once
            # The difference of the two smoothings is zero on planes, so grazing surfaces are no jumps; beside
            # a jump it runs against the slope and counts as negative.
            gx, gy = half * (c1[x + 1] - c1[x - 1]), half * (c2[x] - c0[x])
            jx, jy = half * (f1[x + 1] - f1[x - 1]) - gx, half * (f2[x] - f0[x]) - gy
            jump_row[x] = (jx * gx + jy * gy) / np.sqrt(gx * gx + gy * gy + tiny)
            c = c1[x]
            cxx = c1[x + 1] - two * c + c1[x - 1]
            cyy = c2[x] - two * c + c0[x]
            cxy = quarter * (c2[x + 1] - c2[x - 1] - c0[x + 1] + c0[x - 1])
            mean, diff = half * (cxx + cyy), half * (cxx - cyy)
            spread = np.sqrt(diff * diff + cxy * cxy)
            concave, weighted = mean + spread, CONVEX * (spread - mean)
            crease_row[x] = concave if concave > weighted else weighted


@kernel()
def _judge(
    jumps: NDArray[np.float32],
    creases: NDArray[np.float32],
    near_jumps: NDArray[np.float32],
    coarse: NDArray[np.float32],
    scale: NDArray[np.float32],
    strength: NDArray[np.float32],
) -> None:
    """Strength (h, w) float32 of edges from the filters' responses, less their noise.

    jumps, creases, near_jumps (largest jump around), coarse: (h, w) float32; scale: (5,) float32 = the factors
    of jumps and of creases, the noise's floor and growth, both gated, and its `at`.
    """
    h, w = jumps.shape
    jump_scale, crease_scale, floor, growth, at = scale[0], scale[1], scale[2], scale[3], scale[4]
    zero, one = np.float32(0), np.float32(1)
    for y in range(h):
        row, jump, crease, near, inverse = strength[y], jumps[y], creases[y], near_jumps[y], coarse[y]
        for x in range(w):
            c = inverse[x]
            beyond = one - at * c
            noise = floor * c * c + growth * beyond * beyond  # sigma_z / z^2: the noise of inverse depth
            jumped = (jump[x] - JUMP_NOISE * noise) * jump_scale
            beside = near[x] - JUMP_NOISE * noise
            lobe = LOBES * (beside if beside > zero else zero)
            bent = (crease[x] - lobe - CREASE_NOISE * noise) * crease_scale
            edge = jumped if jumped > bent else bent
            v = (edge if edge > zero else zero) / c
            row[x] = v / np.sqrt(one + v * v)
