"""Sensor model of a Kinect v1: noise, quantisation, shadows and holes of depth, and colour noise."""

import numpy as np
from numpy.typing import NDArray

from spot3d.depth_noise import KINECT_V1
from spot3d.kernel import kernel, part

# Depth camera of the Kinect v1: focal length of its disparities (pixels) and baseline to the projector
# (metres).
FOCAL_PX, BASELINE_M = 585.0, 0.075
# Disparity is reported in eighths of a pixel: a step of 2.85 mm/m2 * z^2.
STEPS_PER_PX = 8.0
# The sensor matches blocks of pixels, so neighbours share most of their noise. On planes of real frames the correlation
# is 0.65 at one pixel, 0.2 at five, none from eight on. A 7 px block with the quantisation gives the same.
BLOCK = 7
NEAR_M, FAR_M = 0.5, 5.0
# Columns without depth: blocks at the right border have no full window.
BLIND_COLUMNS = 8
# Depth edges wobble by about a pixel (standard deviation), in blocks.
EDGE_WOBBLE_PX = 1.1
EDGE_JUMP_PX = 1.5
# Jumps and shadows narrower than EDGE_JUMP_PX are bridged by the block. Beside an edge, depth is lost where the noise
# exceeds EDGE_GAP deviations, which leaves single gaps.
EDGE_GAP = 0.9
# Below the first cosine of incidence all depth is lost, above the second none.
GRAZING_LOST, GRAZING_KEPT = 0.10, 0.26
COLOUR_SIGMA = 3.0


def measured_depth(
    depth: NDArray[np.float32], cosine: NDArray[np.float32], focal_px: float, seed: int, index: int
) -> NDArray[np.uint16]:
    """Depth image (h, w) uint16 in mm, 0 = invalid, that a Kinect would measure.

    depth: (h, w) float32 metres, exact; cosine: (h, w) float32 of the angle between ray and normal; focal_px: the
    view's focal length. The same (seed, index) always gives the same image.
    """
    field = block_noise(depth.shape[0], depth.shape[1], _state(seed, index, 1))
    out = np.zeros(depth.shape, np.uint16)
    parallax = np.float32(focal_px * BASELINE_M)
    _measure(parallax / depth, cosine, field, parallax, np.float32(focal_px / FOCAL_PX), out)
    return out


def noisy_colour(colour: NDArray[np.uint8], seed: int, index: int) -> NDArray[np.uint8]:
    """Colour image (h, w, 3) uint8 with sensor noise: sigma 3 levels, correlated between the channels."""
    out = np.empty_like(colour)
    _add_colour_noise(colour, _state(seed, index, 2), out)
    return out


def _state(seed: int, index: int, stream: int) -> np.uint64:
    return np.uint64(np.random.SeedSequence((seed, index, stream)).generate_state(1, np.uint64)[0])


@part()
def _next(state: np.uint64) -> np.uint64:
    """Next state of a xorshift generator; its upper bits are the random ones."""
    state ^= state << np.uint64(13)
    state ^= state >> np.uint64(7)
    return state ^ (state << np.uint64(17))


