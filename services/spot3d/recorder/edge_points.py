"""Boxes as points along their edges, for viewers that show clouds and know no boxes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from spot3d.drawing.picture import object_colour
from spot3d.found_object import FoundObject

_SPACING = 0.005
"""Metres, as the map's points are apart."""
_CORNERS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_EDGES = [(a, b) for a in range(8) for b in range(a) if np.count_nonzero(_CORNERS[a] != _CORNERS[b]) == 1]


def edge_points(objects: Sequence[FoundObject]) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Points along the edges of the objects' boxes, at most 5 mm apart, in the colours of their labels.

    Returns (n, 3) metres, world, and (n, 3) RGB.
    """
    xyz, rgb = [np.zeros((0, 3))], [np.zeros((0, 3), np.uint8)]
    for item in objects:
        corners = item.box.centre + (_CORNERS * item.box.size) @ item.box.rotation.T
        for start, end in ((corners[a], corners[b]) for a, b in _EDGES):
            count = 1 + int(np.ceil(np.linalg.norm(end - start) / _SPACING))
            xyz.append(np.linspace(start, end, count))
            rgb.append(np.full((count, 3), object_colour(item.id), np.uint8))
    return np.concatenate(xyz).astype(np.float32), np.concatenate(rgb)
