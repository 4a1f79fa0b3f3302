"""Compiled procedural patterns of the built-in scene: printed packs, wood, stripes, carpets, pictures."""

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import part
from spot3d.source.scene.shapes import CHECKS, COVER, LABEL, PICTURE, SPECKLE, STRIPES, TILES, WOOD

# Side of the tileable noise table: a power of two, so that a bit mask wraps indices, and small enough for the cache.
NOISE_SIDE = 64


def noise_table(seed: int) -> NDArray[np.float32]:
    """Smooth tileable noise (64, 64) float32 in -1..1, with features of one cell."""
    rng = np.random.default_rng((seed, 7))
    return rng.uniform(-1, 1, (NOISE_SIDE, NOISE_SIDE)).astype(np.float32)


@part()
def smooth_noise(table: NDArray[np.float32], u: float, v: float) -> float:
    """Bilinear interpolation of the noise table at (u, v) in cells, in -1..1."""
    fu, fv = np.floor(u), np.floor(v)
    a, b = u - fu, v - fv
    mask = NOISE_SIDE - 1
    # Unsigned: each signed index would cost a test for negative values.
    i, j = np.uint64(int(fu) & mask), np.uint64(int(fv) & mask)
    i1, j1 = np.uint64((int(fu) + 1) & mask), np.uint64((int(fv) + 1) & mask)
    top = table[j, i] + a * (table[j, i1] - table[j, i])
    bottom = table[j1, i] + a * (table[j1, i1] - table[j1, i])
    return float(top + b * (bottom - top))


@part()
def _print(table: NDArray[np.float32], a: float, b: float, lines: float) -> float:
    """Ink 0..1 at (a, b) in periods, for `lines` lines of words in a period, with gaps from the noise table."""
    row = np.floor(b * lines)
    if b * lines - row > 0.55:
        return 0.0
    return 1.0 if smooth_noise(table, 1.1 * lines * a + 31.7 * row, row * 5.3) > -0.25 else 0.0


@part()
def pattern_at(
    pattern: int, table: NDArray[np.float32], a: float, b: float, half_a: float, half_b: float, shift: float
) -> tuple[float, float]:
    """Share 0..1 of the second colour, and ink 0..1, at (a, b) on a face of half sizes (half_a, half_b).

    All four are in periods of the pattern. `shift` displaces the noise, so that no two faces look alike.
    """
    if pattern == WOOD:
        # Rings along the grain: slow along, fast across, slightly bent. Planks are three periods wide.
        bend = smooth_noise(table, 0.3 * a + shift, 0.8 * b)
        ring = smooth_noise(table, 0.5 * a + shift, 8 * b + 2 * bend)
        plank = b * (1 / 3) - np.floor(b * (1 / 3))
        return max(0.22 + 0.25 * ring + 0.15 * bend, 0.0), (0.7 if plank < 0.008 else 0.0)
    if pattern == TILES:
        joint = 1.0 if a - np.floor(a) < 0.04 or b - np.floor(b) < 0.04 else 0.0
        return joint, 0.08 * abs(smooth_noise(table, a + shift, b))
    if pattern == STRIPES:
        return (1.0 if b - np.floor(b) < 0.5 else 0.0), 0.0
    if pattern == CHECKS:
        return float((int(np.floor(a)) + int(np.floor(b))) & 1), 0.0
    if pattern == SPECKLE:
        fine = smooth_noise(table, 4 * a + shift, 4 * b)
        coarse = smooth_noise(table, a, b + shift)
        return min(max(0.5 + 0.7 * fine + 0.5 * coarse, 0.0), 1.0), 0.0
    if pattern == PICTURE:
        large = smooth_noise(table, a + shift, b + shift)
        small = smooth_noise(table, 3 * a, 3 * b + shift)
        return np.floor(4 * (0.5 + 0.5 * large)) / 4, (0.8 if small > 0.45 else 0.0)
    if pattern == LABEL:
        if abs(a) > 0.8 * half_a or abs(b) > 0.75 * half_b:
            return 0.0, 0.0
        if b > 0.35 * half_b:
            return 0.25, _print(table, a + shift, b, 2.0)
        return 1.0, _print(table, a + shift, b, 5.0)
    if pattern == COVER:
        edge = abs(a) > 0.88 * half_a or abs(b) > 0.9 * half_b
        title = abs(a) < 0.7 * half_a and 0.2 * half_b < b < 0.7 * half_b
        return (1.0 if edge else 0.0), (_print(table, a + shift, b, 2.0) if title else 0.0)
    return 0.0, 0.0
