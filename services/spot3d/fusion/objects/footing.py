"""What an object could stand on: mostly its whole box; what leans, a lid, on its lower edge."""

import numpy as np

from spot3d.boxes import Box3D
from spot3d.fusion.objects.found import THINNEST, ObjectViews, ends_of, faces

_TILTS = ((15.0, 7), (5.0, 3), (5 / 3, 3))
"""Step, degrees, and number of the tilts tried in turn, each around the best before: a degree off, a sheet of 25 cm is
less than half a centimetre thicker."""


def lower_edge(seen: ObjectViews, box: Box3D, thin: float) -> Box3D | None:
    """The upright box, without a height, around the lower edge of a leaning sheet, at the bottom of its box.

    thin: a sheet is thinner than this share of its length, and upright if the tangent of its tilt is less. None for
    what is no sheet, stands, or lies: reaches further level than up.
    """
    edges = (_edge_along(seen, box, axis, thin) for axis in (0, 1) if box.size[axis] <= box.size[2])
    return min((edge for edge in edges if edge is not None), key=lambda edge: float(edge.size[:2].min()), default=None)


def _edge_along(seen: ObjectViews, box: Box3D, axis: int, thin: float) -> Box3D | None:
    """As `lower_edge`, for a sheet that leans along this one of the box's level axes."""
    level, up, tilt = box.rotation[:, axis], box.rotation[:, 2], 0.0
    for step, count in _TILTS:
        tilts = tilt + np.radians(step) * (np.arange(count) - count // 2)
        low, high = faces(*ends_of(seen, np.outer(level, np.cos(tilts)) - np.outer(up, np.sin(tilts))))
        best = int(np.argmin(high - low))
        tilt, middle = float(tilts[best]), float(low[best] + high[best]) / 2
        thick = max(THINNEST, float(high[best] - low[best]))
        length = float(box.size[2]) / np.cos(tilt)
        if thick >= (thin + np.tan(np.radians(step) / 2)) * length:
            return None
    if thick >= thin * length or abs(np.tan(tilt)) < thin:
        return None
    # Where the middle of the sheet meets the bottom of the box.
    bottom = box.centre - box.size[2] / 2 * up
    place = (middle + float(up @ bottom) * np.sin(tilt)) / np.cos(tilt)
    size = np.array((*box.size[:2], 0.0))
    size[axis] = thick / np.cos(tilt)
    return Box3D(bottom + (place - float(level @ bottom)) * level, size, box.rotation)
