"""Where the supporting plane of a keyframe lies in the frames after it, by the paper's method (Sec. V-A, Eq. 11)."""

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, invert


def project_inliers(
    inliers: NDArray[np.float32], T_world_camera: NDArray[np.float64], camera: Intrinsics
) -> NDArray[np.bool_]:
    """The pixels, (h, w), onto which a keyframe's points on its plane project, rounded to the nearest.

    inliers: (n, 3) metres, world. The paper compares no depth: what the frame sees at a pixel does not matter.
    """
    T = invert(T_world_camera).astype(np.float32)
    x, y, z = (inliers @ T[:3, :3].T + T[:3, 3]).T
    ahead = z > 0
    u = np.rint(camera.fx * x[ahead] / z[ahead] + camera.cx)
    v = np.rint(camera.fy * y[ahead] / z[ahead] + camera.cy)
    within = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    pixels = np.zeros(camera.shape, np.bool_)
    pixels[v[within].astype(np.int64), u[within].astype(np.int64)] = True
    return pixels
