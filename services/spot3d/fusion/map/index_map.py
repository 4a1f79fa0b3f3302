"""Registration of a frame with the 3D heatmap through the index map (paper, Sec. IV-B)."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, invert
from spot3d.fusion.map.heatmap3d import (
    FREQUENCY,
    HEAT,
    LAST,
    NORMAL,
    WEIGHT,
    Heatmap3D,
    R,
    X,
    find_slot,
    voxel_key,
)
from spot3d.fusion.settings import FusionSettings
from spot3d.geometry.normals import surface_normals
from spot3d.kernel import kernel
from spot3d.sensor import axial_noise_kernel


@dataclass(frozen=True, slots=True)
class MatchCounts:
    """How a frame's valid pixels met the map: warped from the last frame, found by voxel, or new."""

    warped: int
    found: int
    appended: int


@dataclass(frozen=True, slots=True)
class _LastFrame:
    index: NDArray[np.int32]
    depth: NDArray[np.float32]
    colour: NDArray[np.uint8]
    camera: Intrinsics
    T_world_camera: NDArray[np.float64]


class IndexMap:
    """For each pixel of the last fused frame, the row of its map point (paper: indexMap)."""

    def __init__(self, settings: FusionSettings) -> None:
        self.settings = settings
        self._last: _LastFrame | None = None

    def clear(self) -> None:
        """Forget the last frame: the next one meets the map through the voxels only."""
        self._last = None

    def register(
        self,
        heatmap: Heatmap3D,
        frame_number: int,
        colour: NDArray[np.uint8],
        depth: NDArray[np.float32],
        heat: NDArray[np.uint8],
        camera: Intrinsics,
        T_world_camera: NDArray[np.float64],
    ) -> MatchCounts:
        """Fuse one frame into the map: match pixels to points, update running means, append what is new.

        colour: (h, w, 3) uint8; depth: (h, w) float32 metres, 0 = invalid; heat: (h, w) uint8 255ths.
        A point's heat and frequency grow once a frame, however many pixels fall on it.
        """
        settings = self.settings
        lacking = heatmap.count + depth.size - heatmap.limit
        if heatmap.count > 0 and lacking > 0:
            self._make_room(heatmap, lacking)
        last = self._last
        candidates = np.full(depth.shape, -1, np.int32)
        if last is not None and last.camera == camera:
            T_camera_last = invert(T_world_camera) @ last.T_world_camera
            warp(
                last.index,
                last.depth,
                last.colour,
                depth,
                colour,
                T_camera_last.astype(np.float32),
                *_pinhole(camera),
                np.float32((255 * settings.colour_gate) ** 2),
                np.float32(settings.depth_gate),
                np.float32(settings.noise_gate),
                camera.noise.coefficients(),
                np.full(depth.shape, np.inf, np.float32),
                candidates,
            )
        index = np.full(depth.shape, -1, np.int32)
        heatmap.used, heatmap.free_count, registration = merge(
            heatmap.rows,
            heatmap.used,
            heatmap.keys,
            heatmap.slot_rows,
            heatmap.row_slots,
            heatmap.free,
            heatmap.free_count,
            candidates,
            depth,
            colour,
            heat,
            surface_normals(depth, camera),
            T_world_camera.astype(np.float32),
            *_pinhole(camera),
            np.float32(1 / heatmap.voxel),
            np.float32(settings.noise_gate),
            camera.noise.coefficients(),
            np.float32(settings.range_max),
            np.float32(frame_number),
            settings.noise_weighting,
            settings.look_up,
            index,
        )
        self._last = _LastFrame(index, depth, colour, camera, T_world_camera)
        return MatchCounts(*registration)

    def _make_room(self, heatmap: Heatmap3D, rows: int) -> None:
        """Evict the least useful points; what a frame brings beyond the room that makes is left out."""
        if heatmap.evict(rows, self.settings.tau) > 0 and self._last is not None:
            index = self._last.index
            gone = heatmap.rows[index, FREQUENCY] == 0  # of index -1 whatever it says: it stays -1
            self._last = replace(self._last, index=np.where(gone, np.int32(-1), index))


def _pinhole(camera: Intrinsics) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    return np.float32(camera.fx), np.float32(camera.fy), np.float32(camera.cx), np.float32(camera.cy)


@kernel(
    "void(i4[:,::1], f4[:,::1], u1[:,:,::1], f4[:,::1], u1[:,:,::1], f4[:,::1], f4, f4, f4, f4, f4, f4, f4,"
    " UniTuple(f4, 3), f4[:,::1], i4[:,::1])"
)
def warp(
    last_index: NDArray[np.int32],
    last_depth: NDArray[np.float32],
    last_colour: NDArray[np.uint8],
    depth: NDArray[np.float32],
    colour: NDArray[np.uint8],
    T_camera_last: NDArray[np.float32],
    fx: np.float32,
    fy: np.float32,
    cx: np.float32,
    cy: np.float32,
    colour_gate: np.float32,
    depth_gate: np.float32,
    noise_gate: np.float32,
    noise: tuple[np.float32, np.float32, np.float32],
    nearest: NDArray[np.float32],
    index: NDArray[np.int32],
) -> None:
    """Warp the last frame's pixels into this one and keep the matches (paper, Eqs. 11-13).

    A match agrees in colour (squared L2 distance of RGB 0..255 within `colour_gate`) and in depth; of several
    on one pixel the nearest wins. nearest: (h, w), inf; index: (h, w), -1, which the map's rows are written to.
    """
    h, w = depth.shape
    T = T_camera_last
    for v in range(h):
        for u in range(w):
            row = last_index[v, u]
            if row < 0:
                continue
            z = last_depth[v, u]
            x, y = (u - cx) * z / fx, (v - cy) * z / fy
            zw = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
            if zw <= 0:
                continue
            uw = int(np.rint(fx * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / zw + cx))
            vw = int(np.rint(fy * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / zw + cy))
            if uw < 0 or uw >= w or vw < 0 or vw >= h or zw >= nearest[vw, uw]:
                continue
            if abs(depth[vw, uw] - zw) > max(depth_gate, noise_gate * axial_noise_kernel(zw, noise)):
                continue
            difference = np.float32(0)
            for i in range(3):
                d = np.float32(colour[vw, uw, i]) - np.float32(last_colour[v, u, i])
                difference += d * d
            if difference <= colour_gate:
                nearest[vw, uw] = zw
                index[vw, uw] = row


