"""Compiled shading of the built-in scene's surfaces by the lamp and the window."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel, part
from spot3d.source.scene.intersect import outward_normal
from spot3d.source.scene.light import LAMP_CENTRE, LampLight
from spot3d.source.scene.shapes import BOX, CONE, PLAIN, ROOM, SPECKLE, WOOD, Shapes, SurfacePattern
from spot3d.source.scene.texture import pattern_at, smooth_noise

AMBIENT, LAMP, WINDOW = 0.34, 0.72, 0.16
WINDOW_DIRECTION = (0.75, -0.55, 0.37)
# The carpet's period is 10 cm.
CARPET_FREQUENCY = 10.0
# Grey levels for 1024 steps of brightness. The square root approximates the display's gamma.
GAMMA = (255.0 * np.sqrt(np.arange(1024) / 1023.0)).astype(np.uint8)


class Rays(NamedTuple):
    """A view's rays in each primitive's frame.

    to_local: (n, 3, 3), rotations of the rays; eye: (n, 3), their origins; rectangles: (n, 4) int32 pixels [u from, u
    to, v from, v to) that the primitive may cover; pinhole: (4,) fx, fy, cx, cy.
    """

    to_local: NDArray[np.float64]
    eye: NDArray[np.float64]
    rectangles: NDArray[np.int32]
    pinhole: NDArray[np.float64]


class Image(NamedTuple):
    """Input: depth and primitive (h, w) of the hits. Output: cosine (h, w) and colour (h, w, 3)."""

    depth: NDArray[np.float32]
    which: NDArray[np.int32]
    cosine: NDArray[np.float32]
    colour: NDArray[np.uint8]


@part()
def _shadow(areas: NDArray[np.float64], light: NDArray[np.float32], x: float, y: float, z: float) -> float:
    """Visible share of the lamp at a world point on an upward surface, from its shadow map. 1 elsewhere."""
    for m in range(areas.shape[0]):
        if abs(z - areas[m, 0]) < 1e-3:
            column, row = (x - areas[m, 1]) * areas[m, 3], (y - areas[m, 2]) * areas[m, 4]
            if 0 <= column < light.shape[2] - 1 and 0 <= row < light.shape[1] - 1:
                i, j = np.uint64(column), np.uint64(row)
                i1, j1 = np.uint64(column + 1), np.uint64(row + 1)
                a, b = column - np.floor(column), row - np.floor(row)
                top = light[m, j, i] * (1 - a) + light[m, j, i1] * a
                bottom = light[m, j1, i] * (1 - a) + light[m, j1, i1] * a
                return float(top * (1 - b) + bottom * b)
    return 1.0


@part()
def _face_coordinates(
    kind: int, face: int, plain: bool, form: NDArray[np.float64], p: int, x: float, y: float, z: float
) -> tuple[float, float, float, float]:
    """Coordinates (a, b) of a point on its face of primitive `p`, and the face's half sizes, metres."""
    if face == 0:
        return y, z, form[p, 1], form[p, 2]
    if face == 1:
        return x, z, form[p, 0], form[p, 2]
    if face == 2 and kind == BOX:
        return y, x, form[p, 1], form[p, 0]
    if face == 2:
        return x, y, form[p, 1], form[p, 1]
    if plain:
        return x + y, z, form[p, 1], form[p, 0]
    half_height = form[p, 0] if kind == CONE else form[p, 2]
    return np.arctan2(y, x) * form[p, 1], z, np.pi * form[p, 1], half_height


