"""What things stand on in one view: the plane that holds the heat, how high the rest is above it, what is beside."""

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.depth_noise import KINECT_V1, DepthNoise
from spot3d.geometry.planes import PlaneSettings, on_plane
from spot3d.geometry.upright import rotation_to_upright
from spot3d.segments.settings import SegmentsSettings
from spot3d.segments.upper_side import CLEARLY, IMAGE_UP

FACING = np.float32(0.8)
"""Cosine (37 degrees) of a pixel's normal to that of the plane it lies on; noise tilts normals by less."""
_FACES = np.float32(np.cos(np.radians(25)))
"""... of a pixel that shows what things stand on: few do near a plane through the edges of stairs, which rise by 30
degrees and more. Of things on three rendered stairs 0.85 are found with 15 and 25 degrees, 0.33 where all pixels do; on
other scenes it is the same, to one thing in 60."""

_FROM_BELOW = 0.02
"""What a plane counts that the camera sees along its surface or from below: little, but it may be the only one."""
_REACH = 0.02
"""Pixels this near to a plane show how it is bent, metres: twice what Kinect-type sensors bend a plane at 2 m."""
_SAMPLE = 5000
"""About so many of a plane's pixels are fitted."""
_FITS, _ROBUST = 8, 1.5
"""Rounds of the fit; a pixel this many deviations off weighs little: what stands on the plane does not lift it."""
_CELL = 0.01
"""Cells of the plan on which a support is drawn, metres: a pixel of the lattice at 3 m."""
# With 0.02, 0.05 and 0.1 m, and with 50, 200 and 800 pixels, what is found on redkitchen, clutter (with holes too) and
# TUM's cabinet is the same, to one thing in 120.
_BEYOND = 0.05
"""A support counts so far beyond the edge that is seen of it, metres: depth ends early there, and things overhang."""
_PIECE = 200
"""What lies in a support's plane in fewer connected pixels is none of it: a rung of a chair, noise."""

# In 1620 rendered views of tables with things or cartons, looking down by 5 to 30, 45 to 75 and 80 to 95 degrees,
# the table is chosen in 100, 100, 98.6 % with 0 degrees, 100, 100, 99.7 % with 15, 99.7, 100, 99.8 % with 20 and 95,
# 100, 100 % with 45, where the front of a large box counts too much. From 80 on, rolled by 90 and 180 degrees: in 76,
# 53 % with 0 degrees, 98, 89 % with 15.
_LOOKS_DOWN = np.radians(15)
"""A camera is taken to look so far down: what one from straight above sees of its table faces the camera, not the side
of the image that is up."""


def expected_up(image_up: str) -> NDArray[np.float64]:
    """(3,) unit vector up in the frame of a camera of which only the upper side of the image is known."""
    return np.asarray(np.cos(_LOOKS_DOWN) * IMAGE_UP[image_up] - np.sin(_LOOKS_DOWN) * np.array((0.0, 0.0, 1.0)))


def clearly_faces(planes: NDArray[np.float64], image_up: str) -> bool:
    """Whether a view's main support, the first of (n, 4) planes, faces the upper side of the image as no wall does."""
    return bool((planes[:1, :3] @ IMAGE_UP[image_up] >= CLEARLY).any())


def held_heat(
    planes: NDArray[np.float64],
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    heat: NDArray[np.uint8],
    settings: PlaneSettings,
    noise: DepthNoise = KINECT_V1,
) -> NDArray[np.float64]:
    """(n,) the heat that each plane's inliers hold, 255ths (paper, Eq. 10), times the share that face as it does.

    planes: (n, 4) camera frame; points, normals: (h, w, 3) float32, camera frame, z = 0 invalid; heat: (h, w) uint8,
    255ths. A plane through the edges of stairs has more inliers than any of the treads; few of them face as it does.
    """
    held = []
    for plane in planes:
        on = on_plane(plane, points, settings, noise)
        facing = normals[on] @ plane[:3].astype(np.float32) > _FACES
        share = np.count_nonzero(facing) / max(len(facing), 1)
        held.append(share * float(heat[on].sum(dtype=np.int64)))
    return np.array(held)


