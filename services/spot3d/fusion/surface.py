"""The map's surface as small cells, and which of them are near: what segmentation works on."""

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.heatmap3d import find_slot, voxel_key


@dataclass(frozen=True, slots=True)
class Surface:
    """Cells of equal size that hold the points of a surface.

    edge: of a cell, metres; centre: (n, 3) float32 metres, mean of the cell's points; normal: (n, 3) float32 unit
    (zero if unknown); heat: (n,) float32 mean confidence of the points; cell_of_point: (points,) int32, -1 = none;
    keys: (n,) int64, packed place of each cell.
    """

    edge: float
    centre: NDArray[np.float32]
    normal: NDArray[np.float32]
    heat: NDArray[np.float32]
    cell_of_point: NDArray[np.int32]
    keys: NDArray[np.int64]


def gather_cells(
    points: NDArray[np.float32], normals: NDArray[np.float32], heat: NDArray[np.float32], edge: float
) -> Surface:
    """Gather points into cells of `edge` metres.

    points: (n, 3) float32 metres; normals: (n, 3) float32, weighted by their length; heat: (n,) float32.
    """
    keys, slot_cells = _table(len(points))
    sums, cell_of_point = _gather(points, normals, heat, keys, slot_cells, np.float32(1 / edge))
    count = sums[:, 7]
    length = np.linalg.norm(sums[:, 3:6], axis=1, keepdims=True)
    used = np.flatnonzero(keys >= 0)
    cell_keys = np.empty(len(sums), np.int64)
    cell_keys[slot_cells[used]] = keys[used]
    return Surface(
        edge,
        sums[:, :3] / count[:, None],
        sums[:, 3:6] / np.maximum(length, np.float32(1e-9)),
        sums[:, 6] / count,
        cell_of_point,
        cell_keys,
    )


def keep_cells(surface: Surface, keep: NDArray[np.bool_]) -> Surface:
    """The surface of these cells alone; points of the others belong to no cell. keep: (n,) bool."""
    number = np.append(np.where(keep, np.cumsum(keep) - 1, -1), -1).astype(np.int32)
    return Surface(
        surface.edge,
        surface.centre[keep],
        surface.normal[keep],
        surface.heat[keep],
        number[surface.cell_of_point],
        surface.keys[keep],
    )


def near_pairs(surface: Surface) -> NDArray[np.int32]:
    """(m, 2) int32: pairs of cells no more than two cell edges apart, each pair once."""
    keys, slot_cells = _table(len(surface.keys))
    pairs: NDArray[np.int32] = _near_pairs(surface.keys, keys, slot_cells)
    return pairs


def _table(entries: int) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """An empty hash table, keys and values, at most half full with so many entries."""
    slots = 1 << max(4, int(np.ceil(np.log2(2 * entries + 1))))
    return np.full(slots, np.int64(-1)), np.empty(slots, np.int32)


def _half_ball() -> NDArray[np.int64]:
    """Key differences to the cells within two edges, one of each opposite pair."""
    steps = np.arange(-2, 3)
    offsets = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
    offsets = offsets[(offsets**2).sum(1) <= 4]
    keys = (offsets[:, 0] << 42) + (offsets[:, 1] << 21) + offsets[:, 2]
    half: NDArray[np.int64] = keys[keys > 0].astype(np.int64)
    return half


_HALF_BALL = _half_ball()


@nb.njit("Tuple((f4[:,::1], i4[::1]))(f4[:,:], f4[:,:], f4[:], i8[::1], i4[::1], f4)", cache=True, nogil=True)
def _gather(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    heat: NDArray[np.float32],
    keys: NDArray[np.int64],
    slot_cells: NDArray[np.int32],
    per_metre: np.float32,
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Sums a cell: position, normal, heat, count; and each point's cell."""
    cell_of_point = np.empty(len(points), np.int32)
    sums = np.zeros((len(points), 8), np.float32)
    cells = 0
    for i in range(len(points)):
        key = voxel_key(points[i, 0], points[i, 1], points[i, 2], per_metre)
        slot = find_slot(keys, key)
        if keys[slot] == np.int64(-1):
            keys[slot] = key
            slot_cells[slot] = cells
            cells += 1
        cell = slot_cells[slot]
        cell_of_point[i] = cell
        for axis in range(3):
            sums[cell, axis] += points[i, axis]
            sums[cell, 3 + axis] += normals[i, axis]
        sums[cell, 6] += heat[i]
        sums[cell, 7] += np.float32(1)
    return sums[:cells].copy(), cell_of_point


@nb.njit("i4[:,::1](i8[::1], i8[::1], i4[::1])", cache=True, nogil=True)
def _near_pairs(
    cell_keys: NDArray[np.int64], keys: NDArray[np.int64], slot_cells: NDArray[np.int32]
) -> NDArray[np.int32]:
    """Enter all cells into the table, then look up each one's surroundings."""
    for cell in range(len(cell_keys)):
        slot = find_slot(keys, cell_keys[cell])
        keys[slot] = cell_keys[cell]
        slot_cells[slot] = cell
    pairs = np.empty((len(cell_keys) * len(_HALF_BALL), 2), np.int32)
    count = 0
    for cell in range(len(cell_keys)):
        for step in range(len(_HALF_BALL)):
            slot = find_slot(keys, cell_keys[cell] + _HALF_BALL[step])
            if keys[slot] != np.int64(-1):
                pairs[count, 0] = cell
                pairs[count, 1] = slot_cells[slot]
                count += 1
    return pairs[:count].copy()
