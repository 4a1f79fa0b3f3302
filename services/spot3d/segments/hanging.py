"""Join what hangs beside an object, such as a mug's handle, with that object, in a single view."""

import numpy as np
from numpy.typing import NDArray

_DOWN = 3
"""Pixels below a part's lower edge where it is looked whether anything bears it: beyond the blur of edges in depth."""
_BEHIND = 0.02
"""What is this much further away than a part's edge is not what bears it, or what it hangs on, metres."""
_FREE = 0.5
"""Share of the lower edge below which what is further away must be seen; a handle's ends meet the object."""
_HELD = 0.1
"""Share of the edge along which a part meets what it hangs on."""
_SMALL = 1 / 3
"""What hangs is at most so large against what holds it, in pixels: a stacked box may overhang too."""


def join_hanging(
    clusters: list[NDArray[np.int64]], points: NDArray[np.float32], up: NDArray[np.float64]
) -> list[NDArray[np.int64]]:
    """Clusters of pixels of one view, those that stand on nothing joined with what they touch most.

    clusters: flat pixel numbers; points: (h, w, 3) float32 metres, camera frame, z = 0 invalid; up: (3,) unit, camera
    frame. Below a part that stands on something that is seen at its own distance; what hides it is nearer.
    """
    joined = list(clusters)
    owner = np.full(points.shape[:2], -1, np.int32)
    for number, cluster in enumerate(clusters):
        owner.ravel()[cluster] = number
    depth = points[..., 2]
    for number in sorted(range(len(clusters)), key=lambda k: len(clusters[k])):
        holder = _holder(number, joined[number], owner, depth, _downwards(points.reshape(-1, 3)[joined[number]], up))
        if holder is not None:
            joined[holder] = np.concatenate((joined[holder], joined[number]))
            owner.ravel()[joined[number]] = holder
            joined[number] = np.zeros(0, np.int64)
    return [cluster for cluster in joined if len(cluster)]


def _downwards(points: NDArray[np.float32], up: NDArray[np.float64]) -> tuple[int, int]:
    """The step (rows, columns) to a pixel's neighbour that leads most nearly down from the middle of (n, 3) points."""
    x, y, z = (float(value) for value in np.median(points, axis=0))
    along = np.array([up[2] * y / z - up[1], up[2] * x / z - up[0]])
    v, u = np.rint(along / max(float(np.abs(along).max()), 1e-9)).astype(int)
    return int(v), int(u)


def _holder(
    number: int,
    cluster: NDArray[np.int64],
    owner: NDArray[np.int32],
    depth: NDArray[np.float32],
    down: tuple[int, int],
) -> int | None:
    """The number of the cluster that this one hangs on; None if it stands on something, or may do so unseen."""
    whose, distance = owner.ravel(), depth.ravel()
    size = np.bincount(whose[whose >= 0])
    lower = cluster[whose[_beside(cluster, owner.shape, down, 1)] != number]
    below = distance[_beside(lower, owner.shape, down, _DOWN)]
    if np.count_nonzero(below > distance[lower] + _BEHIND) <= _FREE * np.count_nonzero(below):
        return None
    touched, edge = np.zeros(len(size), np.int64), 0
    for step in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        outer = cluster[whose[_beside(cluster, owner.shape, step, 1)] != number]
        across = _beside(outer, owner.shape, step, 2)
        met = whose[across[np.abs(distance[across] - distance[outer]) < _BEHIND]]
        touched += np.bincount(met[(met >= 0) & (met != number)], minlength=len(touched))
        edge += len(outer)
    most = int(np.argmax(touched))
    return most if touched[most] >= _HELD * edge and size[number] <= _SMALL * size[most] else None


def _beside(pixels: NDArray[np.int64], shape: tuple[int, ...], step: tuple[int, int], count: int) -> NDArray[np.int64]:
    """The flat numbers of the pixels so many steps (rows, columns) away, or at the image's border."""
    v, u = np.divmod(pixels, shape[1])
    v, u = np.clip(v + count * step[0], 0, shape[0] - 1), np.clip(u + count * step[1], 0, shape[1] - 1)
    return np.asarray(v * shape[1] + u)
