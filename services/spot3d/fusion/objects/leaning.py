"""A thin sheet that leans, as a laptop's lid: its lower edge is all that it could stand on."""

import numpy as np

from spot3d.boxes import Box3D
from spot3d.fusion.objects.found import Seen, ends_of, faces

_TILTS = ((15.0, 7), (5.0, 3), (5 / 3, 3))
"""So many tilts, so many degrees apart, are tried, then others around the best: a degree off, a sheet of 25 cm is less
than half a centimetre thicker."""


def lower_edge(seen: Seen, box: Box3D, thin: float) -> Box3D | None:
    """The upright box around the lower edge of a sheet that leans, without a height, at the bottom of its box.

    thin: a sheet is less thick than so much of its length, and what leans less than so much stands upright. None of
    what is no sheet, stands, or lies: reaches further level than up.
    """
    edges = (_edge_along(seen, box, axis, thin) for axis in (0, 1) if box.size[axis] <= box.size[2])
    return min((edge for edge in edges if edge is not None), key=lambda edge: float(edge.size[:2].min()), default=None)


def _edge_along(seen: Seen, box: Box3D, axis: int, thin: float) -> Box3D | None:
    """As `lower_edge`, of a sheet that leans along this one of the box's level axes."""
    level, up, tilt = box.rotation[:, axis], box.rotation[:, 2], 0.0
    for step, count in _TILTS:
        tilts = tilt + np.radians(step) * (np.arange(count) - count // 2)
        low, high = faces(*ends_of(seen, np.outer(level, np.cos(tilts)) - np.outer(up, np.sin(tilts))))
        best = int(np.argmin(high - low))
        tilt, thick, middle = float(tilts[best]), float(high[best] - low[best]), float(low[best] + high[best]) / 2
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