@kernel("i4(i8[::1], i4[::1], f4, f4, f4, f4[:,::1], f4, f4, f4)")
def _find_along_ray(
    keys: NDArray[np.int64],
    slot_rows: NDArray[np.int32],
    x: np.float32,
    y: np.float32,
    z: np.float32,
    T_world_camera: NDArray[np.float32],
    distance: np.float32,
    reach: np.float32,
    per_metre: np.float32,
) -> np.int32:
    """Row of the point nearest along the viewing ray within `reach` metres (depth errs along it), or -1."""
    T = T_world_camera
    scale = np.float32(1) / (distance * per_metre)
    sx, sy, sz = (x - T[0, 3]) * scale, (y - T[1, 3]) * scale, (z - T[2, 3]) * scale
    steps = int(reach * per_metre)
    for step in range(steps + 1):
        for sign in range(2):
            if step == 0 and sign == 1:
                continue
            s = np.float32(step if sign == 0 else -step)
            slot = find_slot(keys, voxel_key(x + s * sx, y + s * sy, z + s * sz, per_metre))
            if keys[slot] != np.int64(-1):
                return np.int32(slot_rows[slot])
    return np.int32(-1)


@kernel(
    "Tuple((i8, i8, UniTuple(i8, 3)))(f4[:,::1], i8, i8[::1], i4[::1], i4[::1], i4[::1], i8, i4[:,::1],"
    " f4[:,::1], u1[:,:,::1], u1[:,::1], f4[:,:,::1], f4[:,::1], f4, f4, f4, f4, f4, f4, UniTuple(f4, 3), f4, f4, b1,"
    " b1, i4[:,::1])"
)
def merge(
    rows: NDArray[np.float32],
    used: int,
    keys: NDArray[np.int64],
    slot_rows: NDArray[np.int32],
    row_slots: NDArray[np.int32],
    free: NDArray[np.int32],
    free_count: int,
    candidates: NDArray[np.int32],
    depth: NDArray[np.float32],
    colour: NDArray[np.uint8],
    heat: NDArray[np.uint8],
    normals: NDArray[np.float32],
    T_world_camera: NDArray[np.float32],
    fx: np.float32,
    fy: np.float32,
    cx: np.float32,
    cy: np.float32,
    per_metre: np.float32,
    noise_gate: np.float32,
    noise: tuple[np.float32, np.float32, np.float32],
    range_max: np.float32,
    frame_number: np.float32,
    noise_weighting: bool,
    look_up: bool,
    index: NDArray[np.int32],
) -> tuple[int, int, tuple[int, int, int]]:
    """Give every valid pixel its map point: the candidate, one in the voxels that noise can reach, or a new one.

    The map's arrays and numbers are those of `Heatmap3D`. Position, colour and normal are running means, weighted by
    1 / sigma_z^2 if `noise_weighting`. Without `look_up` all that has no candidate is new, and no voxel is entered.
    Once no row is free, new points are left out. Fills in the index map, which is -1; returns the map's new `used` and
    `free_count`, and how many pixels were warped, found and new.
    """
    h, w = depth.shape
    T = T_world_camera
    warped, found, appended = 0, 0, 0
    for v in range(h):
        for u in range(w):
            z = depth[v, u]
            if not 0 < z <= range_max:
                continue
            dx, dy = (u - cx) / fx, (v - cy) / fy
            # In single precision, as the look-up has it: else a point on a voxel's border is entered in the next.
            x = np.float32((T[0, 0] * dx + T[0, 1] * dy + T[0, 2]) * z + T[0, 3])
            y = np.float32((T[1, 0] * dx + T[1, 1] * dy + T[1, 2]) * z + T[1, 3])
            zw = np.float32((T[2, 0] * dx + T[2, 1] * dy + T[2, 2]) * z + T[2, 3])
            sigma = axial_noise_kernel(z, noise)
            row = candidates[v, u]
            if row >= 0:
                warped += 1
            else:
                if look_up:
                    row = _find_along_ray(keys, slot_rows, x, y, zw, T, z, noise_gate * sigma, per_metre)
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
                        key = voxel_key(x, y, zw, per_metre)
                        slot = find_slot(keys, key)
                        keys[slot], slot_rows[slot], row_slots[row] = key, row, slot
                    rows[row, :] = np.float32(0)
                    rows[row, LAST] = np.float32(-1)
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
            nx, ny, nz = normals[v, u, 0], normals[v, u, 1], normals[v, u, 2]
            for i in range(3):
                rows[row, NORMAL + i] += weight * (T[i, 0] * nx + T[i, 1] * ny + T[i, 2] * nz)
            if rows[row, LAST] != frame_number:
                rows[row, LAST] = frame_number
                rows[row, FREQUENCY] += np.float32(1)
                rows[row, HEAT] += heat[v, u] / np.float32(255)
    return used, free_count, (warped, found, appended)
