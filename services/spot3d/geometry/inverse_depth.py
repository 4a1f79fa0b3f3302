"""Inverse depth without holes."""

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel


@kernel()
def fill_inverse_depth(depth: NDArray[np.float32], inverse: NDArray[np.float32]) -> None:
    """Write inverse depth whose holes take the farther of their two ends along the row.

    A hole beside an object is background that the projector or the second camera does not see, so the farther
    end is right and the object keeps its outline. Rows without any depth repeat the nearest row above, or
    below at the top. depth: (h, w) float32 metres, 0 = invalid; inverse: (h, w) float32 1/m, 0 if all is 0.
    """
    # Rows are copied pixel by pixel: assigning them as arrays takes four seconds more to compile.
    h, w = depth.shape
    first_row = -1
    for v in range(h):
        left = np.float32(-1.0)
        start = 0
        for u in range(w):
            if depth[v, u] > 0:
                q = np.float32(1.0) / depth[v, u]
                inverse[v, u] = q
                for k in range(start, u):
                    inverse[v, k] = q if left < 0 or q < left else left
                left = q
                start = u + 1
        if left >= 0:
            inverse[v, start:] = left
            if first_row < 0:
                first_row = v
                for above in range(v):
                    for u in range(w):
                        inverse[above, u] = inverse[v, u]
        elif first_row >= 0:
            for u in range(w):
                inverse[v, u] = inverse[v - 1, u]
    if first_row < 0:
        inverse[:] = 0
