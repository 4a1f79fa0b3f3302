"""Registration with the map in plain NumPy (paper, Sec. V-B): look-up, running means."""

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.fusion.map.heatmap3d import Heatmap3D
from spot3d.fusion.map.map_arrays import COLUMNS, FREQUENCY, HEAT, LAST, WEIGHT, R, X

_HALF = 1 << 19


class ReferenceMap:
    """The 3D heatmap with a dictionary from voxel to row. rows: as `Heatmap3D.rows`."""

    def __init__(self, voxel: float, rows: NDArray[np.float32], voxels: dict[int, int]) -> None:
        self.per_metre = np.float32(1 / voxel)
        self.rows = rows
        self.voxels = voxels


def copy_of(heatmap: Heatmap3D) -> ReferenceMap:
    """A copy with the same points and voxels."""
    keys, slot_rows = heatmap.arrays.keys, heatmap.arrays.slot_rows
    voxels = dict(zip(keys[keys >= 0].tolist(), slot_rows[keys >= 0].tolist(), strict=True))
    return ReferenceMap(heatmap.voxel, heatmap.points().copy(), voxels)


def merge(
    known: ReferenceMap,
    candidates: NDArray[np.int32],
    depth: NDArray[np.float32],
    colour: NDArray[np.uint8],
    heat: NDArray[np.uint8],
    T_world_camera: NDArray[np.float64],
    camera: Intrinsics,
    noise_gate: float,
    range_max: float,
    frame_number: int,
) -> tuple[NDArray[np.int32], int, int]:
    """Assign every valid pixel a map point and update it, as `spot3d.fusion.map.merging.merge` does.

    Returns the index map (h, w), and how many pixels were warped and found. New points are added to `known`.
    """
    T = T_world_camera.astype(np.float32).astype(np.float64)
    v, u = np.nonzero((depth > 0) & (depth <= range_max))
    z = depth[v, u]
    intrinsics = np.array((camera.fx, camera.fy, camera.cx, camera.cy), np.float32).astype(np.float64)
    rays = np.stack(((u - intrinsics[2]) / intrinsics[0], (v - intrinsics[3]) / intrinsics[1], np.ones(len(u))), 1)
    xyz = ((rays @ T[:3, :3].T) * z[:, None] + T[:3, 3]).astype(np.float32)
    sigma = camera.noise.sigma(z)
    pixel_rows = candidates[v, u].astype(np.int64)
    warped = int(np.count_nonzero(pixel_rows >= 0))
    new, found = _look_up(known, pixel_rows, xyz, z, T[:3, 3].astype(np.float32), np.float32(noise_gate) * sigma)
    known.rows = np.concatenate((known.rows, np.zeros((new, COLUMNS), np.float32)))
    _update(known.rows, pixel_rows, xyz, colour[v, u], sigma)
    once, first = np.unique(pixel_rows, return_index=True)
    known.rows[once, HEAT] += heat[v, u][first] / np.float32(255)
    known.rows[once, FREQUENCY] += 1
    known.rows.view(np.int32)[once, LAST] = frame_number
    index = np.full(depth.shape, -1, np.int32)
    index[v, u] = pixel_rows
    return index, warped, found


def _look_up(
    known: ReferenceMap,
    pixel_rows: NDArray[np.int64],
    xyz: NDArray[np.float32],
    z: NDArray[np.float32],
    eye: NDArray[np.float32],
    reach: NDArray[np.float32],
) -> tuple[int, int]:
    """Fill in the row of pixels without one: a point along the ray, or a new row. Returns counts of new and found."""
    step = (xyz - eye) * (np.float32(1) / (z * known.per_metre))[:, None]
    steps = (reach * known.per_metre).astype(np.int64)
    new = found = 0
    for pixel in np.flatnonzero(pixel_rows < 0):
        along = np.array([0] + [side * k for k in range(1, steps[pixel] + 1) for side in (1, -1)], np.float32)
        keys = _voxel_keys(xyz[pixel] + along[:, None] * step[pixel], known.per_metre)
        row = next((known.voxels[key] for key in keys if key in known.voxels), None)
        if row is None:
            row = known.voxels[keys[0]] = len(known.rows) + new
            new += 1
        else:
            found += 1
        pixel_rows[pixel] = row
    return new, found


def _voxel_keys(xyz: NDArray[np.float32], per_metre: np.float32) -> list[int]:
    i, j, k = (np.floor(xyz * per_metre).astype(np.int64) + _HALF).T
    keys: list[int] = (((i << 20 | j) << 20 | k) << 3).tolist()
    return keys


def _update(
    rows: NDArray[np.float32],
    pixel_rows: NDArray[np.int64],
    xyz: NDArray[np.float32],
    rgb: NDArray[np.uint8],
    sigma: NDArray[np.float32],
) -> None:
    """Running means of position and colour, weighted by 1 / sigma^2."""
    weight = 1e-6 / sigma.astype(np.float64) ** 2
    added = np.bincount(pixel_rows, weight, len(rows))
    total = rows[:, WEIGHT] + added
    seen = added > 0
    for column, values in [(X + i, xyz[:, i]) for i in range(3)] + [(R + i, rgb[:, i]) for i in range(3)]:
        summed = rows[:, WEIGHT] * rows[:, column] + np.bincount(pixel_rows, weight * values, len(rows))
        rows[seen, column] = summed[seen] / total[seen]
    rows[seen, WEIGHT] = total[seen]
