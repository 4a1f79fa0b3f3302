"""What is round about an upright axis, and how far it goes on behind what is seen of it: cans, balls, mugs, pots.

A view shows half of such a thing or less, and the box of what is seen from one side is half as deep as wide. That it is
round shows on its front: a surface of revolution fits it, of which the square of the radius is a parabola over the
height, as of cylinders, cones and spheres. The curves below are of all things of seven rendered desks and tables and of
redkitchen: the sum of what they gain in IoU, and the most that one of them loses.
"""

import numpy as np
from numpy.typing import NDArray

_VIEWS = 10
"""So many segments are looked at, evenly spread over an object's views."""
_LEAST = 3
"""Of fewer segments nothing is said, as of fewer views nothing is an object: what one or two show is soon wrong."""
_TESTED = 4
"""One in this many of a segment's points is fitted: 50."""
_STEPS = 4
"""The fit follows most of the points within so many steps: handles and what flies off edges are left aside. With 10 it
is the same."""
_OFF = 0.005
"""What lies no further from the surface than this is on it, metres, as on a plane (`fusion.plane_distance`). Gained
with 4, 5, 6, 8, 10 mm: 1.3, 1.7, 1.7, 1.7, 1.7, nothing lost. Of what passes for round in single frames of HOTS, mostly
cans and fruit, 11 are and 1 is not with 4 mm, 20 and 1 with 5, 22 and 4 with 6 (three cartons), 29 and 3 with 8."""
_CORNER = 1 / 6
"""And no further than this share of the radius there: a cube across its corner differs from a circle by as much.
Without it cubes of 7 cm pass for round with `_OFF` at 8 mm, and lose 0.1, and of HOTS' frames one thing more."""
_ON = 0.75
"""So much of what is seen is on the surface of a round thing: of balls, cans, mugs, bottles, pots, real and rendered,
0.8 to 1, of cubes 0.65 to 0.75, of all else less than 0.6. Gained with 0.6, 0.65, 0.7, 0.75, 0.8, 0.85: 1.6, 1.7, 1.7,
1.7, 1.7, 0.6; lost 0.09 with the first. Right and wrong in HOTS' frames with 0.7, 0.75, 0.8: 35 and 3, 20 and 1, 11 and
0."""
_HOPELESS = 0.5
"""Where so little of what most views see is on it after a step, nothing is round: most things take no second one."""
_AROUND = np.deg2rad(120.0)
"""So much of its circumference is seen: half an ellipse that is less deep than 0.6 of its width shows less. From 60 to
135 degrees the gain is the same."""
_TALL = 0.8
"""So many times its radius a round thing is high, as far as it is seen: over what is lower one sees its whole outline.
Pots have 1, balls 1.4 to 1.8, mugs 2, computer mice, which are oval, 0.5 to 0.7: seen from 20 to 50 degrees above they
pass for round. With 0 to 1 the gain is the same."""
_GRAZING = np.cos(np.deg2rad(75.0))
"""A view shows a side that it looks at under less than this: depth ends there."""
_SEEN = 0.1
"""A side that more than this share of the views show is where they have it: a square pole that one walks around stays
as slim as it is. With 0 to 0.5 the gain is the same."""
_BETWEEN = 0.2
"""Weights: near the axis, in shares of half of its width, a fit of the radius' square would follow every error."""


def unseen_ends(
    places: NDArray[np.float32], eyes: NDArray[np.float64], rotation: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Where a round thing ends along the first two axes, (2,) each, metres, as half of its views have it; NaN at a side
    that was seen. None: most of its segments are not round, or there are too few.

    places: (n, k, 3) of its segments, world; eyes: (n, 3) from where; rotation: (3, 3) axes as columns, the third
    upright.
    """
    if len(places) < _LEAST:
        return None
    points = places[:: -(-len(places) // _VIEWS), ::_TESTED].astype(np.float64) @ rotation
    middle, extent = points.mean(axis=1, keepdims=True), np.ptp(points, axis=1)
    half = np.maximum(extent[:, :2].max(axis=1), _OFF) / 2
    centre, radius, height, fits = _fitted((points - middle) / half[:, None, None], half)
    # What is lower is not told to be round behind as well.
    is_round = fits & (extent[:, 2] >= _TALL * half) & (height >= _TALL * radius)
    if 2 * np.count_nonzero(is_round) <= len(is_round):
        return None
    towards = (eyes - places[:, ::_TESTED].mean(axis=1)) @ rotation[:, :2]
    along = towards / np.maximum(np.linalg.norm(towards, axis=1), _OFF)[:, None]
    low_seen, high_seen = ((side > _GRAZING).mean(axis=0) > _SEEN for side in (-along, along))
    centre = (middle[:, 0, :2] + half[:, None] * centre)[is_round]
    radius = (half * radius)[is_round, None]
    low, high = np.median(centre - radius, axis=0), np.median(centre + radius, axis=0)
    return np.where(low_seen, np.nan, low), np.where(high_seen, np.nan, high)


def _fitted(
    points: NDArray[np.float64], unit: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """The axis (n, 2), the largest radius and the height (n,) of the surface of revolution through each of (n, k, 3)
    segments, and whether it fits. unit: (n,) metres, of the points."""
    level, height = points[..., :2], points[..., 2]
    terms = np.concatenate((level, np.stack((np.ones_like(height), height, height**2), axis=2)), axis=2)
    square = (level**2).sum(axis=2)
    weight = np.ones_like(height)
    for _ in range(_STEPS):
        # x2 + y2 = 2 cx x + 2 cy y + a + b h + c h2
        weighted = (terms * weight[..., None]).transpose(0, 2, 1)
        found = np.linalg.solve(weighted @ terms + 1e-6 * np.eye(5), weighted @ square[..., None])[..., 0]
        axis = found[:, :2] / 2
        arm = level - axis[:, None]
        by_height = (terms[..., 2:] @ found[:, 2:, None])[..., 0]
        radius = np.sqrt(np.maximum((axis**2).sum(axis=1)[:, None] + by_height, 1e-6))
        off = unit[:, None] * np.abs(np.hypot(arm[..., 0], arm[..., 1]) - radius)
        if np.median((off < _OFF).mean(axis=1)) < _HOPELESS:
            break
        # Geman-McClure
        weight = 1 / ((1 + (off / _OFF) ** 2) * np.maximum(radius, _BETWEEN)) ** 2
    on = off < np.minimum(_OFF, _CORNER * unit[:, None] * radius)
    towards = np.where(on[..., None], arm, 0).sum(axis=1, keepdims=True)
    across = arm[..., 0] * towards[..., 1] - arm[..., 1] * towards[..., 0]
    angle = np.where(on, np.arctan2(across, (arm * towards).sum(axis=2)), 0.0)
    fits = (on.mean(axis=1) >= _ON) & (np.ptp(angle, axis=1) >= _AROUND)
    return axis, np.where(on, radius, 0.0).max(axis=1), np.ptp(np.where(on, height, 0.0), axis=1), fits
