"""What is believed of errors that are alike in all frames, and how wrong given poses are beside them."""

import numpy as np
import pytest
from numpy.typing import NDArray

from spot3d.pose.common_errors import COMMON, CommonErrors, Equations, believed, marginal, most_probable

SIGMA = 0.02
SCALE, OPEN = np.array([0]), np.full(COMMON, np.nan)
VARIANCES = np.geomspace(1e-4, 1.0, 17)


def offsets_of(count: int, noise: float, slope: float, seed: int = 0) -> NDArray[np.float64]:
    """Of so many given poses, each so noisy, that an error common to all puts off by `slope` times their place."""
    rng = np.random.default_rng(seed)
    return slope * np.linspace(-1, 1, count) + noise * rng.normal(size=count)


def seen(offsets: NDArray[np.float64], apart: float = 1.0) -> CommonErrors:
    """Depth has each pose exactly, but for an error common to all: what it tells where given poses are so far off."""
    count, exact = len(offsets), 1e6
    place = np.linspace(-1, 1, count)[:, None]
    # Where depth has a pose and how it is given differ by w + place * z.
    equations = Equations(
        exact * np.eye(count), exact * place, exact * offsets, exact * place.T @ place, exact * place.T @ offsets
    )
    return CommonErrors(np.array([0]), np.array([SIGMA]), *marginal(equations, 1, VARIANCES), apart)


def test_the_variance_of_given_poses_is_that_of_what_no_common_error_explains() -> None:
    for noise in (0.02, 0.1, 0.5):
        found = VARIANCES[most_probable(seen(offsets_of(200, noise, 0.01)))]
        assert 0.5 * noise**2 < found < 2 * noise**2


@pytest.mark.parametrize("slope", [0.02, -0.03])
def test_an_error_is_found_under_the_noise(slope: float) -> None:
    found = believed(seen(offsets_of(200, 0.02, slope)), SCALE, OPEN)
    assert found == pytest.approx(slope, abs=0.005)


def test_few_poses_tell_neither_their_noise_nor_an_error() -> None:
    """Three that happen to lie on a line are no proof: with the variance that fits best it would look like one."""
    errors = seen(np.array((-0.020, 0.001, 0.021)))
    assert most_probable(errors) < len(VARIANCES) // 2
    few, many = believed(errors, SCALE, OPEN), believed(seen(offsets_of(60, 0.001, 0.02)), SCALE, OPEN)
    assert abs(few[0]) < abs(many[0])


def test_what_is_less_independent_is_believed_less() -> None:
    """Where little is independent, poses may as well be so noisy that there is no error."""
    offsets = offsets_of(30, 0.02, 0.025)
    found = [believed(seen(offsets, apart), SCALE, OPEN)[0] for apart in (1.0, 0.5, 0.02)]
    assert found[0] >= found[1] > found[2]


def test_of_two_errors_that_look_alike_neither_is_believed_where_the_other_is_open() -> None:
    """And each is, where the other is known."""
    alike = 1e6 * np.array([[[1.0, 0.999], [0.999, 1.0]]])
    errors = CommonErrors(np.array([0, 1]), np.full(2, SIGMA), np.zeros(1), 0.02 * alike[:, :, 0], alike)
    other = OPEN.copy()
    other[1] = 0.0
    assert believed(errors, SCALE, other)[0] == pytest.approx(0.02, abs=0.001)
    other[1] = 0.02
    assert believed(errors, SCALE, other)[0] == pytest.approx(0.0, abs=0.002)
    assert 0.0 < believed(errors, SCALE, OPEN)[0] < 0.019
