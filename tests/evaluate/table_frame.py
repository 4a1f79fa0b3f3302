"""A made-up depth image: a table seen from above at a slant, with boxes standing on it."""

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics

CAMERA = Intrinsics(292.5, 292.5, 159.7, 119.7, 320, 240)
SLANT = np.radians(50)
# World: z up, the table at z = 0. The camera stands 0.8 m above it and looks down at a slant along y.
T_WORLD_CAMERA = np.eye(4)
T_WORLD_CAMERA[:3, :3] = np.array([[1, 0, 0], [0, -np.sin(SLANT), np.cos(SLANT)], [0, -np.cos(SLANT), -np.sin(SLANT)]])
T_WORLD_CAMERA[:3, 3] = (0.0, -0.65, 0.8)

Block = tuple[tuple[float, float, float], tuple[float, float, float]]
"""The lowest and the highest corner of a box along the world's axes."""
BLOCKS: tuple[Block, ...] = (
    ((-0.30, -0.05, 0.0), (-0.20, 0.05, 0.12)),
    ((0.05, 0.0, 0.0), (0.20, 0.10, 0.08)),
)


def table_depth(
    blocks: tuple[Block, ...] = BLOCKS, T_world_camera: NDArray[np.float64] = T_WORLD_CAMERA
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Exact depth (h, w) float32 metres, and what each pixel shows: 1 the table, 2 and up the boxes."""
    u, v = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    rays = np.stack(((u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)), axis=-1)
    rays, eye = rays @ T_world_camera[:3, :3].T, T_world_camera[:3, 3]
    depth, shown = -eye[2] / rays[..., 2], np.ones(u.shape, np.int64)
    for number, block in enumerate(blocks, start=2):
        entries = (np.array(block)[:, None, None] - eye) / rays
        near, far = entries.min(axis=0).max(axis=-1), entries.max(axis=0).min(axis=-1)
        hit = (near < far) & (near > 0) & (near < depth)
        depth[hit], shown[hit] = near[hit], number
    return depth.astype(np.float32), shown
