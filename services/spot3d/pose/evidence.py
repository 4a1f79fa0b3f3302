"""What registered frames tell of what is wrong alike in all of them: depth's scale, where the camera looks."""

import numpy as np
from numpy.typing import NDArray

NEWS_S = 1 / 3
"""Given poses are wrong alike over a third of a second: no sooner does a frame tell something new."""


def evidence(
    H: NDArray[np.float64],
    g: NDArray[np.float64],
    unknowns: NDArray[np.int64],
    pose_information: NDArray[np.float64],
    given: NDArray[np.float64],
    elapsed: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Information (k, k) and gradient (k,) of k unknowns beside the pose, by row: its Schur complement.

    H, g: normal equations of a registered frame in units of independent information, of which the first six are the
    pose's twist. The pose may give way as far as it is uncertain: given, the (6,) twist to where it was given, is known
    with pose_information (6, 6). elapsed: seconds since the last frame.
    """
    share = min(1.0, elapsed / NEWS_S)
    A, b = H[:6, :6] + pose_information, g[:6] + pose_information @ given
    across = H[unknowns, :6]
    information = share * (H[np.ix_(unknowns, unknowns)] - across @ np.linalg.solve(A, across.T))
    gradient = share * (g[unknowns] - across @ np.linalg.solve(A, b))
    return information, gradient
