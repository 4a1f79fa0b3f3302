"""Boxes of any rotation, and how much boxes overlap."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Rotations pass through JSON and float32 messages: a larger deviation is no rounding error.
ROTATION_TOLERANCE = 1e-4

CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
"""(8, 3) corners of a box in units of its half sizes, numbered in binary by x, y, z."""
EDGES = np.array([(a, b) for a in range(8) for b in range(a) if (a ^ b) in (1, 2, 4)])
"""(12, 2) edges of a box as pairs of its corners."""

_AT_ONCE = 4096
"""Pairs of boxes that are clipped at once: about 10 MB."""


@dataclass(frozen=True, slots=True, eq=False)
class Box3D:
    """A box of any rotation, in metres, validated here.

    centre: (3,) float64, world. size: (3,) float64, full edge lengths, >= 0.
    rotation: (3, 3) float64, columns are the box's axes in the world frame, right-handed.
    """

    centre: NDArray[np.float64]
    size: NDArray[np.float64]
    rotation: NDArray[np.float64]

    def __post_init__(self) -> None:
        # In plain floats: NumPy is slow for so few values, and there are many boxes.
        for name, shape in (("centre", (3,)), ("size", (3,)), ("rotation", (3, 3))):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if values.shape != shape or not all(map(isfinite, values.ravel().tolist())):
                raise ValueError(f"box {name} must be finite with shape {shape}, got {values.tolist()}")
            object.__setattr__(self, name, values)
        if min(self.size.tolist()) < 0:
            raise ValueError(f"box size must not be negative, got {self.size.tolist()}")
        (a, b, c), (d, e, f), (g, h, i) = self.rotation.tolist()
        determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
        lengths = a * a + d * d + g * g - 1, b * b + e * e + h * h - 1, c * c + f * f + i * i - 1
        cosines = a * b + d * e + g * h, a * c + d * f + g * i, b * c + e * f + h * i
        if max(map(abs, lengths + cosines)) > ROTATION_TOLERANCE or determinant < 0:
            raise ValueError(f"box rotation is not a right-handed rotation matrix: {self.rotation.tolist()}")

    @property
    def volume(self) -> float:
        """Volume in cubic metres."""
        return float(np.prod(self.size))


def corners(box: Box3D) -> NDArray[np.float64]:
    """The (8, 3) corners of a box in the world frame, metres, in the order of `CORNERS`."""
    return box.centre + (CORNERS * box.size / 2) @ box.rotation.T


def moved(box: Box3D, T_target_source: NDArray[np.float64]) -> Box3D:
    """The box in another frame."""
    R = T_target_source[:3, :3]
    return Box3D(R @ box.centre + T_target_source[:3, 3], box.size, R @ box.rotation)


def iou_matrix_2d(boxes_a: ArrayLike, boxes_b: ArrayLike) -> NDArray[np.float64]:
    """Intersection over union of every box of one set with every box of the other (paper, Eq. IoU_ori).

    boxes_a: (A, 4 or more), boxes_b: (B, 4 or more), columns x, y, w, h in pixels, continuous: the area is
    w * h; more columns (a confidence) are ignored. Returns (A, B) float64; a pair without area has IoU 0.
    Raises ValueError for another shape, a negative size or a value that is not finite.
    """
    a, b = _rectangles(boxes_a), _rectangles(boxes_b)
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, :2] + a[:, None, 2:], b[None, :, :2] + b[None, :, 2:])
    intersection = np.prod(np.maximum(high - low, 0), axis=-1)
    return _over_union(intersection, np.prod(a[:, None, 2:], axis=-1), np.prod(b[None, :, 2:], axis=-1))


def _rectangles(boxes: ArrayLike) -> NDArray[np.float64]:
    values = np.asarray(boxes, dtype=np.float64)
    if values.size == 0:
        return np.zeros((0, 4))
    if values.ndim != 2 or values.shape[1] < 4:
        raise ValueError(f"2D boxes must be (M, 4) [x, y, w, h], got shape {values.shape}")
    values = values[:, :4]
    if not np.isfinite(values).all() or (values[:, 2:] < 0).any():
        raise ValueError("2D boxes must be finite, and their sizes not negative")
    return values


def iou_matrix_3d(boxes_a: Sequence[Box3D], boxes_b: Sequence[Box3D]) -> NDArray[np.float64]:
    """Exact 3D intersection over union of every box of one set with every box of the other.

    The first box's faces are clipped by the second's half-spaces and the volume follows from the divergence
    theorem; nothing is sampled. Returns (A, B) float64; a pair without volume (flat boxes) has IoU 0.
    """
    from spot3d.box_clipping import clipped_volumes  # needs numba, which what only draws boxes may lack

    result = np.zeros((len(boxes_a), len(boxes_b)))
    if result.size == 0:
        return result
    (centre_a, half_a, rotation_a), (centre_b, half_b, rotation_b) = _stacked(boxes_a), _stacked(boxes_b)
    # Half the extents along the world's axes: boxes can only overlap where these do.
    extent_a = (np.abs(rotation_a) @ half_a[:, :, None])[:, :, 0]
    extent_b = (np.abs(rotation_b) @ half_b[:, :, None])[:, :, 0]
    near = (np.abs(centre_a[:, None] - centre_b) < extent_a[:, None] + extent_b).all(axis=-1)
    first, second = np.nonzero(near)
    for start in range(0, len(first), _AT_ONCE):
        i, j = first[start : start + _AT_ONCE], second[start : start + _AT_ONCE]
        world = centre_a[i, None] + (CORNERS * half_a[i, None]) @ rotation_a[i].transpose(0, 2, 1)
        # Row vectors times R = R^T times column vectors: world corners in the other box's own axes.
        local = (world - centre_b[j, None]) @ rotation_b[j]
        volumes = 8 * np.prod(half_a[i], axis=1), 8 * np.prod(half_b[j], axis=1)
        result[i, j] = _over_union(clipped_volumes(local, half_b[j]), *volumes)
    return result


def _stacked(boxes: Sequence[Box3D]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Centres (n, 3), half sizes (n, 3) and rotations (n, 3, 3)."""
    centres, halves = np.array([box.centre for box in boxes]), np.array([box.size for box in boxes]) / 2
    return centres, halves, np.array([box.rotation for box in boxes])


def _over_union(
    intersection: NDArray[np.float64], size_a: NDArray[np.float64], size_b: NDArray[np.float64]
) -> NDArray[np.float64]:
    """IoU from areas or volumes, kept within [0, 1] whatever the rounding; nothing over nothing is 0."""
    inner = np.clip(intersection, 0, np.minimum(size_a, size_b))
    union = size_a + size_b - inner
    return np.divide(inner, union, out=np.zeros_like(union), where=union > 0)
