"""Labels of a frame's regions."""

import numpy as np
from numpy.typing import NDArray


def united(labels: NDArray[np.int32], pairs: NDArray[np.int64], count: int) -> NDArray[np.int32]:
    """The labels after merging these pairs (k, 2) of `count` regions; -1 = none. They are numbered from 0 without gaps,
    in the order of their lowest label."""
    root = np.append(np.arange(count), -1)  # the last entry is for label -1
    for a, b in pairs.tolist():
        low, high = sorted((int(root[a]), int(root[b])))
        root[root == high] = low
    number = np.unique(root, return_inverse=True)[1].astype(np.int32) - np.int32(1)
    return number.take(labels)


def pixels_of(labels: NDArray[np.int32]) -> list[NDArray[np.int64]]:
    """The flat indices of each label's pixels, from label 0 on; -1 = none."""
    labelled = np.flatnonzero(labels >= 0)
    number = labels.ravel()[labelled]
    small = number.astype(np.min_scalar_type(number.max(initial=0)))  # up to 16 bits are sorted several times as fast
    order = labelled[np.argsort(small, kind="stable")]
    sizes = np.bincount(number)
    return [order[end - size : end] for size, end in zip(sizes, np.cumsum(sizes), strict=True) if size]
