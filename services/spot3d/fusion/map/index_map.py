"""Registration of a frame with the 3D heatmap through the index map (paper, Sec. V-B)."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, invert
from spot3d.fusion.map.heatmap3d import Heatmap3D
from spot3d.fusion.map.map_arrays import FREQUENCY
from spot3d.fusion.map.merging import Merging, Pixels, merge
from spot3d.fusion.settings import FusionSettings
from spot3d.kernel import kernel
from spot3d.sensor import Pinhole, axial_noise_kernel, pinhole


@dataclass(frozen=True, slots=True)
class MatchCounts:
    """How a frame's valid pixels met the map: warped from the last frame, found by voxel, or new."""

    warped: int
    found: int
    appended: int


@dataclass(frozen=True, slots=True)
class _LastFrame:
    index: NDArray[np.int32]
    pixels: Pixels
    camera: Intrinsics
    T_world_camera: NDArray[np.float64]


class IndexMap:
    """For each pixel of the last fused frame, the row of its map point (paper: indexMap).

    The first frame has no predecessor: it is matched through the voxels only.
    """

    def __init__(self, settings: FusionSettings) -> None:
        self._tau = settings.tau
        self.how = Merging(
            colour_gate=np.float32((255 * settings.colour_gate) ** 2),
            depth_gate=np.float32(settings.depth_gate),
            noise_gate=np.float32(settings.noise_gate),
            per_metre=np.float32(1 / settings.voxel),
            range_max=np.float32(settings.range_max),
            noise_weighting=settings.noise_weighting,
            look_up=settings.look_up,
        )
        self._last: _LastFrame | None = None

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
        A point's heat and frequency grow once a frame, however many pixels fall on it. The images are kept, not copied,
        until the next frame.
        """
        lacking = heatmap.count + depth.size - heatmap.limit
        if heatmap.count > 0 and lacking > 0:
            self._make_room(heatmap, lacking)
        last, pixels, seen_by = self._last, Pixels(depth, colour, heat), pinhole(camera)
        candidates, index = (np.full(depth.shape, -1, np.int32) for _ in range(2))
        if last is not None and last.camera == camera:
            T_camera_last = invert(T_world_camera) @ last.T_world_camera
            nearest, T = np.full(depth.shape, np.inf, np.float32), T_camera_last.astype(np.float32)
            warp(last.index, last.pixels, pixels, T, seen_by, self.how, nearest, candidates)
        pose = T_world_camera.astype(np.float32)
        counts = merge(heatmap.arrays, frame_number, pixels, candidates, seen_by, pose, self.how, index)
        self._last = _LastFrame(index, pixels, camera, T_world_camera)
        return MatchCounts(*counts)

    def _make_room(self, heatmap: Heatmap3D, rows: int) -> None:
        """Evict the least useful points; pixels that find no room even so are left out."""
        if heatmap.evict(rows, self._tau) > 0 and self._last is not None:
            index = self._last.index
            gone = heatmap.arrays.rows[index, FREQUENCY] == 0  # at index -1 meaningless: it stays -1
            self._last = replace(self._last, index=np.where(gone, np.int32(-1), index))


@kernel()
def warp(
    last_index: NDArray[np.int32],
    last: Pixels,
    now: Pixels,
    T_camera_last: NDArray[np.float32],
    camera: Pinhole,
    how: Merging,
    nearest: NDArray[np.float32],
    index: NDArray[np.int32],
) -> None:
    """Warp the last frame's pixels into this one and keep the matches (paper, Eqs. 12-14).

    A match agrees in colour and in depth; of several on one pixel the nearest wins. nearest: (h, w), inf; index:
    (h, w), -1, into which the map's rows are written.
    """
    fx, fy, cx, cy, noise = camera
    colour_gate, depth_gate, noise_gate = how.colour_gate, how.depth_gate, how.noise_gate
    (last_depth, last_colour, _), (depth, colour, _) = last, now
    h, w = depth.shape
    T = T_camera_last
    for v in range(h):
        for u in range(w):
            row = last_index[v, u]
            if row < 0:
                continue
            z = last_depth[v, u]
            x, y = (np.float32(u) - cx) * z / fx, (np.float32(v) - cy) * z / fy
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
