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


def pixels_of(labels: NDArray[np.int32]) -> list[NDArray[np.int64]]:
    """The flat indices of each label's pixels, from label 0 on; -1 = none."""
    labelled = np.flatnonzero(labels >= 0)
    number = labels.ravel()[labelled]
    order = labelled[np.argsort(number, kind="stable")]
    ends = np.cumsum(np.bincount(number))
    return [pixels for pixels in np.split(order, ends[:-1]) if len(pixels)]
