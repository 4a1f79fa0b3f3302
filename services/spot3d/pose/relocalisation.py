"""Where a frame is in the map of landmarks, without any idea of where to look.

Descriptors alone say which landmark each feature may be; three of them place the camera (Arun et al. 1987), and the
place that most features agree with is the one (RANSAC, Fischler and Bolles 1981).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.depth_noise import DepthNoise
from spot3d.pose.features import Features

# A descriptor is a landmark's if it differs in no more bits than this, and clearly less than from those elsewhere.
_BITS_MAX, _RATIO, _SAME_CORNER = 50, 0.8, 0.1
_TRIALS = 1000
# A triple whose sides are shorter than this, metres, tells no direction.
_SIDE_MIN = 0.15
# A feature agrees with a place within this and three times its depth's noise, metres.
_NEAR = 0.03
# So many features agree by chance in no map of 20,000 landmarks.
_AGREE_MIN, _SHARE_MIN = 15, 0.15


@dataclass(frozen=True, slots=True)
class Place:
    """Where a frame is: T_world_camera (4, 4), and how many of its features agree."""

    T_world_camera: NDArray[np.float64]
    agreeing: int


def relocalised(features: Features, landmarks: NDArray[np.void]) -> Place | None:
    """The place of a frame in the landmarks' world; None where too few agree on one.

    landmarks: rows of the type LANDMARK (see `landmark_map`).
    """
    # Once is chance, or the frame before: of few frames a second most landmarks are in two.
    last = landmarks["last"] == landmarks["last"].max(initial=0)
    known = landmarks[(landmarks["sightings"] > 1) | last]
    feature, landmark = _matched(features.descriptors, known)
    if len(feature) < _AGREE_MIN:
        return None
    points, places = features.points[feature], known["position"][landmark]
    T = _agreed(points, places, _reach(points, features.noise))
    for _ in range(3):
        near = meeting(T, points, places, features.noise)
        if np.count_nonzero(near) < max(_AGREE_MIN, _SHARE_MIN * len(points)):
            return None
        T = _aligned(points[None, near], places[None, near])[0]
    return Place(T, int(np.count_nonzero(meeting(T, points, places, features.noise))))


def meeting(
    T_world_camera: NDArray[np.float64], points: NDArray[np.float64], places: NDArray[np.float64], noise: DepthNoise
) -> NDArray[np.bool_]:
    """(n,) whether points (n, 3) of the camera frame lie by a pose where their landmarks are, places (n, 3)."""
    return np.asarray(_off(T_world_camera, points, places) < _reach(points, noise))


def _reach(points: NDArray[np.float64], noise: DepthNoise) -> NDArray[np.float64]:
    return _NEAR + 3 * np.asarray(noise.sigma(points[:, 2]))


def _matched(descriptors: NDArray[np.uint64], known: NDArray[np.void]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Features and the landmarks that they may be, both (m,): rows of the two."""
    if len(descriptors) == 0 or len(known) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    own = np.ascontiguousarray(descriptors).view(np.uint8)
    theirs = np.ascontiguousarray(known["descriptor"]).view(np.uint8)
    pairs = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(own, theirs, k=2)
    rows = np.array([(a.queryIdx, a.trainIdx, a.distance, b.trainIdx, b.distance) for a, b in pairs], np.int64)
    feature, first, bits, second, more_bits = rows.T
    # One corner may be several landmarks: the second best may be the same place.
    apart = np.linalg.norm(known["position"][first] - known["position"][second], axis=1)
    clear = (bits <= _BITS_MAX) & ((bits < _RATIO * more_bits) | (apart < _SAME_CORNER))
    return feature[clear], first[clear]


def _agreed(
    points: NDArray[np.float64], places: NDArray[np.float64], reach: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The pose by three matches (4, 4) that most of the matches agree with."""
    triples = np.random.default_rng(len(points)).integers(0, len(points), (_TRIALS, 3))
    sides = [np.linalg.norm(np.diff(kind[triples[:, [0, 1, 2, 0]]], axis=1), axis=2) for kind in (points, places)]
    rigid = (np.abs(sides[0] - sides[1]) < 2 * reach[triples].max(axis=1, keepdims=True)).all(axis=1)
    triples = triples[rigid & (sides[0].min(axis=1) > _SIDE_MIN)]
    if len(triples) == 0:
        return np.eye(4)
    poses = _aligned(points[triples], places[triples])
    off = np.linalg.norm(np.einsum("kij,nj->kni", poses[:, :3, :3], points) + poses[:, None, :3, 3] - places, axis=2)
    return np.asarray(poses[int(np.count_nonzero(off < reach, axis=1).argmax())])


def _aligned(points: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (k, 4, 4) that bring each of k sets of points (k, n, 3) nearest to their places (k, n, 3)."""
    middle, centre = points.mean(axis=1), places.mean(axis=1)
    u, _, vt = np.linalg.svd(np.einsum("kni,knj->kij", places - centre[:, None], points - middle[:, None]))
    mirror = np.ones((len(points), 1, 3))
    mirror[:, 0, 2] = np.sign(np.linalg.det(u @ vt))
    poses = np.zeros((len(points), 4, 4))
    poses[:, :3, :3] = (u * mirror) @ vt
    poses[:, :3, 3] = centre - np.einsum("kij,kj->ki", poses[:, :3, :3], middle)
    poses[:, 3, 3] = 1
    return poses


def _off(T: NDArray[np.float64], points: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.norm(points @ T[:3, :3].T + T[:3, 3] - places, axis=1))
