"""Which objects are round about an upright axis, and how far they go on behind what is seen: cans, balls, mugs, pots.

A view shows half of such an object or less, and the box of what is seen from one side is half as deep as wide. Its
front shows that it is round: a surface of revolution fits it, whose squared radius is a parabola over the height, as
for cylinders, cones and spheres. The numbers below are of all objects of seven rendered desks and tables and of
redkitchen: gained is the sum of their gains in IoU, lost the most that one of them loses.
"""

import numpy as np
from numpy.typing import NDArray

_VIEWS = 10
"""Most segments that are fitted, evenly spread over an object's views."""
_LEAST = 3
"""With fewer segments nothing is round, as with fewer views nothing is an object: one or two are soon wrong."""
_TESTED = 4
"""One in this many of a segment's points is fitted: 50."""
_STEPS = 4
"""Steps of the fit, which follows most of the points: handles and what flies off edges are left aside. With 10 it is
the same."""
_OFF = 0.005
"""A point no further from the surface than this is on it, metres, as on a plane (`fusion.plane_distance`). With 4, 5,
6, 8, 10 mm: gained 1.3, 1.7, 1.7, 1.7, 1.7, nothing lost. Of the objects that count as round in single frames of HOTS,
mostly cans and fruit, 11 are and 1 is not with 4 mm, 20 and 1 with 5, 22 and 4 with 6 (three cartons), 29 and 3 with
8."""
_CORNER = 1 / 6
"""And no further than this share of the radius there: a cube across its corner differs from a circle by as much.
Without it, with `_OFF` at 8 mm, cubes of 7 cm count as round and lose 0.1, and so does one more object of HOTS'
frames."""
_ON = 0.75
"""Share of the points seen that lie on a round object's surface. Balls, cans, mugs, bottles, pots, real and rendered:
0.8 to 1; cubes: 0.65 to 0.75; all else: less than 0.6. With 0.6, 0.65, 0.7, 0.75, 0.8, 0.85: gained 1.6, 1.7, 1.7, 1.7,
1.7, 0.6; lost 0.09 with the first. Right and wrong in HOTS' frames with 0.7, 0.75, 0.8: 35 and 3, 20 and 1, 11 and
0."""
_HOPELESS = 0.5
"""If most views have less than this share on the surface after a step, nothing is round: most objects take one step."""
_AROUND = np.deg2rad(120.0)
"""Angle of its circumference that is seen of a round object: half an ellipse less deep than 0.6 of its width shows
less. From 60 to 135 degrees the gain is the same."""
_TALL = 0.8
"""Least height of a round object as far as seen, in radii: of a lower one the whole outline is seen from above. Pots
have 1, balls 1.4 to 1.8, mugs 2. Computer mice, which are oval, have 0.5 to 0.7: seen from 20 to 50 degrees above they
would count as round. With 0 to 1 the gain is the same."""
_GRAZING = np.cos(np.deg2rad(75.0))
"""A view shows a side that it sees at less than this angle: depth ends there."""
_SEEN = 0.1
"""A side that more than this share of the views show stays where they have it: a square pole that a camera walks around
keeps its width. With 0 to 0.5 the gain is the same."""
_BETWEEN = 0.2
"""Least radius in the weights, in half widths: near the axis a fit of its square would follow every error."""


def unseen_ends(
    places: NDArray[np.float32], eyes: NDArray[np.float64], rotation: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Where a round object ends along the first two axes, (2,) each, metres, as half of its views have it.

    NaN at a side that was seen. None: most of its segments are not round, or there are too few. places: (n, k, 3) of
    its segments, world; eyes: (n, 3) from where; rotation: (3, 3) axes as columns, the third upright.
    """
    if len(places) < _LEAST:
        return None
    points = places[:: -(-len(places) // _VIEWS), ::_TESTED].astype(np.float64) @ rotation
    middle, extent = points.mean(axis=1, keepdims=True), np.ptp(points, axis=1)
    half = np.maximum(extent[:, :2].max(axis=1), _OFF) / 2
    centre, radius, height, fits = _fitted((points - middle) / half[:, None, None], half)
    # What is lower does not show whether it is round behind as well.
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
    """Fit a surface of revolution to each of (n, k, 3) segments.

    Returns the axis (n, 2), the largest radius and the height (n,), and whether it fits. unit: (n,) metres, of the
    points.
    """
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
