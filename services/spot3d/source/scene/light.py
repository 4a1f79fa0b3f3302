"""Shadow maps of the surfaces that things stand on, computed once when the scene is built."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel
from spot3d.source.scene.intersect import hit
from spot3d.source.scene.placement import Region
from spot3d.source.scene.shapes import ROOM, Shapes, Solids

# The lamp: a square panel under the ceiling, in the world frame; metres.
LAMP_CENTRE = (0.7, 0.35, 2.5)
LAMP_HALF = 0.3
CELLS = 224


class LampLight(NamedTuple):
    """Shadow maps of upward surfaces.

    areas: (n, 5) float64, height, x from, y from, cells per metre along x and y; light: (n, 224, 224) float32, [map, y,
    x], the visible share 0..1 of the lamp.
    """

    areas: NDArray[np.float64]
    light: NDArray[np.float32]


def shadow_maps(solids: Solids, shaded: dict[float, Region]) -> LampLight:
    """Shadow maps of the upward surfaces that `shaded` gives by height."""
    shapes, cells = solids.shapes, CELLS - 1
    areas = np.array(
        [
            (z, left, near, cells / (right - left), cells / (far - near))
            for z, (left, right, near, far) in shaded.items()
        ]
    )
    # A bounding sphere of each primitive spares most rays the exact test.
    middle = shapes.centre + np.einsum("nij,nj->ni", shapes.rotation, (solids.low + solids.high) / 2)
    radius = np.linalg.norm(solids.high - solids.low, axis=1) / 2
    light = np.empty((len(areas), CELLS, CELLS), np.float32)
    steps = (np.arange(3) - 1) * (LAMP_HALF * 2 / 3)
    lamps = np.array([(LAMP_CENTRE[0] + a, LAMP_CENTRE[1] + b, LAMP_CENTRE[2]) for a in steps for b in steps])
    _fill(areas, lamps, _Spheres(shapes, middle, radius), light)
    # Cells under a thing are dark. Blurring them imitates the dark line where things touch their support.
    for shadow in light:
        shadow[:] = cv2.blur(shadow, (3, 3))
    return LampLight(areas, light)


class _Spheres(NamedTuple):
    """Shapes with their bounding spheres: middle (n, 3) and radius (n,)."""

    shapes: Shapes
    middle: NDArray[np.float64]
    radius: NDArray[np.float64]


@kernel()
def _fill(areas: NDArray[np.float64], lamps: NDArray[np.float64], things: _Spheres, light: NDArray[np.float32]) -> None:
    """Writes the share of the lamp's points that are visible from each cell, with one ray to each."""
    for m in range(areas.shape[0]):
        for row in range(light.shape[1]):
            for column in range(light.shape[2]):
                x = areas[m, 1] + column / areas[m, 3]
                y = areas[m, 2] + row / areas[m, 4]
                z = areas[m, 0] + 1e-4
                seen = 0
                for lamp in range(lamps.shape[0]):
                    dx, dy, dz = lamps[lamp, 0] - x, lamps[lamp, 1] - y, lamps[lamp, 2] - z
                    if not _blocked(things, x, y, z, dx, dy, dz):
                        seen += 1
                light[m, row, column] = seen / lamps.shape[0]


@kernel()
def _blocked(things: _Spheres, x: float, y: float, z: float, dx: float, dy: float, dz: float) -> bool:
    """Whether any solid lies between the point and the point plus the direction."""
    (kind, form, rotation, centre), middle, radius = things
    squared = dx * dx + dy * dy + dz * dz
    for p in range(kind.shape[0]):
        if kind[p] == ROOM:
            continue
        cx, cy, cz = middle[p, 0] - x, middle[p, 1] - y, middle[p, 2] - z
        along = (cx * dx + cy * dy + cz * dz) / squared
        px, py, pz = cx - along * dx, cy - along * dy, cz - along * dz
        if px * px + py * py + pz * pz > radius[p] * radius[p]:
            continue
        r = rotation[p]
        ox, oy, oz = x - centre[p, 0], y - centre[p, 1], z - centre[p, 2]
        t = hit(
            kind[p],
            form[p],
            r[0, 0] * ox + r[1, 0] * oy + r[2, 0] * oz,
            r[0, 1] * ox + r[1, 1] * oy + r[2, 1] * oz,
            r[0, 2] * ox + r[1, 2] * oy + r[2, 2] * oz,
            r[0, 0] * dx + r[1, 0] * dy + r[2, 0] * dz,
            r[0, 1] * dx + r[1, 1] * dy + r[2, 1] * dz,
            r[0, 2] * dx + r[1, 2] * dy + r[2, 2] * dz,
        )
        if t < 1:
            return True
    return False
