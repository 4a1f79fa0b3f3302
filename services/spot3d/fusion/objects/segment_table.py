"""The table of all keyframes' segments, a row each."""

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import back_project
from spot3d.depth_noise import DepthNoise
from spot3d.fusion.objects.growing import Growing
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.fusion.objects.outline import OUTERMOST, outline_of
from spot3d.fusion.objects.views import SAMPLE
from spot3d.geometry.planes import transform_plane

_PIXELS = 20
"""A segment of fewer pixels with depth, on the lattice, has no shape."""
_AROUND = 4
"""A segment's support is sampled this far around it, pixels, and a quarter of its length more."""
_BENT = 0.02
"""Furthest that these samples may be from the plane, metres: what depth sensors bend it by, and no step to another."""


class SegmentTable:
    """Rows of all segments, keyframe after keyframe.

    frame: (n,) int64, number of each one's keyframe; places: (n, SAMPLE, 3) float32 world, its points; spheres: (n, 4)
    float32, centre and radius around these; blur: (n, 3) float32 world, metres, how much more than from near depth
    noise scatters them along the ray; outline: (n, OUTERMOST, 3) float32 world, how far a torn one reaches (see
    `outline`), NaN for others; heat: (n,); colour: (n, 3) mean RGB; pixels: (n,) int64; support: (n, 4) plane, world,
    zeros = none.
    Of the consensus, all (n,): identity: int64, number of the object that it belonged to last, 0 = none; former: int64,
    the number before that; cluster: int64, -1 = none; component: int64, the first row of its connected component;
    touched: bool, something about it is new.
    """

    def __init__(self) -> None:
        self.frame = Growing[np.int64](np.int64)
        self.places = Growing[np.float32](np.float32, SAMPLE, 3)
        self.spheres = Growing[np.float32](np.float32, 4)
        self.blur = Growing[np.float32](np.float32, 3)
        self.outline = Growing[np.float32](np.float32, OUTERMOST, 3)
        self.heat = Growing[np.float64](np.float64)
        self.colour = Growing[np.float64](np.float64, 3)
        self.pixels = Growing[np.int64](np.int64)
        self.support = Growing[np.float64](np.float64, 4)
        self.identity = Growing[np.int64](np.int64)
        self.former = Growing[np.int64](np.int64)
        self.cluster = Growing[np.int64](np.int64)
        self.component = Growing[np.int64](np.int64)
        self.touched = Growing[np.bool_](np.bool_)

    def __len__(self) -> int:
        return len(self.frame)

    def extend(self, keyframe: Keyframe, number: int) -> NDArray[np.int32]:
        """Add the segments of a keyframe that have depth, each as SAMPLE of its points, evenly spread over its pixels.

        Returns the row of each label, (256,), -1 = none.
        """
        T, flat = keyframe.T_map_camera, keyframe.labels.ravel()
        grid = back_project(keyframe.depth, keyframe.camera)
        points = grid.reshape(-1, 3)
        valid = np.flatnonzero((flat > 0) & (points[:, 2] > 0))
        order = valid[np.argsort(flat[valid], kind="stable")]
        labels, starts, counts = np.unique(flat[order], return_index=True, return_counts=True)
        large = counts >= _PIXELS
        labels, counts = labels[large], counts[large]
        members = [order[start : start + count] for start, count in zip(starts[large], counts, strict=True)]
        rows, count = np.full(256, -1, np.int32), len(labels)
        rows[labels] = len(self) + np.arange(count)
        if count == 0:
            return rows
        spread = [pixels[np.linspace(0, len(pixels) - 1, SAMPLE).astype(np.int64)] for pixels in members]
        seen = points[np.array(spread)]
        places = (seen @ T[:3, :3].T + T[:3, 3]).astype(np.float32)
        blur = _blur(seen.mean(axis=1), keyframe.camera.noise) @ T[:3, :3].T
        outlines = np.array([outline_of(keyframe, label) for label in labels.tolist()]) @ T[:3, :3].T + T[:3, 3]
        colours = keyframe.colour.reshape(-1, 3)
        supports = [_support(keyframe, k, pixels, grid) for k, pixels in zip(labels.tolist(), members, strict=True)]
        means = [colours[pixels].mean(axis=0) for pixels in members]
        # All is computed before anything is entered: a failure leaves the table as it is.
        self.component.extend(len(self) + np.arange(count))
        self.frame.extend(np.full(count, number))
        self.places.extend(places)
        self.spheres.extend(spheres_around(places))
        self.blur.extend(blur)
        self.outline.extend(outlines.astype(np.float32))
        self.heat.extend(keyframe.heat[labels.astype(np.int64) - 1])
        self.colour.extend(np.array(means))
        self.pixels.extend(counts)
        self.support.extend(np.array(supports))
        self.identity.extend(np.zeros(count))
        self.former.extend(np.zeros(count))
        self.cluster.extend(np.full(count, -1))
        self.touched.extend(np.ones(count))
        return rows

    def keep(self, chosen: NDArray[np.bool_]) -> None:
        """Keep only the chosen rows, in their order. `component` must then be found anew."""
        for column in vars(self).values():
            column.keep(chosen)


def spheres_around(places: NDArray[np.float32]) -> NDArray[np.float32]:
    """Centre and radius, (n, 4), of a sphere around each segment's points, (n, m, 3)."""
    centres = (places.min(axis=1) + places.max(axis=1)) / 2
    squares = ((places - centres[:, None]) ** 2).sum(axis=2).max(axis=1)
    return np.column_stack((centres, np.sqrt(squares))).astype(np.float32)


def _blur(middles: NDArray[np.float32], noise: DepthNoise) -> NDArray[np.float64]:
    """Vectors along the rays to (n, 3) points, camera frame: depth's standard deviation less its floor."""
    rays = middles / np.linalg.norm(middles, axis=1, keepdims=True)
    return np.asarray((noise.sigma(middles[:, 2]) - noise.floor)[:, None] * rays, np.float64)


def _support(
    keyframe: Keyframe, label: int, pixels: NDArray[np.int64], grid: NDArray[np.float32]
) -> NDArray[np.float64]:
    """The plane that a segment stands on, world, shifted to its points around the segment, as depth bends planes.

    pixels: flat numbers of the segment's; grid: (h, w, 3) float32 points, camera frame. Zeros: it stands on none.
    """
    number = keyframe.stands_on[label - 1]
    if number < 0:
        return np.zeros(4)
    plane: NDArray[np.float64] = keyframe.planes[number]
    v, u = np.divmod(pixels, grid.shape[1])
    reach = _AROUND + int(max(np.ptp(v), np.ptp(u)) / 4)
    rows = slice(max(0, v.min() - reach), v.max() + reach + 1)
    columns = slice(max(0, u.min() - reach), u.max() + reach + 1)
    height = grid[rows, columns] @ plane[:3].astype(np.float32) + np.float32(plane[3])
    bare = (keyframe.labels[rows, columns] == 0) & (grid[rows, columns, 2] > 0) & (np.abs(height) < _BENT)
    if np.count_nonzero(bare) >= _PIXELS:
        plane = np.append(plane[:3], plane[3] - float(np.median(height[bare])))
    return transform_plane(plane, keyframe.T_map_camera)