@kernel()
def shade(
    shapes: Shapes,
    surface: SurfacePattern,
    rays: Rays,
    lamp_light: LampLight,
    table: NDArray[np.float32],
    gamma: NDArray[np.uint8],
    image: Image,
) -> None:
    """Writes each pixel's cosine of incidence and its colour: pattern, Lambert's law, lamp shadows, gamma.

    table: of noise; gamma: GAMMA. Primitives are the outer loop, so that their values stay in registers.
    """
    kinds, form, rotation, centre = shapes
    patterns, first, second, frequencies = surface
    to_local, eye, rectangles, pinhole = rays
    areas, light = lamp_light
    depth, which, cosine, colour = image
    fx, fy, cx, cy = pinhole
    for p in range(kinds.shape[0]):
        kind = kinds[p]
        m00, m01, m02 = to_local[p, 0, 0], to_local[p, 0, 1], to_local[p, 0, 2]
        m10, m11, m12 = to_local[p, 1, 0], to_local[p, 1, 1], to_local[p, 1, 2]
        m20, m21, m22 = to_local[p, 2, 0], to_local[p, 2, 1], to_local[p, 2, 2]
        r00, r01, r02 = rotation[p, 0, 0], rotation[p, 0, 1], rotation[p, 0, 2]
        r10, r11, r12 = rotation[p, 1, 0], rotation[p, 1, 1], rotation[p, 1, 2]
        r20, r21, r22 = rotation[p, 2, 0], rotation[p, 2, 1], rotation[p, 2, 2]
        ox, oy, oz = eye[p, 0], eye[p, 1], eye[p, 2]
        px, py, pz = centre[p, 0], centre[p, 1], centre[p, 2]
        red, green, blue = first[p, 0], first[p, 1], first[p, 2]
        to_red, to_green, to_blue = second[p, 0] - red, second[p, 1] - green, second[p, 2] - blue
        for v in range(rectangles[p, 2], rectangles[p, 3]):
            y = (v - cy) / fy
            for u in range(rectangles[p, 0], rectangles[p, 1]):
                if which[v, u] != p:
                    continue
                t = float(depth[v, u])
                x = (u - cx) / fx
                dx, dy, dz = m00 * x + m01 * y + m02, m10 * x + m11 * y + m12, m20 * x + m21 * y + m22
                lx, ly, lz = ox + t * dx, oy + t * dy, oz + t * dz
                nx, ny, nz, face = outward_normal(kind, form, p, lx, ly, lz)
                facing = -(nx * dx + ny * dy + nz * dz)
                if facing < 0:
                    nx, ny, nz, facing = -nx, -ny, -nz, -facing
                cosine[v, u] = facing / np.sqrt(np.float32(x * x + y * y + 1))
                wx = r00 * lx + r01 * ly + r02 * lz + px
                wy = r10 * lx + r11 * ly + r12 * lz + py
                wz = r20 * lx + r21 * ly + r22 * lz + pz
                pattern, frequency = patterns[p], frequencies[p]
                if kind == ROOM and face == 2:
                    # The floor is a carpet, the ceiling plain.
                    pattern, frequency = (SPECKLE if wz < 1 else PLAIN), CARPET_FREQUENCY
                a, b, half_a, half_b = _face_coordinates(kind, face, pattern == PLAIN, form, p, lx, ly, lz)
                a, b, half_a, half_b = a * frequency, b * frequency, half_a * frequency, half_b * frequency
                share, ink = pattern_at(pattern, table, a, b, half_a, half_b, 17.3 * p + 5.1 * face)
                # The normal in the world, then the two lights.
                wnx = r00 * nx + r01 * ny + r02 * nz
                wny = r10 * nx + r11 * ny + r12 * nz
                wnz = r20 * nx + r21 * ny + r22 * nz
                ax, ay, az = LAMP_CENTRE[0] - wx, LAMP_CENTRE[1] - wy, LAMP_CENTRE[2] - wz
                lamp = (wnx * ax + wny * ay + wnz * az) / np.sqrt(np.float32(ax * ax + ay * ay + az * az))
                seen = _shadow(areas, light, wx, wy, wz) if wnz > 0.99 else 1.0
                window = wnx * WINDOW_DIRECTION[0] + wny * WINDOW_DIRECTION[1] + wnz * WINDOW_DIRECTION[2]
                bright = AMBIENT * (0.55 + 0.45 * seen) * (0.85 + 0.15 * wnz)
                bright += LAMP * seen * lamp if lamp > 0 else 0.0
                bright += WINDOW * window if window > 0 else 0.0
                if pattern != WOOD:
                    bright *= 1 + 0.05 * smooth_noise(table, 3 * a + 3.3 * p, 3 * b)
                bright *= (1 - 0.8 * ink) * 1023.0
                colour[v, u, 0] = gamma[int(min(bright * (red + share * to_red), 1023.0))]
                colour[v, u, 1] = gamma[int(min(bright * (green + share * to_green), 1023.0))]
                colour[v, u, 2] = gamma[int(min(bright * (blue + share * to_blue), 1023.0))]
