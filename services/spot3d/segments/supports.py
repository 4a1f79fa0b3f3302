"""The support of one view: the plane that holds most heat, the heights above it, and the pixels beside it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.depth_noise import KINECT_V1, DepthNoise
from spot3d.geometry.planes import PlaneSettings, on_plane
from spot3d.geometry.upright import taken
from spot3d.segments.settings import SegmentsSettings
from spot3d.segments.upper_side import CLEARLY, IMAGE_UP
from spot3d.trajectory import rotation_to_z

FACING = np.float32(0.8)
"""Cosine (37 degrees) between a pixel's normal and that of the plane it lies on; noise tilts normals by less."""
_FACING_COS = np.float32(np.cos(np.radians(25)))
"""The same for a pixel that counts for a support: few do near a plane through the edges of stairs, which rise by 30
degrees and more. Objects found on three rendered stairs: 0.85 with 15 and 25 degrees, 0.33 if all pixels count; on
other scenes the same, to one object in 60."""

_LEAST_WEIGHT = 0.02
"""Weight of a plane that does not face up: little, but it may be the only one."""
_REACH = 0.02
"""The bend is fitted to pixels this near to the plane, metres: twice what Kinect-type sensors bend a plane at 2 m."""
_SAMPLE = 5000
"""The bend is fitted to about this many pixels."""
_FITS, _ROBUST = 8, 1.5
"""Rounds of the fit; a pixel this many deviations off weighs little, so that objects on the plane do not lift it."""
_WINDOW, _ROUNDS = (65, 65), 2
"""The mean of what a quadratic leaves within `plane_distance`, in a window of 12 degrees (pixels of the lattice), is
bend as well, in two rounds. Success / detection of single frames of HOTS: 0.93 / 0.95 with it and without; 0.90 / 0.93
and 0.85 / 0.89 where depth is bent by 0.5 %, 0.83 / 0.87 and 0.80 / 0.82 by 1 %, otherwise in each image. With twice
the distance 0.88 / 0.91 there, but near desks have a quarter of a box of no object a scene more. OSD is the same with
all of them, and HOTS with 9 and 15 degrees to 0.01."""
_UNBENT = np.float32(0.1)
"""Where the support is seen on less than this share of the window, less than half of the mean counts. With 0.1, 0.15,
0.3 HOTS and OSD are the same to 0.01."""
_CELL = 0.01
"""Cell size of the plan on which a support is drawn, metres: a pixel of the lattice at 3 m."""
# With 0.02, 0.05 and 0.1 m, and with 50, 200 and 800 pixels, detections on redkitchen, clutter (with holes too) and
# TUM's cabinet are the same, to one object in 120.
_BEYOND = 0.05
"""A support extends this far beyond its seen edge, metres: depth ends early there, and objects overhang."""
_PIECE = 200
"""Fewer connected pixels than this in a support's plane are not part of it: a rung of a chair, noise."""

# In 1620 rendered views of tables with objects or cartons that look down by 5 to 30, 45 to 75 and 80 to 95 degrees, the
# table is chosen in 100, 100, 98.6 % with 0 degrees, in 100, 100, 99.7 % with 15, in 99.7, 100, 99.8 % with 20 and in
# 95, 100, 100 % with 45, where the front of a large box counts too much. In views from 80 degrees on, rolled by 90 and
# 180 degrees: in 76, 53 % with 0 degrees, in 98, 89 % with 15.
_LOOKS_DOWN = np.radians(15)
"""Assumed downward tilt of a camera: seen from straight above, a table faces the camera, not the upper side of the
image."""


def expected_up(image_up: str) -> NDArray[np.float64]:
    """(3,) unit vector up in the camera frame if only the upper side of the image is known."""
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
    """(n,) heat of each plane's inliers, 255ths (paper, Eq. 10), times the share of them with the plane's normal.

    planes: (n, 4) camera frame; points, normals: (h, w, 3) float32, camera frame, z = 0 invalid; heat: (h, w) uint8,
    255ths. A plane through the edges of stairs has more inliers than any of the treads, but few have its normal.
    """
    held = []
    for plane in planes:
        on = on_plane(plane, points, settings, noise)
        facing = on & (normals @ plane[:3].astype(np.float32) > _FACING_COS)
        share = np.count_nonzero(facing) / max(int(np.count_nonzero(on)), 1)
        held.append(share * float(heat[on].sum(dtype=np.int64)))
    return np.array(held)


