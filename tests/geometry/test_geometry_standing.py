"""What stands on a plane: by where it begins, or from above by what lies around it."""

import numpy as np
import pytest
from numpy.typing import NDArray

from spot3d.geometry.standing import stands_on

SHAPE = (20, 20)
WITHIN = 0.03
THING = np.zeros(SHAPE, np.bool_)
THING[6:14, 6:14] = True
FROM_ABOVE = np.array((0.0, 0.0, -1.0))
"""Up, in a camera that looks straight down; in one that looks ahead it is the other."""
AHEAD = np.array((0.0, -1.0, 0.0))


def heights(lowest: float, around: float) -> NDArray[np.float64]:
    """(h, w) metres: a thing of 7 cm that begins at one height, around it another."""
    return np.where(THING, lowest + 0.01 * (13 - np.arange(SHAPE[0]))[:, None], around)


def seen(height: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float32]:
    """(h, w, 3) metres, of a camera that is 1 m above the plane, and 2 m from what is ahead."""
    places = np.zeros((*SHAPE, 3)) if up is FROM_ABOVE else np.full((*SHAPE, 3), (0.0, 0.0, 2.0))
    return (places + (height - 1)[..., None] * up).astype(np.float32)


@pytest.mark.parametrize(
    ("up", "lowest", "around", "stands"),
    [
        (AHEAD, 0.0, 0.0, True),
        (AHEAD, 0.1, 0.0, False),  # its foot would be seen
        (FROM_ABOVE, 0.1, 0.0, True),
        (FROM_ABOVE, 0.1, 0.08, False),  # on something else
        (FROM_ABOVE, -0.2, 0.0, False),  # lower
    ],
)
def test_begins_on_it_or_hides_where_it_begins(
    up: NDArray[np.float64], lowest: float, around: float, stands: bool
) -> None:
    height = heights(lowest, around)
    assert stands_on(np.flatnonzero(THING), height, seen(height, up), up, WITHIN) == stands


def test_without_depth_in_or_around_it_nothing_is_known_to_stand() -> None:
    height = heights(0.1, 0.0)
    points = seen(height, FROM_ABOVE)
    assert not stands_on(np.zeros(0, np.int64), height, points, FROM_ABOVE, WITHIN)
    points[~THING] = 0
    assert not stands_on(np.flatnonzero(THING), height, points, FROM_ABOVE, WITHIN)