def choose_support(
    planes: NDArray[np.float64], held: NDArray[np.float64], up: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """The plane whose inliers hold most heat (paper, Eq. 10), each as much as the plane faces up.

    A hot object's front holds much heat as well, but what things stand on shows its upper side. Where only the upper
    side of the image is known, its normal points there, or towards a camera that looks straight down, while fronts
    point level or, seen from above, downwards.
    planes: (n, 4) camera frame, normals towards the camera; held: (n,) what each holds (see `held_heat`); up: (3,)
    unit, camera frame: `expected_up`, or the true one. None where no plane holds heat.
    """
    best, most = None, 0.0
    for plane, heat in zip(planes, held.tolist(), strict=True):
        counts = heat * max(_FROM_BELOW, float(up @ plane[:3]))
        if counts > most:
            best, most = plane, counts
    return best


def heights(points: NDArray[np.float32], plane: NDArray[np.float64], bent: bool = True) -> NDArray[np.float32]:
    """(h, w) float32 metres above a plane, which is bent slowly over the image as lenses and depth sensors bend it.

    points: (h, w, 3) float32 metres, camera frame, z = 0 invalid; bent: whether the plane is.
    The bend is a quadratic of the pixel, fitted robustly to the pixels near the plane.
    """
    height = points @ plane[:3].astype(np.float32) + np.float32(plane[3])
    h, w = height.shape
    near = np.flatnonzero((points[..., 2] > 0) & (np.abs(height) < _REACH))
    near = near[:: max(1, len(near) // _SAMPLE)]
    if not bent or len(near) < 100:
        return height
    y, x = (np.linspace(-1, 1, count) for count in (h, w))
    terms = _quadratic(x[near % w], y[near // w])
    measured = height.ravel()[near].astype(np.float64)
    weight = np.ones(len(near))
    for _ in range(_FITS):
        weighed = terms * weight[:, None]
        bend = np.linalg.solve(weighed.T @ terms + 1e-3 * np.eye(6), weighed.T @ measured)
        error = measured - terms @ bend
        spread = max(1.4826 * float(np.median(np.abs(error))), 1e-3)
        weight = 1 / (1 + (error / (_ROBUST * spread)) ** 2) ** 2
    # Of each row, what does not grow with x, and what does; all six terms at every pixel take far longer.
    middle, slope = bend[0] + y * (bend[2] + y * bend[5]), bend[1] + y * bend[4]
    grid = middle[:, None] + x * (slope[:, None] + x * bend[3])
    above: NDArray[np.float32] = height - grid.astype(np.float32)
    return above


# Of rendered desks 2.4 m away 65 % are found where noise is all taken for height, 81 % so; of desks 1.7 m away 97 % and
# 97 %. With 7.5, 12.5 and 15 mm in the place of `height_min` it is 84, 76 and 70 %, and success on HOTS 0.89,
# 0.91 and 0.91 for 0.91.
def lift(
    depth: NDArray[np.float32],
    plane: NDArray[np.float64],
    settings: SegmentsSettings,
    noise: DepthNoise = KINECT_V1,
) -> NDArray[np.float32]:
    """How high above a support, at most, noise may lift what lies on it, metres: the shape of depth.

    depth: metres, 0 = invalid; plane: (4,) camera frame. Noise scatters along the ray, which a support that is seen
    along its surface crosses aslant: the further a table is, the less of its noise is height. What is below
    `height_min` is lift in any case, as far as noise reaches: glare and bends are no noise of this kind.
    """
    scatter = np.float32(settings.noise_gate) * noise.sigma(depth)
    aslant = np.float32(plane[3]) / np.maximum(depth, np.float32(1e-3))  # the ray's part along the normal
    lifted = np.maximum(np.minimum(scatter, np.float32(settings.height_min)), scatter * np.minimum(aslant, 1))
    most: NDArray[np.float32] = np.maximum(np.float32(settings.plane_distance), lifted)
    return most


def beside_support(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    height: NDArray[np.float32],
    tolerance: NDArray[np.float32],
    up: NDArray[np.float64],
    settings: SegmentsSettings,
) -> NDArray[np.bool_]:
    """(h, w) bool: pixels no higher than a support that it is not above, as those of a chair at a table.

    points, normals: (h, w, 3) float32, camera frame, z = 0 invalid; height, tolerance: (h, w) float32 metres above the
    support, and what of it may be noise (see `lift`); up: (3,) its unit normal. A support reaches over the convex hull
    of what is seen of it: what stands on it hides some of it. What lies in its plane and faces up is of it, wherever it
    is.
    """
    low = (points[..., 2] > 0) & (points[..., 2] <= settings.range_max) & (height <= tolerance)
    on = low & (height >= -tolerance) & (normals @ up.astype(np.float32) > FACING)
    low &= ~on
    _, piece, sizes, _ = cv2.connectedComponentsWithStats(on.astype(np.uint8), connectivity=4)
    large = sizes[:, cv2.CC_STAT_AREA] >= _PIECE
    large[0] = False  # what is on no piece
    seen = points[large[piece]]
    if not len(seen):
        return np.zeros_like(low)
    low[low] = ~above_extent(points[low], seen, up)
    return low


def above_extent(asked: NDArray[np.float32], seen: NDArray[np.float32], up: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n,) bool: which of (n, 3) points are above or below the convex hull of (m, 3) points, m > 0, seen from above.

    The hull reaches a little further than they do: depth ends early at an edge, and things overhang.
    """
    across = (rotation_to_upright(up)[:2].T / _CELL).astype(np.float32)
    seen, asked = seen @ across, asked @ across
    # The plan, and which of its cells are the support's.
    margin = round(_BEYOND / _CELL)
    corner = seen.min(axis=0) - np.float32(margin + 1)
    w, h = (np.ceil(seen.max(axis=0) - corner) + margin + 2).astype(int)
    extent = np.zeros((h, w), np.uint8)
    cv2.fillConvexPoly(extent, np.rint(cv2.convexHull(seen - corner)).astype(np.int32), 1)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * margin + 1, 2 * margin + 1))
    extent = cv2.dilate(extent, disc)
    x, y = np.clip(np.rint(asked - corner), 0, (w - 1, h - 1)).astype(np.int32).T  # the rim is no support's
    return np.asarray(extent[y, x] != 0)


def _quadratic(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack((np.ones_like(x), x, y, x * x, x * y, y * y), axis=1)
