"""Boxes as points along their edges, for viewers that show clouds but no boxes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import EDGES, corners
from spot3d.drawing.picture import object_colour
from spot3d.found_object import FoundObject

_SPACING = 0.005
"""Metres, the spacing of the map's points."""


def edge_points(objects: Sequence[FoundObject]) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Points along the edges of the objects' boxes, at most 5 mm apart, in the colours of their labels.

    Returns (n, 3) metres, world, and (n, 3) RGB.
    """
    xyz, rgb = [np.zeros((0, 3))], [np.zeros((0, 3), np.uint8)]
    for item in objects:
        for start, end in corners(item.box)[EDGES]:
            count = 1 + int(np.ceil(np.linalg.norm(end - start) / _SPACING))
            xyz.append(np.linspace(start, end, count))
            rgb.append(np.full((count, 3), object_colour(item.id), np.uint8))
    return np.concatenate(xyz).astype(np.float32), np.concatenate(rgb)
