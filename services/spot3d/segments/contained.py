"""Join a part that lies in another part's box: two objects never fill the same space.

The inside of a bowl and its outside are one object, though no surface connects them, and so are the top of a book and
its sides. But the box of a crate or of a shelf has room for other objects. A camera sees them through that room, or
sees the floor that they stand on.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.geometry.quantiles import quantiles
from spot3d.geometry.upright import share_inside, taken, upright_box
from spot3d.segments.hanging import STANDS
from spot3d.trajectory import rotation_to_z

_SHARE = 0.5
"""A part with this share of its points in another's box joins it. Success of single frames with 0.25, 0.5, 1: on OSD
0.97, 0.96, 0.95, in a room 0.86, 0.85, 0.83, on HOTS and in clutter the same."""
_SAMPLE = 1000
"""About this many of a part's points determine its box."""
_TRIM = 0.005
"""Share of a part's points that may lie beyond each face of its box."""
_MARGIN = 0.005
"""The two faces of a thin wall (a bowl's, a mug's) lie about this far apart, metres. With this and `_TRIM` halved and
doubled, success and detection are within 0.008."""
_BULGES = 0.3
"""A part whose normals point away from its middle by this share of its size is an object of its own. Half a ball has
0.7, a cube seen from above at an angle 0.4 to 0.5, a flat part none, a hollow a negative one. Detection with 0.15, 0.2
and 0.3, and 0.25, 0.5 and 1 for `_ROOM`: 0.85 on three workbenches with objects in a crate, 0.88 to 0.91 on three
shelves; 0.73 and 0.70 if every part in a box is joined. Below 0.3 a pot of OSD and its handle are two."""
_ROOM = 1.0
"""Room in front of such a part that another's box must have, as a multiple of its size (rms from its middle)."""
_AROUND = (3, 7)
"""Pixels within the larger of these squares around a part's pixels, but not within the smaller, are beside the part:
depth at an edge is unreliable. With (3, 5) and (5, 9) five bins have the same detection, 0.92."""
_FLOOR = 0.6
"""More than this share of the pixels beside an object that stands within another is one floor. Detection with 0.5, 0.6,
0.67 and 0.75: 0.85, 0.85, 0.82 and 0.80 (six bins seen from above, six objects in each); without this rule 0.60 (three
of them). The neck of a screen, above its foot, is an object in ten keyframes of three desks with 0.5, in three with
0.6."""
_LOWEST = 0.1
"""This share of the pixels beside a part may lie lower than the floor: noise, and flying pixels. With 0.05 and 0.2 it
is the same."""
_UP = np.array((0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """points, normals: (h, w, 3) float32, camera frame; R: (3, 3) float32, rows of both times R are upright."""

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    R: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """pixels: (n,) flat indices; places, normals: (m, 3) float32, of some of them, upright, the camera at the origin;
    box: around these places."""

    pixels: NDArray[np.int64]
    places: NDArray[np.float32]
    normals: NDArray[np.float32]
    box: Box3D


def join_contained(
    parts: list[NDArray[np.int64]], points: NDArray[np.float32], normals: NDArray[np.float32], up: NDArray[np.float64]
) -> list[NDArray[np.int64]]:
    """The parts after joining each with a larger one if half of the points of one lie in the other's upright box.

    Parts that only touch stay apart, and so does a part in the room that another's box has, or on its floor. The
    smallest joins first, with the part of the largest share.
    parts: flat pixel indices; points, normals: (h, w, 3) float32, camera frame, metres and unit; up: (3,) unit.
    """
    view = _View(points, normals, rotation_to_z(up).T.astype(np.float32))
    known = [_part(pixels, view) for pixels in sorted(parts, key=len)]
    centre = np.array([part.box.centre for part in known]).reshape(-1, 3)
    radius = np.linalg.norm(np.array([part.box.size for part in known]).reshape(-1, 3), axis=1) / 2 + _MARGIN
    gone = np.zeros(len(known), np.bool_)
    for i, part in enumerate(known):
        near = ((centre[i + 1 :] - centre[i]) ** 2).sum(axis=1) < (radius[i + 1 :] + radius[i]) ** 2
        inside = {
            j: max(_inside(part, known[j], view), _inside(known[j], part, view))
            for j in (np.flatnonzero(near) + i + 1).tolist()
        }
        j = max(inside, key=inside.__getitem__, default=i)
        if inside.get(j, 0.0) >= _SHARE:
            gone[i] = True
            known[j] = _part(np.concatenate((known[j].pixels, part.pixels)), view)
            centre[j], radius[j] = known[j].box.centre, np.linalg.norm(known[j].box.size) / 2 + _MARGIN
    return [part.pixels for part, joined in zip(known, gone, strict=True) if not joined]


def _part(pixels: NDArray[np.int64], view: _View) -> _Part:
    some = pixels[:: max(1, len(pixels) // _SAMPLE)]
    places, facing = (taken(of.reshape(-1, 3), some) @ view.R for of in (view.points, view.normals))
    return _Part(pixels, places, facing, upright_box(places, _UP, trim=_TRIM))


def _inside(part: _Part, other: _Part, view: _View) -> float:
    """Share of a part's points in another's box; 0 if the part is an object in the other's room, or on its floor."""
    inside = share_inside(part.places, other.box, _MARGIN)
    if inside < _SHARE:
        return inside
    outwards = part.places - part.places.mean(axis=0)
    size = float(np.sqrt((outwards**2).sum(axis=1).mean()))
    bulges = (outwards * part.normals).sum(axis=1).mean() >= _BULGES * size
    if (bulges and _room(part, other.box) > _ROOM * size) or _stands_in(part, other.box, size, view):
        return 0.0
    return inside


def _room(part: _Part, box: Box3D) -> float:
    """Median length, metres, that the lines from a part to the camera are within the box."""
    towards, at = -part.places @ box.rotation, (part.places - box.centre) @ box.rotation
    # The share of each line that is within the box, by the faces of each axis.
    within = (box.size / 2 - np.sign(towards) * at) / np.maximum(np.abs(towards), 1e-9)
    return float(np.median(within.min(axis=1) * np.linalg.norm(part.places, axis=1)))


def _stands_in(part: _Part, box: Box3D, size: float, view: _View) -> bool:
    """Whether most pixels beside a part show one floor within the box's outline, farther below the part's top than the
    part's size."""
    flat = view.points.reshape(-1, 3)
    beside = _beside(part.pixels, view.points.shape[:2])
    beside = beside[flat[beside, 2] > 0]
    places = taken(flat, beside) @ view.R
    level = np.abs((places - box.centre) @ box.rotation[:, :2]) <= box.size[:2] / 2
    places = places[level.all(axis=1)]
    if len(places) <= _FLOOR * len(beside):
        return False
    (floor,) = quantiles(places[:, 2], _LOWEST)
    on_floor = np.count_nonzero(places[:, 2] < floor + STANDS) > _FLOOR * len(beside)
    return bool(on_floor and floor < part.places[:, 2].max() - size)


def _beside(pixels: NDArray[np.int64], shape: tuple[int, ...]) -> NDArray[np.int64]:
    """The flat indices of the pixels beside these; see `_AROUND`."""
    mask = np.zeros(shape, np.uint8)
    mask.ravel()[pixels] = 1
    near, far = (cv2.dilate(mask, np.ones((side, side), np.uint8)) for side in _AROUND)
    return np.flatnonzero(far > near)