def choose_support(
    planes: NDArray[np.float64], held: NDArray[np.float64], up: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """The plane whose inliers hold most heat (paper, Eq. 10), weighted by how much it faces up; None without heat.

    A hot object's front holds much heat as well, but a support shows its upper side. If only the upper side of the
    image is known, the support's normal points there, or towards a camera that looks straight down. Those of fronts are
    level or, seen from above, point downwards.
    planes: (n, 4) camera frame, normals towards the camera; held: (n,) heat of each (see `held_heat`); up: (3,) unit,
    camera frame: `expected_up`, or the true one.
    """
    best, most = None, 0.0
    for plane, heat in zip(planes, held.tolist(), strict=True):
        counts = heat * max(_LEAST_WEIGHT, float(up @ plane[:3]))
        if counts > most:
            best, most = plane, counts
    return best


# Nine tenths of the pixels on the supports of HOTS, OSD, redkitchen and TUM's cabinet lie within 2 to 7 mm of these
# where depth is not bent, and 0.35 to 0.6 mm farther for each millimetre that it is: a quadratic fits the corners of an
# image worst. With 0, a quarter and a half of the bend success on HOTS is 0.89, 0.92 and 0.92, on four near desks 0.89,
# 0.89 and 0.84, and redkitchen's odometry finds 4, 4 and 3 objects.
_BEND_UNSURE = np.float32(0.25)
"""Share of the bend by which heights may be off."""


def heights_and_tolerance(
    points: NDArray[np.float32], plane: NDArray[np.float64], settings: SegmentsSettings, noise: DepthNoise
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(h, w) float32 metres above a plane, and how much of that may be noise.

    points: (h, w, 3) float32 metres, camera frame, z = 0 invalid. Heights are corrected for the slow bend over the
    image by lenses and depth sensors, unless `settings` skip it.
    """
    height = points @ plane[:3].astype(np.float32) + np.float32(plane[3])
    depth = np.ascontiguousarray(points[..., 2])
    tolerance = noise_height(depth, plane, settings, noise)
    if "bend" in settings.skipped:
        return height, tolerance
    bend = _bend(height, depth > 0, settings.plane_distance)
    tolerance += _BEND_UNSURE * np.abs(bend)
    return height - bend, tolerance


def _bend(height: NDArray[np.float32], valid: NDArray[np.bool_], reach: float) -> NDArray[np.float32]:
    """(h, w) float32 metres: a quadratic of the pixel, fitted robustly to the heights near zero, and the mean of what
    it leaves within `reach` metres around each pixel. 0 if these are few."""
    h, w = height.shape
    near = np.flatnonzero(valid & (np.abs(height) < _REACH))
    near = near[:: max(1, len(near) // _SAMPLE)]
    if len(near) < 100:
        return np.zeros_like(height)
    y, x = (np.linspace(-1, 1, count) for count in (h, w))
    u, v = x[near % w], y[near // w]
    terms = np.stack((np.ones_like(u), u, v, u * u, u * v, v * v), axis=1)
    measured = height.ravel()[near].astype(np.float64)
    weight = np.ones(len(near))
    for _ in range(_FITS):
        weighed = terms * weight[:, None]
        fit = np.linalg.solve(weighed.T @ terms + 1e-3 * np.eye(6), weighed.T @ measured)
        error = measured - terms @ fit
        spread = max(1.4826 * float(np.median(np.abs(error))), 1e-3)
        weight = 1 / (1 + (error / (_ROBUST * spread)) ** 2) ** 2
    # Constant and linear terms of each row: computing all six terms at every pixel takes far longer.
    middle, slope = fit[0] + y * (fit[2] + y * fit[5]), fit[1] + y * fit[4]
    grid = middle[:, None] + x * (slope[:, None] + x * fit[3])
    bend = np.asarray(grid, np.float32)
    for _ in range(_ROUNDS):
        left = height - bend
        on = (valid & (np.abs(left) < reach)).astype(np.float32)
        bend += cv2.blur(left * on, _WINDOW) / (cv2.blur(on, _WINDOW) + _UNBENT)
    return bend


# Found on rendered desks 2.4 m away: 65 % if all noise counts as height, 81 % with this; 1.7 m away: 97 and 97 %. With
# 7.5, 12.5 and 15 mm instead of `height_min`: 84, 76 and 70 %, and success on HOTS 0.89, 0.91 and 0.91 (0.91 with it).
def noise_height(
    depth: NDArray[np.float32], plane: NDArray[np.float64], settings: SegmentsSettings, noise: DepthNoise = KINECT_V1
) -> NDArray[np.float32]:
    """Largest height above a support, metres, to which noise may lift points on it, in the shape of `depth`.

    depth: metres, 0 = invalid; plane: (4,) camera frame. Noise scatters along the ray, which crosses a support seen at
    a grazing angle obliquely: the farther a table is, the less of its noise is height. Up to `height_min` all noise
    counts as height: glare and bends are no noise of this kind.
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
    """(h, w) bool: pixels no higher than a support and outside its extent, such as those of a chair at a table.

    points, normals: (h, w, 3) float32, camera frame, z = 0 invalid; height, tolerance: (h, w) float32 metres above the
    support, and how much of it may be noise (see `noise_height`); up: (3,) its unit normal. A support covers the convex
    hull of its seen points, because objects on it hide others. Pixels in its plane that face up belong to it anywhere.
    """
    depth = np.ascontiguousarray(points[..., 2])
    low = (depth > 0) & (depth <= settings.range_max) & (height <= tolerance)
    on = low & (height >= -tolerance) & (normals @ up.astype(np.float32) > FACING)
    low &= ~on
    piece = np.asarray(cv2.connectedComponents(on.astype(np.uint8), connectivity=4)[1], np.int32)
    large = np.bincount(piece.ravel()) >= _PIECE
    large[0] = False  # pixels on no piece
    flat = points.reshape(-1, 3)
    seen = taken(flat, np.flatnonzero(large.take(piece)))
    if not len(seen):
        return np.zeros_like(low)
    low[low] = ~above_extent(taken(flat, np.flatnonzero(low)), seen, up)
    return low


def above_extent(asked: NDArray[np.float32], seen: NDArray[np.float32], up: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n,) bool: which of (n, 3) points `asked` are above or below the convex hull, seen from above, of (m, 3) `seen`.

    m > 0. The hull is extended by `_BEYOND`: depth ends early at an edge, and objects overhang.
    """
    if not len(asked):
        return np.zeros(0, np.bool_)
    across = (rotation_to_z(up)[:2].T / _CELL).astype(np.float32)
    # Axis by axis in memory: extremes of (n, 2) values in rows take fifty times as long.
    seen, asked = np.asfortranarray(seen @ across), np.asfortranarray(asked @ across)
    # The plan around the asked points, as a floor may reach far, and which of its cells the support covers.
    margin = round(_BEYOND / _CELL)
    corner = seen.min(axis=0) - np.float32(margin + 1)
    corner += np.floor(np.maximum(asked.min(axis=0) - np.float32(margin + 1) - corner, 0))
    end = np.minimum(seen.max(axis=0), asked.max(axis=0))
    w, h = (np.maximum(np.ceil(end - corner), 0) + margin + 2).astype(int)
    extent = np.zeros((h, w), np.uint8)
    cv2.fillConvexPoly(extent, np.rint(cv2.convexHull(_outermost(seen - corner))).astype(np.int32), 1)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * margin + 1, 2 * margin + 1))
    extent = cv2.dilate(extent, disc)
    x, y = np.clip(np.rint(asked - corner), 0, (w - 1, h - 1)).astype(np.int32).T  # cells at the rim are free
    return np.asarray(extent[y, x] != 0)


def _outermost(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Those of (n, 2) points that may be corners of their convex hull, whose time grows with their number.

    They are outside the octagon of the points that are farthest in eight directions, or at most one unit within.
    """
    along = np.array(((1, 0), (1, 1), (0, 1), (-1, 1)), np.float32) @ points.T
    farthest = points[np.concatenate((along.argmax(axis=1), along.argmin(axis=1)))]
    corners = np.asarray(cv2.convexHull(farthest), np.float32)[:, 0]
    edges = np.roll(corners, -1, axis=0) - corners
    inwards = edges[:, ::-1] * np.array((-1, 1), np.float32)
    depth = inwards @ points.T - (inwards * corners).sum(axis=1, keepdims=True)
    near = (depth <= np.linalg.norm(edges, axis=1, keepdims=True)).any(axis=0)
    return np.asarray(points[near])
