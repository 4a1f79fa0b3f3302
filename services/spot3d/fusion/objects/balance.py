"""What is too thin to stand by itself is a part of what it stands on: a screen of its foot, a pole of its base.

Seen from near, things come apart where they are creased, and all views agree on it. What stands on another thing is as
creased there, but it can stand. How far it is carried is not asked: what carries it is hidden by it.
"""

from collections.abc import Mapping
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D, corners
from spot3d.fusion.objects.found import STANDS
from spot3d.geometry.upright import upright_box

_TILT = np.tan(np.radians(10))
"""No product may tip where it is tilted by 10 degrees (IEC 62368-1, stability of equipment): what would is none of its
own."""
_TOUCHES = 0.01
"""Boxes that are no further apart sideways touch, metres: as much as a face is off."""
_MOSTLY = 0.5
"""What seems to stand where another thing lies stands on that one, if so much of it is above it."""

Numbers = tuple[int, ...]
"""Of the pieces that are one thing, in ascending order."""


class Piece(NamedTuple):
    """An upright box, and how high the plane is that it stands above, along up, metres; NaN = not known."""

    box: Box3D
    ground: float


def put_together(pieces: Mapping[int, Piece], up: NDArray[np.float64], size_max: float) -> dict[Numbers, Box3D]:
    """The things that pieces are, by the numbers of these: each piece is in one thing.

    up: (3,) unit, world. size_max: no thing that is put together has a longer edge, metres.
    """
    things: dict[Numbers, Piece] = {(number,): piece for number, piece in pieces.items()}
    # From above: what a part carries stands on the whole of which it is one.
    waiting = sorted(things, key=lambda numbers: (-_ends(things[numbers].box, up)[0], numbers))
    while waiting:
        part = waiting.pop(0)
        carrier = _carrier_of(part, things, up)
        if not carrier:
            continue
        around = np.concatenate([corners(things[numbers].box) for numbers in (part, carrier)])
        box = upright_box(around.astype(np.float32), up, turn=True)
        if box.size.max() > size_max:
            continue
        ground = things[carrier].ground
        del things[part], things[carrier]
        together = tuple(sorted(part + carrier))
        things[together] = Piece(box, ground)
        waiting = [together, *(numbers for numbers in waiting if numbers != carrier)]
    return {numbers: thing.box for numbers, thing in things.items()}


def _carrier_of(part: Numbers, things: Mapping[Numbers, Piece], up: NDArray[np.float64]) -> Numbers:
    """The thing that a part is fixed to, as it cannot stand on it by itself; () where there is none."""
    (box, ground), axes = things[part], things[part].box.rotation
    if box.size[:2].min() >= _TILT * box.size[2]:
        return ()
    floats = not abs(_ends(box, up)[0] - ground) < STANDS
    foot, carriers = _outline(box, axes), []
    for numbers in _beneath(part, things, up):
        below = things[numbers].box
        shared, _ = cv2.intersectConvexConvex(foot, _outline(below, axes))
        touched = floats and cv2.intersectConvexConvex(foot, _outline(below, axes, _TOUCHES))[0] > 0
        if touched or shared >= _MOSTLY * box.size[0] * box.size[1]:
            carriers.append((-shared, numbers))
    return min(carriers)[1] if carriers else ()


def _beneath(part: Numbers, things: Mapping[Numbers, Piece], up: NDArray[np.float64]) -> list[Numbers]:
    """The other things that end where a part begins, and lie no further from it sideways than they reach."""
    others = [numbers for numbers in things if numbers != part]
    if not others:
        return []
    centres, sizes = (np.array([getattr(things[n].box, name) for n in others]) for name in ("centre", "size"))
    box, heights = things[part].box, centres @ up
    lows, highs, low = heights - sizes[:, 2] / 2, heights + sizes[:, 2] / 2, _ends(box, up)[0]
    away = centres - box.centre
    away = np.linalg.norm(away - np.outer(away @ up, up), axis=1)
    reach = (np.linalg.norm(sizes[:, :2], axis=1) + np.linalg.norm(box.size[:2])) / 2 + 2 * _TOUCHES
    near = (np.abs(low - highs) < STANDS) & (lows < low + _TOUCHES) & (away < reach)
    return [numbers for numbers, is_near in zip(others, near.tolist(), strict=True) if is_near]


def _ends(box: Box3D, up: NDArray[np.float64]) -> tuple[float, float]:
    """How high an upright box begins and ends, along up."""
    height = float(up @ box.centre)
    return height - float(box.size[2]) / 2, height + float(box.size[2]) / 2


def _outline(box: Box3D, axes: NDArray[np.float64], wider: float = 0.0) -> NDArray[np.float32]:
    """The (4, 2) corners of an upright box seen from above, along the first two of upright axes, the columns of (3, 3).

    wider: by so much to each side, metres.
    """
    x, y = box.size[:2] / 2 + wider
    level = np.array(((-x, -y), (x, -y), (x, y), (-x, y)))
    return ((box.centre + level @ box.rotation[:, :2].T) @ axes[:, :2]).astype(np.float32)
