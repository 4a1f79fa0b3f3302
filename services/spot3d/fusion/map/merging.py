"""Merging of a frame into the 3D heatmap (paper, Sec. V-B)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.map.map_arrays import FIRST, FREQUENCY, HEAT, LAST, WEIGHT, MapArrays, R, X, key_at
from spot3d.kernel import kernel, part
from spot3d.sensor import Pinhole, axial_noise_kernel
from spot3d.voxel_hash import EMPTY, find_slot

_MOST_FRAMES = np.float32(1 << 16)
"""Up to here single precision, of 24 bits, adds a frame's heat exactly to half of a 255th. Beyond, it adds less and
less of it, and from 2^24 on nothing."""
_REACH_MAX = np.float32(0.1)
"""Beyond this along the ray lies another surface, such as the table behind an object, metres. Three deviations reach it
with a Kinect beyond 4.5 m, with a stereo camera (d435) beyond 3 m."""


class Pixels(NamedTuple):
    """A frame to be merged: (h, w) depth, metres, colour and heat (see `IndexMap.register`)."""

    depth: NDArray[np.float32]
    colour: NDArray[np.uint8]
    heat: NDArray[np.uint8]


class Merging(NamedTuple):
    """How frames are matched with the map and merged: values of FusionSettings.

    colour_gate: squared L2 distance of RGB 0..255; depth_gate: metres; noise_gate: multiples of the depth's noise;
    per_metre: voxels.
    """

    colour_gate: np.float32
    depth_gate: np.float32
    noise_gate: np.float32
    per_metre: np.float32
    range_max: np.float32
    noise_weighting: bool
    look_up: bool


@part()
def _find_along_ray(
    known: MapArrays,
    x: np.float32,
    y: np.float32,
    z: np.float32,
    T_world_camera: NDArray[np.float32],
    distance: np.float32,
    reach: np.float32,
    per_metre: np.float32,
) -> np.int32:
    """Row of the point nearest along the viewing ray within `reach` metres (depth errs along it), or -1.

    No point is farther away than `_REACH_MAX`, however large the noise.
    """
    T = T_world_camera
    scale = np.float32(1) / (distance * per_metre)
    sx, sy, sz = (x - T[0, 3]) * scale, (y - T[1, 3]) * scale, (z - T[2, 3]) * scale
    steps = int(min(reach, _REACH_MAX) * per_metre)
    for step in range(steps + 1):
        for sign in range(2):
            if step == 0 and sign == 1:
                continue
            s = np.float32(step if sign == 0 else -step)
            slot = find_slot(known.keys, key_at(x + s * sx, y + s * sy, z + s * sz, per_metre))
            if known.keys[slot] != EMPTY:
                return np.int32(known.slot_rows[slot])
    return np.int32(-1)


@kernel()
def merge(
    known: MapArrays,
    frame_number: int,
    pixels: Pixels,
    candidates: NDArray[np.int32],
    camera: Pinhole,
    T_world_camera: NDArray[np.float32],
    how: Merging,
    index: NDArray[np.int32],
) -> tuple[int, int, int]:
    """Give every valid pixel its map point: the candidate, one in the voxels within reach of noise, or a new one.

    Position and colour are running means, weighted by 1 / sigma_z^2 if `noise_weighting`. Without `look_up`, each pixel
    without a candidate becomes a new point, and no voxel is entered. Once no row is free, new points are left out. A
    point's weight, heat and frequency are halved each time the frequency reaches 65,536. Fills in the index map, which
    is -1; returns how many pixels were warped, found and new.
    """
    rows, numbers, keys, slot_rows, row_slots, free, counts = known
    used, free_count = counts[0], counts[1]
    depth, colour, heat = pixels
    fx, fy, cx, cy, noise = camera
    _, _, noise_gate, per_metre, range_max, noise_weighting, look_up = how
    h, w = depth.shape
    per_fx, per_fy = np.float32(1) / fx, np.float32(1) / fy
    T = T_world_camera
    warped, found, appended = 0, 0, 0
    for v in range(h):
        for u in range(w):
            z = depth[v, u]
            if not 0 < z <= range_max:
                continue
            # In single precision, as in the look-up: else a point on a voxel's border is entered in the next.
            dx, dy = (np.float32(u) - cx) * per_fx, (np.float32(v) - cy) * per_fy
            x = (T[0, 0] * dx + T[0, 1] * dy + T[0, 2]) * z + T[0, 3]
            y = (T[1, 0] * dx + T[1, 1] * dy + T[1, 2]) * z + T[1, 3]
            zw = (T[2, 0] * dx + T[2, 1] * dy + T[2, 2]) * z + T[2, 3]
            sigma = axial_noise_kernel(z, noise)
            row = candidates[v, u]
            if row >= 0:
                warped += 1
            else:
                if look_up:
                    row = _find_along_ray(known, x, y, zw, T, z, noise_gate * sigma, per_metre)
                if row >= 0:
                    found += 1
                elif free_count == 0 and used == len(rows):
                    continue
                else:
                    if free_count > 0:
                        free_count -= 1
                        row = free[free_count]
                    else:
                        row = np.int32(used)
                        used += 1
                    appended += 1
                    row_slots[row] = -1
                    if look_up:
                        key = key_at(x, y, zw, per_metre)
                        slot = find_slot(keys, key)
                        keys[slot], slot_rows[slot], row_slots[row] = key, row, slot
                    rows[row, :] = np.float32(0)
                    numbers[row, LAST] = -1
                    rows[row, FIRST] = np.float32(frame_number & 0xFFFFFF)
            index[v, u] = row
            weight = np.float32(1e-6) / (sigma * sigma) if noise_weighting else np.float32(1)
            total = rows[row, WEIGHT] + weight
            share = weight / total
            rows[row, WEIGHT] = total
            rows[row, X] += share * (x - rows[row, X])
            rows[row, X + 1] += share * (y - rows[row, X + 1])
            rows[row, X + 2] += share * (zw - rows[row, X + 2])
            for i in range(3):
                rows[row, R + i] += share * (colour[v, u, i] - rows[row, R + i])
            if numbers[row, LAST] != frame_number:
                numbers[row, LAST] = frame_number
                rows[row, FREQUENCY] += np.float32(1)
                rows[row, HEAT] += heat[v, u] / np.float32(255)
                if rows[row, FREQUENCY] >= _MOST_FRAMES:
                    rows[row, FREQUENCY] /= np.float32(2)
                    rows[row, HEAT] /= np.float32(2)
                    rows[row, WEIGHT] /= np.float32(2)
    counts[0], counts[1] = used, free_count
    return warped, found, appended
