"""Join the parts of one object that something in front of it divides, in a single view."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from spot3d.geometry.quantiles import quantiles
from spot3d.geometry.upright import taken, upright_box

# With each of these halved and doubled (cosines and `_HIDDEN` half and twice as far from 1; `_SHARED` 0.25 and 0.8)
# success and detection of single frames on OSD, HOTS, 30 cluttered frames and 24 of a room are the same, within 0.013.
# Only `_SEEN` of 0.8 changes them: 0.92, 0.97 on OSD instead of 0.96, 0.99.
_LEVEL = 0.02
"""The tops of an object's parts agree within this many metres."""
_IN_FRONT = 0.02
"""A pixel this much nearer than the line between two parts hides what is there, metres."""
_HIDDEN = 0.9
"""Share of the pixels between two parts that must be hidden."""
_SEEN = 0.4
"""Share of the joined parts' length that must be seen."""
_UPRIGHT = 0.87
"""A wall's normal is level to 30 degrees: its level component is at least this long."""
_FLUSH, _ALIKE = 0.01, 0.85
"""Points on one wall lie in its plane within this many metres, and their normals agree to this cosine."""
_SHARED = 0.5
"""Share of a part's wall points that must lie on one wall of the other part, which has half this share of its own."""
_TRIED, _SAMPLE = 50, 500
"""About how many of a part's points are tried as walls, and on how many points they are tested."""


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """pixels: (n,) flat indices; middle: (2,) their median row and column; places: (m, 3) float32, some of their
    points; top: their height along up; depth: their median depth; metres."""

    pixels: NDArray[np.int64]
    middle: NDArray[np.float64]
    places: NDArray[np.float32]
    top: float
    depth: float


def join_occluded(
    clusters: list[NDArray[np.int64]],
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    up: NDArray[np.float64],
) -> list[NDArray[np.int64]]:
    """The clusters of one view after joining those that continue each other behind something nearer.

    clusters: flat pixel indices; points: (h, w, 3) float32 metres, camera frame, z = 0 invalid; normals: their unit
    normals; up: (3,) unit, camera frame. Two parts continue each other when their tops are level, one wall runs
    through both, a good part of it is seen, and the pixels between them are nearer than both.
    """
    flat, facing, width = points.reshape(-1, 3), normals.reshape(-1, 3), points.shape[1]
    parts = [_part(cluster, flat, width, up) for cluster in sorted(clusters, key=len, reverse=True)]

    @cache
    def walls_of(part: _Part) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return _walls(flat[part.pixels], facing[part.pixels], up)

    def continues(a: _Part, b: _Part) -> bool:
        return (
            abs(a.top - b.top) <= _LEVEL
            and _hidden_between(a, b, flat, width)
            and _mostly_seen(a, b, up)
            and _one_wall(walls_of(a), walls_of(b))
        )

    i = 0
    while i < len(parts):
        partner = next((j for j in range(i + 1, len(parts)) if continues(parts[i], parts[j])), None)
        if partner is None:
            i += 1
        else:
            parts[i] = _part(np.concatenate((parts[i].pixels, parts.pop(partner).pixels)), flat, width, up)
    return [part.pixels for part in parts]


def _part(pixels: NDArray[np.int64], flat: NDArray[np.float32], width: int, up: NDArray[np.float64]) -> _Part:
    places = taken(flat, pixels[:: max(1, len(pixels) // _SAMPLE)])
    (middle,) = quantiles(np.array(np.divmod(pixels, width), np.float64), 0.5)
    (top,), (depth,) = quantiles(places @ up, 0.98), quantiles(places[:, 2], 0.5)
    return _Part(pixels, middle, places, float(top), float(depth))


def _mostly_seen(a: _Part, b: _Part, up: NDArray[np.float64]) -> bool:
    """Whether the lengths of two parts add up to at least `_SEEN` of the length of both together."""
    both = np.concatenate((a.places, b.places))
    lengths = [upright_box(places, up, trim=0.01).size[:2].max() for places in (a.places, b.places, both)]
    return bool(lengths[0] + lengths[1] >= _SEEN * lengths[2])


def _walls(
    points: NDArray[np.float32], normals: NDArray[np.float32], up: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A sample of the points on walls, and the directions of their normals' level components: two (n, 3)."""
    level = normals - (normals @ up)[:, None] * up
    length = np.linalg.norm(level, axis=1)
    rows = np.flatnonzero(length > _UPRIGHT)
    rows = rows[:: max(1, len(rows) // _SAMPLE)]
    return points[rows].astype(np.float64), level[rows] / length[rows, None]


def _one_wall(
    a: tuple[NDArray[np.float64], NDArray[np.float64]], b: tuple[NDArray[np.float64], NDArray[np.float64]]
) -> bool:
    """Whether most of the wall points of `b` lie on one wall of `a`. a, b: points and normals."""
    if not len(a[0]) or not len(b[0]):
        return False
    tried = slice(None, None, max(1, len(a[0]) // _TRIED))
    place, normal = a[0][tried], a[1][tried]
    # A point's own normal is noisy: that of the wall is the mean of those that agree with it.
    own = _on_walls(*a, place, normal).astype(np.float64)
    place, normal = own.T @ a[0] / own.sum(axis=0)[:, None], own.T @ a[1]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    shares = [_on_walls(*part, place, normal).mean(axis=0) for part in (a, b)]
    return bool(np.any((shares[0] >= _SHARED / 2) & (shares[1] >= _SHARED)))


def _on_walls(
    points: NDArray[np.float64], normals: NDArray[np.float64], place: NDArray[np.float64], normal: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(n, k): which of n points, by place and normal, lie on which of k walls, given by a place and a normal each."""
    height = points @ normal.T - np.sum(place * normal, axis=1)
    return np.asarray((np.abs(height) < _FLUSH) & (normals @ normal.T > _ALIKE))


def _hidden_between(a: _Part, b: _Part, points: NDArray[np.float32], width: int) -> bool:
    """Whether the line of pixels between the middles of two parts is hidden where it is outside both."""
    way = b.middle - a.middle
    steps = np.linspace(0, 1, int(np.abs(way).max()) + 2)
    v, u = np.rint(a.middle[:, None] + way[:, None] * steps).astype(int)
    line = v * width + u
    seen = points[line, 2]
    hidden = (seen < a.depth + (b.depth - a.depth) * steps - _IN_FRONT) & (seen > 0)
    if not hidden.any():
        return False
    outside = np.ones(len(points), np.bool_)
    outside[a.pixels] = outside[b.pixels] = False
    between = outside[line]
    return bool((hidden & between).any()) and float(np.mean((hidden | (seen == 0))[between])) >= _HIDDEN
