"""Image features with depth: corners that can be recognised again, and their 3D points."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.depth_noise import KINECT_V1, DepthNoise
from spot3d.kernel import kernel

# ORB's pyramid: features are recognised from half to twice the distance.
_LEVELS, _SCALE = 4, 1.4
_CORNER = 15
# A feature's neighbours at this distance (pixels) must lie on the same surface: no depth is known at an edge.
_AROUND = 3
# They may differ by a slope and by the noise, which grows with the square of the range: metres, 1/m.
_STEP, _STEP_GROWTH = 0.01, 0.01


@dataclass(frozen=True, slots=True)
class Features:
    """Features of one frame, all with depth.

    pixels: (n, 2) float64, u and v inside the image; points: (n, 3) float64 metres in the camera frame;
    descriptors: (n, 4) uint64, ORB's 256 bits; blur: (n,) float64, standard deviation of the pixel's coordinates;
    noise: of their depth.
    """

    pixels: NDArray[np.float64]
    points: NDArray[np.float64]
    descriptors: NDArray[np.uint64]
    blur: NDArray[np.float64]
    noise: DepthNoise = KINECT_V1

    def __len__(self) -> int:
        return len(self.pixels)

    def information(self, camera: Intrinsics, seen_again: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
        """Information (6, 6) on the pose, 1/m2 and 1/rad2, for a shift and a turn about the camera in its own axes.

        seen_again: (n,) the features that count; None: all.
        """
        chosen = slice(None) if seen_again is None else seen_again
        points, z = self.points[chosen], self.points[chosen, 2]
        across, along = self.blur[chosen] * z / camera.fx, self.noise.sigma(z)
        J = np.concatenate((np.tile(np.eye(3), (len(points), 1, 1)), -_crossed(points)), axis=2)
        J /= np.stack((across, across, along), axis=1)[:, :, None]
        rows = J.reshape(-1, 6)
        return np.asarray(rows.T @ rows)


class FeatureDetector:
    """ORB (Rublee et al. 2011) on the grey image; features at depth edges or out of range are left out."""

    def __init__(self, count: int, range_max: float) -> None:
        self._orb = cv2.ORB.create(
            nfeatures=count, scaleFactor=_SCALE, nlevels=_LEVELS, scoreType=cv2.ORB_FAST_SCORE, fastThreshold=_CORNER
        )
        self._range_max = range_max

    def detect(self, colour: NDArray[np.uint8], depth_m: NDArray[np.float32], camera: Intrinsics) -> Features:
        """Features of a frame: colour (h, w, 3) uint8 RGB, registered with depth (h, w) float32 metres, 0 = invalid."""
        keypoints, found = self._orb.detectAndCompute(cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY), None)
        pixels = np.asarray(cv2.KeyPoint.convert(keypoints), np.float64).reshape(-1, 2)
        blur = _SCALE ** np.array([point.octave for point in keypoints], np.float64)
        z = np.zeros(len(pixels))
        _depth_at(np.ascontiguousarray(depth_m, np.float32), pixels, self._range_max, z)
        seen = z > 0
        pixels, blur, z = pixels[seen], blur[seen], z[seen]
        x, y = (pixels[:, 0] - camera.cx) / camera.fx * z, (pixels[:, 1] - camera.cy) / camera.fy * z
        descriptors = np.zeros((0, 4), np.uint64) if found is None else np.asarray(found[seen]).view(np.uint64)
        return Features(pixels, np.stack((x, y, z), axis=1), descriptors, blur, camera.noise)


def _crossed(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The matrices (n, 3, 3) that take the cross product of (n, 3) points with a vector."""
    return np.cross(points[:, None, :], np.eye(3)[None], axis=2).transpose(0, 2, 1)


@kernel()
def _depth_at(
    depth: NDArray[np.float32], pixels: NDArray[np.float64], range_max: float, mean: NDArray[np.float64]
) -> None:
    """Mean depth (n,) of each pixel and its four neighbours, metres; left at 0 where they are not on one surface."""
    rows, columns = depth.shape
    for i in range(len(pixels)):
        u, v = int(np.rint(pixels[i, 0])), int(np.rint(pixels[i, 1]))
        if not (_AROUND <= u < columns - _AROUND and _AROUND <= v < rows - _AROUND):
            continue
        z = float(depth[v, u])
        total, same = z, 0.0 < z < range_max
        for du, dv in ((_AROUND, 0), (-_AROUND, 0), (0, _AROUND), (0, -_AROUND)):
            near = float(depth[v + dv, u + du])
            same = same and abs(near - z) < _STEP + _STEP_GROWTH * z * z
            total += near
        if same:
            mean[i] = total / 5
