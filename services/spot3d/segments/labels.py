"""Labels of a frame's regions."""

import numpy as np
from numpy.typing import NDArray


def united(labels: NDArray[np.int32], pairs: NDArray[np.int64], count: int) -> NDArray[np.int32]:
    """The labels after merging these pairs (k, 2) of `count` regions, which keep their lowest label; -1 = none."""
    root = np.arange(count)
    for a, b in pairs.tolist():
        low, high = sorted((int(root[a]), int(root[b])))
        root[root == high] = low
    return np.where(labels >= 0, root[labels], -1).astype(np.int32)
