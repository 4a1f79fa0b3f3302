"""Boxes clipped by others; what they share is compared with sampling where overlaps are tested."""

import numpy as np
import pytest

from spot3d.box_clipping import clipped_volumes

CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)


@pytest.mark.parametrize("seed", range(20))
def test_faces_that_coincide_but_for_rounding_are_no_special_case(seed: int) -> None:
    rng = np.random.default_rng(seed)
    half = rng.uniform(0.1, 0.5, (50, 3))
    corners = CORNERS * half[:, None] * rng.choice([1 - 2e-16, 1, 1 + 3e-16], (50, 8, 3))
    np.testing.assert_allclose(clipped_volumes(corners, half), 8 * half.prod(axis=1), rtol=1e-9)
