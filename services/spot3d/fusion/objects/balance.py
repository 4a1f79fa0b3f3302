"""What cannot stand by itself is a part of what it stands on: a screen of its foot, a lid of its laptop.

If nothing carries it, it is a part of what has it in its box: a leg of its stool.

Seen from near, objects come apart at creases, and all views agree on it. There is such a crease below an object on
another one too, but that object can stand. How much of a part is carried is not tested: it hides its carrier. Nor is
the carrier's heat: a laptop's base is flat and without edges, and alone would be too cold for an object.
"""

from collections.abc import Mapping, Set
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D, corners, iou_matrix_3d
from spot3d.fusion.objects.found import STANDS
from spot3d.geometry.upright import upright_box

TILT = np.tan(np.radians(10))
"""No product may tip when tilted by 10 degrees (IEC 62368-1, stability of equipment): what would is no separate object.
With 7, 10, 15 degrees on four near desks: detection 0.89, 0.95, 0.95, success rate 0.71, 0.83, 0.84. With 7, 10, 15, 20
degrees, without lower edges and narrow feet, on single frames of OSD: 0.939, 0.939, 0.930, 0.920. On redkitchen,
clutter, far desks nothing changes."""
_BESIDE = 0.02
"""What hangs in the air is fixed to what reaches up to it from below, within this distance, metres: a neck to the back
of its screen, of which only the front is seen. On five rendered desks (not built in) with two such screens each:
detection 0.88 and success 0.86 with 1, 2, 3 and 5 cm, 0.83 and 0.74 without; elsewhere it is the same.
"""
_INSIDE = 0.5
"""What cannot stand by itself, and has no carrier, is a part of what has at least this share of it in its box: a leg of
its stool. Two objects never fill the same space. On two floors with stools success is 0.73 with 0.25, 0.5 and 0.75, and
0.61 without; on eleven other scenes nothing changes."""
_LEVEL = np.array((1.0, 1.0, 0.0))
Numbers = tuple[int, ...]
"""Numbers of the pieces of one object, ascending."""


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """An object, or a part of one.

    box: upright; ground: height along up of the plane that it stands above, metres; NaN = unknown; foot: upright box of
    what it could stand on: itself, or its lower edge if it leans (see `footing`).
    """

    box: Box3D
    ground: float
    foot: Box3D
    leans: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Thing:
    """A piece, or several as one, with what every other one asks of it, computed once.

    low, top: heights along up at which its box begins and ends, metres; volume: cubic metres.
    """

    piece: Piece
    low: float
    top: float
    volume: float


def _thing(piece: Piece, up: NDArray[np.float64]) -> _Thing:
    height, half = float(up @ piece.box.centre), float(piece.box.size[2]) / 2
    return _Thing(piece, height - half, height + half, piece.box.volume)


def put_together(
    pieces: Mapping[int, Piece], hot: Set[int], up: NDArray[np.float64], size_max: float
) -> dict[Numbers, Box3D]:
    """The boxes of the objects that pieces form, by the pieces' numbers; pieces that are too cold may be in none.

    hot: the pieces that are objects; the others are in an object only if they carry one of these. up: (3,) unit, world.
    size_max: longest edge, metres, of an object of several pieces.
    """
    things: dict[Numbers, _Thing] = {(number,): _thing(piece, up) for number, piece in pieces.items()}
    # From above: what a part carries stands on the whole to which the part belongs.
    parts: list[Numbers] = [(number,) for number in hot]
    waiting = sorted(parts, key=lambda numbers: (-things[numbers].low, numbers))
    while waiting:
        part = waiting.pop(0)
        carrier = _carrier_of(part, things)
        if not carrier:
            continue
        around = np.concatenate([corners(things[numbers].piece.box) for numbers in (part, carrier)])
        box = upright_box(around.astype(np.float32), up)
        if box.size.max() > size_max:
            continue
        whole = _thing(replace(things[carrier].piece, box=box), up)
        del things[part], things[carrier]
        together = tuple(sorted(part + carrier))
        things[together] = whole
        waiting = [together, *(numbers for numbers in waiting if numbers != carrier)]
    return {numbers: thing.piece.box for numbers, thing in things.items() if not hot.isdisjoint(numbers)}


def _cannot_stand(piece: Piece) -> bool:
    """Whether a piece would fall over: its centre is too near to an edge of its foot for its height."""
    box, foot = piece.box, piece.foot
    aside = np.abs((box.centre - foot.centre) @ foot.rotation[:, :2])
    return bool((foot.size[:2] / 2 - aside).min() < TILT * box.size[2] / 2)


def _carrier_of(part: Numbers, things: Mapping[Numbers, _Thing]) -> Numbers:
    """The object that a part is fixed to, as it cannot stand on it by itself; () if there is none."""
    piece, low = things[part].piece, things[part].low
    if not _cannot_stand(piece):
        return ()
    # Fixed to more than a plane.
    held = piece.leans or not abs(low - piece.ground) < STANDS
    foot, axes = piece.foot, piece.foot.rotation
    grown = replace(foot, size=foot.size + 2 * _BESIDE * _LEVEL) if held else foot
    reached, carriers = _outline(grown, axes), []
    x, y = (foot.centre @ axes)[:2].tolist()
    for numbers, other in things.items():
        if numbers == part or abs(low - other.top) >= STANDS:
            continue
        below = _outline(other.piece.box, axes)
        shared, _ = cv2.intersectConvexConvex(reached, below)
        # A piece on a plane stands there beside other objects, whose boxes may reach beneath its own.
        if shared > 0 and (held or cv2.pointPolygonTest(below, (x, y), False) >= 0):
            carriers.append((-shared, numbers))
    return min(carriers)[1] if carriers else _around(part, things)


def _around(part: Numbers, things: Mapping[Numbers, _Thing]) -> Numbers:
    """The larger object that has most of a part in its box, and at least half; () if there is none."""
    own = things[part]
    larger = [numbers for numbers, other in things.items() if other.volume > own.volume]
    if not larger:
        return ()
    iou = iou_matrix_3d([own.piece.box], [things[numbers].piece.box for numbers in larger])[0]
    volumes = np.array([things[numbers].volume for numbers in larger])
    inside = iou / (1 + iou) * (1 + volumes / own.volume)
    best = int(inside.argmax())
    return larger[best] if inside[best] >= _INSIDE else ()


def _outline(box: Box3D, axes: NDArray[np.float64]) -> NDArray[np.float32]:
    """The (4, 2) corners of an upright box seen from above, along the first two columns of upright axes (3, 3)."""
    x, y = box.size[:2] / 2
    level = np.array(((-x, -y), (x, -y), (x, y), (-x, y)))
    return ((box.centre + level @ box.rotation[:, :2].T) @ axes[:, :2]).astype(np.float32)
