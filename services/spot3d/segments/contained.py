"""What lies in another part's box is a part of the same thing: two things never fill the same space.

The inside of a bowl and its outside are one object, though no surface connects them, and so are the top of a book and
its sides. But the box of a crate or of a shelf has room for things, and a camera sees them through that.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.geometry.upright import rotation_to_upright, sampled, share_inside, upright_box

_TRIM = 0.005
"""Share of a part's points that may lie beyond each face of its box."""
_MARGIN = 0.005
"""The two faces of a thin wall (a bowl's, a mug's) lie about this far apart, metres."""
_BULGES = 0.3
"""A part whose normals lean away from its middle by this much of its size is a body of its own: those of half a ball do
by 0.7, those of a cube seen from above at an angle by 0.4 to 0.5, a flat part's not, a hollow's the other way. With
0.15, 0.2 and 0.3, and 0.25, 0.5 and 1 of `_ROOM`, three workbenches with things in a crate have a detection of 0.85,
three shelves of 0.88 to 0.91: 0.73 and 0.70 where whatever lies in a box is joined. Below 0.3 a pot of OSD and its
handle are two."""
_ROOM = 1.0
"""... if another's box has so much room in front of it, as a multiple of its size (rms from its middle)."""
_UP = np.array((0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """pixels: (n,) flat numbers; places, normals: (m, 3) float32, of some of them, upright, seen from the origin;
    box: around these."""

    pixels: NDArray[np.int64]
    places: NDArray[np.float32]
    normals: NDArray[np.float32]
    box: Box3D


def join_contained(
    parts: list[NDArray[np.int64]],
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    up: NDArray[np.float64],
    share: float,
) -> list[NDArray[np.int64]]:
    """Join a part with the larger one in whose upright box at least `share` of its points lie, or the other way round.

    Parts that only touch stay apart, and so does what is seen in the room that another's box has. The smallest joins
    first, into the box that holds most of it.
    parts: flat pixel numbers; points, normals: (h, w, 3) float32, camera frame, metres and unit; up: (3,) unit.
    """
    flat, facing, R = points.reshape(-1, 3), normals.reshape(-1, 3), rotation_to_upright(up).T.astype(np.float32)

    def part_of(pixels: NDArray[np.int64]) -> _Part:
        places = sampled(flat, pixels) @ R
        return _Part(pixels, places, sampled(facing, pixels) @ R, upright_box(places, _UP, turn=True, trim=_TRIM))

    known = [part_of(pixels) for pixels in sorted(parts, key=len)]
    centre = np.array([part.box.centre for part in known]).reshape(-1, 3)
    radius = np.linalg.norm(np.array([part.box.size for part in known]).reshape(-1, 3), axis=1) / 2 + _MARGIN
    gone = np.zeros(len(known), np.bool_)
    for i, part in enumerate(known):
        near = ((centre[i + 1 :] - centre[i]) ** 2).sum(axis=1) < (radius[i + 1 :] + radius[i]) ** 2
        inside = {
            j: max(_inside(part, known[j], share), _inside(known[j], part, share))
            for j in (np.flatnonzero(near) + i + 1).tolist()
        }
        j = max(inside, key=inside.__getitem__, default=i)
        if inside.get(j, 0.0) >= share:
            gone[i] = True
            known[j] = part_of(np.concatenate((known[j].pixels, part.pixels)))
            centre[j], radius[j] = known[j].box.centre, np.linalg.norm(known[j].box.size) / 2 + _MARGIN
    return [part.pixels for part, joined in zip(known, gone, strict=True) if not joined]


def _inside(part: _Part, other: _Part, share: float) -> float:
    """Share of a part's points in another's box; 0 where the part is a thing in the room that this has."""
    inside = share_inside(part.places, other.box, _MARGIN)
    return 0.0 if inside >= share and _is_in_room(part, other.box) else inside


def _is_in_room(part: _Part, box: Box3D) -> bool:
    """Whether a part bulges, and there is room before it within the box, on the way to the camera."""
    outwards = part.places - part.places.mean(axis=0)
    size = float(np.sqrt((outwards**2).sum(axis=1).mean()))
    if (outwards * part.normals).sum(axis=1).mean() < _BULGES * size:
        return False
    towards, at = -part.places @ box.rotation, (part.places - box.centre) @ box.rotation
    # The share of the way to the camera that is within the box, face by face.
    within = (box.size / 2 - np.sign(towards) * at) / np.maximum(np.abs(towards), 1e-9)
    room = within.min(axis=1) * np.linalg.norm(part.places, axis=1)
    return bool(np.median(room) > _ROOM * size)
