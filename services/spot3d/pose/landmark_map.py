"""The map of landmarks: image features with known positions in the world."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, invert
from spot3d.kernel import kernel, part
from spot3d.pose.features import Features

# Most bits of 256 in which ORB descriptors of one corner differ, and their largest ratio to the second best nearby.
_BITS_MAX, _RATIO = 50, 0.85
# A match lies within this share of the image's width of where it is expected, and within this depth (m, share).
_REACH = 0.04
_DEPTH_STEP, _DEPTH_SHARE = 0.1, 0.03
# A landmark's position is fixed after this many sightings: a map that follows the camera does not constrain it.
_SETTLED = 5
# Landmarks that were in view this often, but recognised in less than this share of it, are chance corners;
# they are removed every so many frames.
_TRIALS, _KNOWN_AGAIN, _TIDY_CYCLE = 15, 0.15, 15
_NONE = -1

LANDMARK = np.dtype(
    [
        ("position", np.float64, 3),  # metres, world
        ("descriptor", np.uint64, 4),
        ("weight", np.float64),  # of the position, 1/m2
        ("sightings", np.int64),  # frames that recognised it
        ("views", np.int64),  # frames that had it in view
        ("last", np.int64),  # last frame that recognised it
    ]
)


@dataclass(frozen=True, slots=True)
class Matches:
    """The landmarks matched to the features of a frame.

    landmark: (n,) int64, row of the map, -1 = none; visible: (m,) int64, the landmarks that should be in view.
    """

    landmark: NDArray[np.int64]
    visible: NDArray[np.int64]


class LandmarkMap:
    """A bounded map of landmarks: `rows` of the type LANDMARK, at most `limit`; `forgotten`: how many were dropped."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.rows = np.zeros(0, LANDMARK)
        self.forgotten = 0
        self._frames = 0

    def restore(self, rows: NDArray[np.void]) -> None:
        """Replace the map by the rows of another one, if too many by those recognised last."""
        self.rows = rows[np.argsort(-rows["last"], kind="stable")[: self.limit]]
        self._frames = int(rows["last"].max(initial=0))

    def match(self, features: Features, camera: Intrinsics, T_world_camera: NDArray[np.float64]) -> Matches:
        """Match features with the landmarks that the pose expects near them; each landmark at most once."""
        lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        size = np.array([camera.width, camera.height], np.float64)
        reach = _REACH * camera.width
        visible, expected = np.empty(len(self.rows), np.int64), np.empty((len(self.rows), 3))
        count = _project(self.rows["position"], invert(T_world_camera), lens, size, visible, expected)
        visible, expected = visible[:count], expected[:count]
        first = np.full((int(size[1] / reach) + 3, int(size[0] / reach) + 3), _NONE)
        following, owner, difference = np.full((3, count), _NONE)
        difference[:] = _BITS_MAX + 1
        notes, found = _Notes(first, following, owner, difference), np.full(len(features), _NONE)
        pixels, points, descriptors = features.pixels, features.points, features.descriptors
        _find_nearest(pixels, points, descriptors, expected, self.rows["descriptor"][visible], reach, notes, found)
        return Matches(np.where(found >= 0, np.append(visible, _NONE)[found], _NONE), visible)

    def insert(
        self, features: Features, matches: Matches, trusted: NDArray[np.bool_], T_world_camera: NDArray[np.float64]
    ) -> None:
        """Add a frame: average the positions of recognised landmarks, and make landmarks of unmatched features.

        trusted: (n,) bool, the features whose match fits the pose. Makes `matches` invalid.
        """
        self._frames += 1
        places = features.points @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]
        weights = 1 / features.noise.sigma(features.points[:, 2]) ** 2
        known = matches.landmark[trusted]
        rows = self.rows
        weight = np.where(rows["sightings"][known] < _SETTLED, weights[trusted], 0.0)
        share = weight / (rows["weight"][known] + weight)
        rows["position"][known] += share[:, None] * (places[trusted] - rows["position"][known])
        rows["weight"][known] += weight
        rows["sightings"][known] += 1
        rows["last"][known] = self._frames
        rows["views"][matches.visible] += 1
        unknown = matches.landmark < 0
        new = np.zeros(np.count_nonzero(unknown), LANDMARK)
        new["position"], new["descriptor"] = places[unknown], features.descriptors[unknown]
        new["weight"], new["sightings"], new["views"], new["last"] = weights[unknown], 1, 1, self._frames
        new = new[: self.limit]
        if self._frames % _TIDY_CYCLE == 0 or len(rows) + len(new) > self.limit:
            rows = self._tidied(self.limit - len(new))
        self.rows = np.concatenate((rows, new))

    def _tidied(self, room: int) -> NDArray[np.void]:
        """The landmarks without chance corners; if these exceed `room`, the last recognised ones, half of `room`."""
        rows = self.rows
        rows = rows[(rows["views"] < _TRIALS) | (rows["sightings"] >= _KNOWN_AGAIN * rows["views"])]
        if len(rows) > room:
            self.forgotten += len(rows) - room // 2
            rows = rows[np.argsort(-rows["last"], kind="stable")[: room // 2]]
        return rows


@kernel("i8(f8[:,:], f8[:,:], f8[::1], f8[::1], i8[::1], f8[:,::1])")
def _project(
    positions: NDArray[np.float64],
    T_camera_world: NDArray[np.float64],
    lens: NDArray[np.float64],
    size: NDArray[np.float64],
    rows: NDArray[np.int64],
    expected: NDArray[np.float64],
) -> int:
    """Write the rows of the positions inside the image, and their projections: u, v in pixels, z in metres.

    lens: fx, fy, cx, cy; size: width and height of the image. Returns how many there are.
    """
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    T = T_camera_world
    count = 0
    for i in range(len(positions)):
        x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
        depth = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if depth <= 0:
            continue
        u = fx * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / depth + cx
        v = fy * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / depth + cy
        if 0 <= u < size[0] and 0 <= v < size[1]:
            rows[count] = i
            expected[count, 0], expected[count, 1], expected[count, 2] = u, v, depth
            count += 1
    return count


class _Notes(NamedTuple):
    """Notes about landmarks.

    first, following: linked lists of those in image cells as wide as the reach, first of each cell, (m,) next of each,
    or -1; owner, difference: (m,) the feature matched to each, -1 = none, and in how many bits they differ.
    """

    first: NDArray[np.int64]
    following: NDArray[np.int64]
    owner: NDArray[np.int64]
    difference: NDArray[np.int64]


@kernel()
def _find_nearest(
    pixels: NDArray[np.float64],
    points: NDArray[np.float64],
    descriptors: NDArray[np.uint64],
    expected: NDArray[np.float64],
    known: NDArray[np.uint64],
    reach: float,
    notes: _Notes,
    nearest: NDArray[np.int64],
) -> None:
    """Write the row (n,) of the expected landmark (m, 3) whose descriptor is nearest to each feature's to `nearest`.

    It is -1 = none before, and the notes are empty; `difference` starts above the maximum.
    """
    first, following, owner, difference = notes
    for j in range(len(expected)):
        column, line = int(expected[j, 0] / reach) + 1, int(expected[j, 1] / reach) + 1
        following[j] = first[line, column]
        first[line, column] = j
    for i in range(len(pixels)):
        column, line = int(pixels[i, 0] / reach) + 1, int(pixels[i, 1] / reach) + 1
        best, second, landmark = 256, 256, np.int64(-1)
        for cell in range(9):
            j = first[line - 1 + cell // 3, column - 1 + cell % 3]
            while j >= 0:
                near = abs(pixels[i, 0] - expected[j, 0]) < reach and abs(pixels[i, 1] - expected[j, 1]) < reach
                if near and abs(points[i, 2] - expected[j, 2]) < _DEPTH_STEP + _DEPTH_SHARE * points[i, 2]:
                    bits = _bits(descriptors[i], known[j])
                    if bits < best:
                        best, second, landmark = bits, best, j
                    elif bits < second:
                        second = bits
                j = following[j]
        if landmark >= 0 and best < difference[landmark] and best < _RATIO * second:
            # Of several features that match one landmark, the nearest descriptor wins.
            if owner[landmark] >= 0:
                nearest[owner[landmark]] = -1
            owner[landmark], difference[landmark], nearest[i] = i, best, landmark


@part()
def _bits(a: NDArray[np.uint64], b: NDArray[np.uint64]) -> int:
    """How many bits of two descriptors differ."""
    count = 0
    for word in range(4):
        x = a[word] ^ b[word]
        x -= (x >> np.uint64(1)) & np.uint64(0x5555555555555555)
        x = (x & np.uint64(0x3333333333333333)) + ((x >> np.uint64(2)) & np.uint64(0x3333333333333333))
        x = (x + (x >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
        count += int((x * np.uint64(0x0101010101010101)) >> np.uint64(56))
    return count