@kernel()
def block_noise(height: int, width: int, state: np.uint64) -> NDArray[np.float32]:
    """Approximately normal noise (height, width) float32, mean 0, deviation 1: white noise averaged over 7x7 px."""
    state |= np.uint64(1)
    rows = np.zeros((BLOCK, width + BLOCK), np.int32)
    sums = np.zeros(width + BLOCK, np.int32)
    out = np.empty((height, width), np.float32)
    # A uniform byte has a standard deviation of 73.9, and a block sums 49 of them.
    scale = np.float32(1.0 / (73.9 * BLOCK))
    mean = np.int32(255 * BLOCK * BLOCK // 2)
    for v in range(height + BLOCK - 1):
        row = rows[v % BLOCK]
        for u in range(0, width + BLOCK - 8, 8):
            state = _next(state)
            bits = state
            for k in range(u, u + 8):
                value = np.int32(bits & np.uint64(255))
                bits >>= np.uint64(8)
                sums[k] += value - row[k]
                row[k] = value
        for k in range((width + BLOCK) // 8 * 8 - 8, width + BLOCK):
            state = _next(state)
            value = np.int32(state >> np.uint64(56))
            sums[k] += value - row[k]
            row[k] = value
        if v >= BLOCK - 1:
            window = np.int32(0)
            for u in range(BLOCK - 1):
                window += sums[u]
            for u in range(width):
                window += sums[u + BLOCK - 1]
                out[v - BLOCK + 1, u] = (window - mean) * scale
                window -= sums[u]
    return out


@kernel()
def _measure(
    exact: NDArray[np.float32],
    cosine: NDArray[np.float32],
    field: NDArray[np.float32],
    parallax: np.float32,
    zoom: np.float32,
    out: NDArray[np.uint16],
) -> None:
    """Writes the measured depth in mm from exact disparities in pixels.

    `parallax`: focal length times baseline. `zoom`: focal length over 585 px.
    """
    h, w = exact.shape
    blind = int(BLIND_COLUMNS * zoom)
    jump = np.float32(EDGE_JUMP_PX) * zoom
    steps = np.float32(STEPS_PER_PX) / zoom
    least_disparity, most_disparity = parallax / np.float32(FAR_M), parallax / np.float32(NEAR_M)
    lost, span = np.float32(GRAZING_LOST), np.float32(GRAZING_KEPT - GRAZING_LOST)
    wobble, gap = np.float32(EDGE_WOBBLE_PX), np.float32(EDGE_GAP)
    sigma_0, sigma_2, sigma_at = np.float32(KINECT_V1.floor), np.float32(KINECT_V1.growth), np.float32(KINECT_V1.at)
    zero, one, rounding = np.float32(0), np.float32(1), np.float32(1 / 12)
    millimetre_steps = np.float32(1000) * parallax * steps
    # Padded on either side, so that the first and the last pixel need no special case.
    disparity = np.empty(w + 2, np.float32)
    drop = np.empty(w, np.bool_)
    for v in range(h):
        # Edges wobble: each pixel is read from a place displaced by noise, taken from other rows of the field.
        sideways, upwards = field[(v + h // 3) % h], field[(v + 2 * h // 3) % h]
        for u in range(w):
            su = u + int(np.rint(wobble * sideways[u]))
            sv = v + int(np.rint(wobble * upwards[u]))
            su, sv = min(max(su, 0), w - 1), min(max(sv, 0), h - 1)
            d, beside = exact[v, u], exact[sv, su]
            c = cosine[v, u]
            # Only across an edge: on a slanted surface the displacement would add noise.
            if abs(beside - d) >= jump:
                d, c = beside, cosine[sv, su]
            # Grazing surfaces lose depth in blocks, the more the smaller the cosine.
            keep = (c - lost) / span
            blurred = keep - np.float32(0.5) - np.float32(0.25) * upwards[u]
            grazing = keep <= 0 or (keep < 1 and blurred < 0)
            disparity[u + 1] = d
            drop[u] = grazing or d < least_disparity or d > most_disparity
        disparity[0], disparity[w + 1] = disparity[1], disparity[w]
        # The projector is on the right: its shadow lies to the left of nearer things.
        least = np.float32(w)
        for k in range(w):
            u = w - 1 - k
            seen_at = np.float32(u) - disparity[u + 1]
            if seen_at > least + jump:
                drop[u] = True
            least = seen_at if seen_at < least else least
        # No branches, so that the compiler vectorises this loop.
        row = field[v]
        for u in range(w - blind):
            d = disparity[u + 1]
            step_left, step_right = abs(disparity[u] - d), abs(disparity[u + 2] - d)
            at_edge = (step_left > jump) | (step_right > jump)
            z = parallax / d
            from_least = z - sigma_at
            sigma = (sigma_0 + sigma_2 * from_least * from_least) * d * d * steps / parallax
            # Rounding to whole steps itself adds a deviation of 1/sqrt(12) step.
            variance = sigma * sigma - rounding
            sigma = np.sqrt(variance if variance > 0 else zero)
            whole = np.rint(d * steps + sigma * row[u])
            millimetres = np.rint(millimetre_steps / (whole if whole > 1 else one))
            keep = (not drop[u]) & (not (at_edge & (sideways[u] > gap))) & (millimetres < 65535)
            out[v, u] = np.uint16(millimetres) if keep else np.uint16(0)


@kernel()
def _add_colour_noise(colour: NDArray[np.uint8], state: np.uint64, out: NDArray[np.uint8]) -> None:
    """Writes colour plus noise: a sum of three random nibbles, two common to all channels and one for each channel."""
    state |= np.uint64(1)
    # A nibble's standard deviation is 4.61: the sum of three has sqrt(3) times that.
    scale = np.int32(np.rint(256 * COLOUR_SIGMA / (4.61 * np.sqrt(3.0))))
    for v in range(colour.shape[0]):
        for u in range(colour.shape[1]):
            state = _next(state)
            bits = state >> np.uint64(40)
            common = np.int32(bits & np.uint64(15)) + np.int32((bits >> np.uint64(4)) & np.uint64(15))
            bits >>= np.uint64(8)
            for k in range(3):
                # Twice the sum, less twice its mean 22.5, in 512ths of a level; 256 rounds.
                noise = (2 * (common + np.int32(bits & np.uint64(15))) - 45) * scale
                bits >>= np.uint64(4)
                value = np.int32(colour[v, u, k]) + ((noise + 256) >> 9)
                out[v, u, k] = 0 if value < 0 else (255 if value > 255 else value)
