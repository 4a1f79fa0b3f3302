"""Single objects in clouds that are labelled by class only."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from spot3d.evaluate.dominant_plane import dominant_plane

VOXEL = 0.02
"""Points in voxels of this size that touch belong to one object, metres."""
PART = 0.1
"""A piece with less than this share of the voxels of the class's largest one is a label's stray edge."""


def split_instances(xyz: NDArray[np.float32]) -> list[NDArray[np.int64]]:
    """Rows of each object among (n, 3) points of one class: what is connected over voxels of 2 cm.

    Largest first; crumbs are in none.
    """
    if not len(xyz):
        return []
    voxel = np.floor((xyz - xyz.min(axis=0)) / VOXEL).astype(np.int64)
    filled = np.zeros(voxel.max(axis=0) + 1, np.bool_)
    filled[tuple(voxel.T)] = True
    number, count = ndimage.label(filled, structure=np.ones((3, 3, 3)))
    size = np.bincount(number[filled], minlength=count + 1)[1:]
    of_point = number[tuple(voxel.T)]
    kept = np.argsort(-size, kind="stable")
    return [np.flatnonzero(of_point == part + 1) for part in kept if size[part] >= PART * size.max()]


def table_normal(xyz: NDArray[np.float32], camera: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit normal (3,) of the plane with most of the (n, 3) points, on the side of the camera's place (3,)."""
    return dominant_plane(xyz, camera)[:3]
