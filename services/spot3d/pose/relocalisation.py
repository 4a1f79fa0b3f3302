"""Relocalisation of a frame in the map of landmarks, without a prior pose.

Features are matched to landmarks by their descriptors alone. Three matches give a pose (Arun et al. 1987), and the pose
that most matches agree with is chosen (RANSAC, Fischler and Bolles 1981).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.depth_noise import DepthNoise
from spot3d.pose.features import Features

# A descriptor matches a landmark if it differs in no more bits than this, and clearly less than from those elsewhere.
_BITS_MAX, _RATIO, _SAME_CORNER = 50, 0.8, 0.1
_TRIALS = 1000
# A triple with a side shorter than this, metres, tells no direction.
_SIDE_MIN = 0.15
# A feature agrees with a pose within this plus three times its depth's noise, metres.
_NEAR = 0.03
# Fewest features that must agree, and share of the matches: no map of 20,000 landmarks has as many by chance.
_AGREE_MIN, _SHARE_MIN = 15, 0.15


@dataclass(frozen=True, slots=True)
class Place:
    """A relocalised pose: T_world_camera (4, 4), and how many features agree with it."""

    T_world_camera: NDArray[np.float64]
    agreeing: int


def relocalised(features: Features, landmarks: NDArray[np.void]) -> Place | None:
    """The pose of a frame in the landmarks' world; None where too few features agree on one.

    landmarks: rows of the type LANDMARK (see `landmark_map`).
    """
    # A single sighting is chance, unless it is the last frame's: at few frames a second most landmarks are in only two.
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
    """(n,) whether points (n, 3), camera frame, lie at their landmarks' places (n, 3) by a pose."""
    seen = points @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]
    return np.asarray(np.linalg.norm(seen - places, axis=1) < _reach(points, noise))


def _reach(points: NDArray[np.float64], noise: DepthNoise) -> NDArray[np.float64]:
    return _NEAR + 3 * np.asarray(noise.sigma(points[:, 2]))


def _matched(descriptors: NDArray[np.uint64], known: NDArray[np.void]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows of matched features and of their candidate landmarks, both (m,)."""
    if len(descriptors) == 0 or len(known) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    own = np.ascontiguousarray(descriptors).view(np.uint8)
    theirs = np.ascontiguousarray(known["descriptor"]).view(np.uint8)
    pairs = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(own, theirs, k=2)
    rows = np.array([(a.queryIdx, a.trainIdx, a.distance, b.trainIdx, b.distance) for a, b in pairs], np.int64)
    feature, first, bits, second, more_bits = rows.T
    # One corner may be several landmarks: the second best may be at the same place.
    apart = np.linalg.norm(known["position"][first] - known["position"][second], axis=1)
    clear = (bits <= _BITS_MAX) & ((bits < _RATIO * more_bits) | (apart < _SAME_CORNER))
    return feature[clear], first[clear]


def _agreed(
    points: NDArray[np.float64], places: NDArray[np.float64], reach: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The pose (4, 4) from three matches with which most matches agree."""
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
