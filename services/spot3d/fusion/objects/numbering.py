"""Numbers of clusters, and of the objects among them, that stay from update to update."""

import numpy as np
from numpy.typing import NDArray


def number_clusters(
    found: NDArray[np.int64], before: NDArray[np.int64], touched: NDArray[np.bool_], first: int
) -> tuple[NDArray[np.int64], int]:
    """The number of each segment's cluster, (n,), and how many clusters are new; new numbers count up from `first`.

    found: (n,) clusters from 0 on, -1 = none; before: (n,) the segments' previous numbers. A cluster of the same
    segments as before, none of which is touched, keeps its number.
    """
    inside, count = found >= 0, int(found.max(initial=-1)) + 1
    low, high = np.full(count, np.iinfo(np.int64).max), np.full(count, -1)
    np.minimum.at(low, found[inside], before[inside])
    np.maximum.at(high, found[inside], before[inside])
    old, old_sizes = np.unique(before, return_counts=True)
    same_size = old_sizes[np.searchsorted(old, low)] == np.bincount(found[inside], minlength=count)
    hit = np.bincount(found[inside], touched[inside], count) > 0
    new = hit | (low != high) | (low < 0) | ~same_size
    number = np.where(new, first + np.cumsum(new) - 1, low)
    return np.append(number, -1)[found], int(new.sum())


def number_objects(
    objects: list[NDArray[np.int64]], columns: tuple[NDArray[np.int64], ...], taken: set[int], first: int
) -> list[int]:
    """The numbers of objects, each given by its segments' rows: the one that most of these had, or a new one.

    columns: the number that each segment had last, (n,), the one before that, and so on, 0 = none; taken: numbers of
    other objects; new numbers count up from `first`. If several want the same number, the earlier in the list gets it.
    """
    taken, given = {0, *taken}, [0] * len(objects)
    for column in columns:
        for row, members in enumerate(objects):
            if given[row]:
                continue
            numbers, counts = np.unique(column[members], return_counts=True)
            wanted = numbers[np.argsort(-counts, kind="stable")].tolist()
            given[row] = next((number for number in wanted if number not in taken), 0)
            taken.add(given[row])
    new = iter(range(first, first + len(objects)))
    return [number or next(new) for number in given]
