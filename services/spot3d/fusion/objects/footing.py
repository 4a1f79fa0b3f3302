"""What an object could stand on, as far as it was seen: mostly its whole box; a lid's lower edge; a screen's neck."""

import numpy as np

from spot3d.boxes import Box3D
from spot3d.fusion.objects.found import STANDS, THINNEST, ObjectViews, ends_of, faces

_TILTS = ((15.0, 7), (5.0, 3), (5 / 3, 3))
"""Step, degrees, and number of the tilts tried in turn, each around the best before: a degree off, a sheet of 25 cm is
less than half a centimetre thicker."""
_TOLD = 3
"""Least points, and views, that tell a foot's width: two points are its edges, and one more is no accident."""
_ASIDE = 1e-3
"""Nearer to straight above than this, metres to the side, a view has no left or right."""


def lower_edge(seen: ObjectViews, box: Box3D, thin: float) -> Box3D | None:
    """The upright box, without a height, around the lower edge of a leaning sheet, at the bottom of its box.

    thin: a sheet is thinner than this share of its length, and upright if the tangent of its tilt is less. None for
    what is no sheet, stands, or lies: reaches further level than up.
    """
    edges = (_edge_along(seen, box, axis, thin) for axis in (0, 1) if box.size[axis] <= box.size[2])
    return min((edge for edge in edges if edge is not None), key=lambda edge: float(edge.size[:2].min()), default=None)


def narrow_foot(seen: ObjectViews, box: Box3D, thin: float) -> Box3D | None:
    """The upright box, without a height, around the foot of an object that would fall over on it to the left or right.

    None if it would not, or if too few views see the bottom. A foot hides its depth, and what stands before it its
    width: the view that sees most of it decides. The box is the median over the views. thin: the object falls if its
    middle is less than this share of the middle's height inside the foot's edge.
    """
    up, places = box.rotation[:, 2], seen.places.astype(np.float64) - box.centre
    low = places @ up < STANDS - box.size[2] / 2
    right = np.cross(places.mean(axis=1) + box.centre - seen.eyes, up)
    aside = np.linalg.norm(right, axis=1)
    across = np.einsum("nki,ni->nk", places, right / np.maximum(aside, _ASIDE)[:, None])
    middle = (across.min(axis=1) + across.max(axis=1)) / 2
    left = np.where(low, across, np.inf).min(axis=1)
    beside = np.minimum(middle - left, np.where(low, across, -np.inf).max(axis=1) - middle)
    told = (low.sum(axis=1) >= _TOLD) & (aside > _ASIDE)
    if told.sum() < _TOLD or beside[told].max() >= thin * box.size[2] / 2:
        return None
    level, low = places[told] @ box.rotation[:, :2], low[told][:, :, None]
    least = np.median(np.where(low, level, np.inf).min(axis=1), axis=0)
    most = np.median(np.where(low, level, -np.inf).max(axis=1), axis=0)
    centre = box.centre + box.rotation @ np.append((least + most) / 2, -box.size[2] / 2)
    return Box3D(centre, np.append(most - least, 0.0), box.rotation)


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
