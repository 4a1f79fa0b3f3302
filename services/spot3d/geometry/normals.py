"""Surface normals of a depth image."""

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.kernel import kernel
from spot3d.sensor import axial_noise_kernel

_REACH = 3
"""Pixels between the centre and each end of the differences."""


def surface_normals(depth: NDArray[np.float32], camera: Intrinsics) -> NDArray[np.float32]:
    """Unit normals towards the camera, from central differences of depth.

    depth: (h, w) float32 metres, 0 = invalid.
    Returns (h, w, 3) float32, camera frame; zeros where the surface is not continuous.
    """
    fx, fy, cx, cy = (np.float32(value) for value in (camera.fx, camera.fy, camera.cx, camera.cy))
    normals = np.zeros((*depth.shape, 3), np.float32)
    _normals(np.require(depth, np.float32, ["C", "W"]), fx, fy, cx, cy, camera.noise.coefficients(), normals)
    return normals


@kernel("void(f4[:,::1], f4, f4, f4, f4, UniTuple(f4, 3), f4[:,:,::1])")
def _normals(
    depth: NDArray[np.float32],
    fx: np.float32,
    fy: np.float32,
    cx: np.float32,
    cy: np.float32,
    noise: tuple[np.float32, np.float32, np.float32],
    normals: NDArray[np.float32],
) -> None:
    """Cross product of the horizontal and the vertical difference; one-sided at the rims of surfaces."""
    h, w = depth.shape
    for v in range(h):
        for u in range(w):
            z = depth[v, u]
            if not z > 0:
                continue
            # A surface seen at 80 degrees slopes by tan(80 deg) pixel footprints; more is a jump.
            jump = np.float32(6 * _REACH) * z / fx + np.float32(4) * axial_noise_kernel(z, noise)
            left, right, up, down = u, u, v, v
            if u >= _REACH and depth[v, u - _REACH] > 0 and abs(depth[v, u - _REACH] - z) < jump:
                left = u - _REACH
            if u + _REACH < w and depth[v, u + _REACH] > 0 and abs(depth[v, u + _REACH] - z) < jump:
                right = u + _REACH
            if v >= _REACH and depth[v - _REACH, u] > 0 and abs(depth[v - _REACH, u] - z) < jump:
                up = v - _REACH
            if v + _REACH < h and depth[v + _REACH, u] > 0 and abs(depth[v + _REACH, u] - z) < jump:
                down = v + _REACH
            if left == right or up == down:
                continue
            za, zb, zc, zd = depth[v, left], depth[v, right], depth[up, u], depth[down, u]
            az, bz = zb - za, zd - zc
            ax = ((np.float32(right) - cx) * zb - (np.float32(left) - cx) * za) / fx
            ay = (np.float32(v) - cy) * az / fy
            bx = (np.float32(u) - cx) * bz / fx
            by = ((np.float32(down) - cy) * zd - (np.float32(up) - cy) * zc) / fy
            nx, ny, nz = az * by - ay * bz, ax * bz - az * bx, ay * bx - ax * by
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            if length > 0:
                normals[v, u, 0], normals[v, u, 1], normals[v, u, 2] = nx / length, ny / length, nz / length
