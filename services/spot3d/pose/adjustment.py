"""Bundle adjustment of keyframes: the error of each pose, and the errors common to all of them.

Views disagree where depth is too long, the camera is turned against its poses, or its principal point is off. They also
disagree where poses are a centimetre off, each in another direction. Against a map of frames with fixed poses, noise of
the poses looks like a wrong camera: the two can be told apart only if all poses are unknowns as well. Planes seen by
several keyframes tie them together. Each given pose constrains its keyframe as far as given poses prove accurate.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.calibration import Calibration, sheared
from spot3d.camera import Intrinsics, invert
from spot3d.pose.common_errors import COMMON, CommonErrors, Equations, marginal, most_probable
from spot3d.pose.motion import moved, rigid, turned, twist
from spot3d.pose.plane_equations import BEND_NODES, POSE, SeenPoints, plane_equations
from spot3d.pose.registration import DISTANCE
from spot3d.pose.surface import Surface
from spot3d.pose.surfel_map import VOXEL, plane_keys
from spot3d_schemas.limits import BEND_SHAPE

# Most keyframes; beyond that the older half is dropped. With 16, keyframes of redkitchen shaken by 10 mm are 14.3 mm
# off, not 13.1; with 8, those of a desk seen from near 8.4, not 1.2. More take longer to adjust.
_KEYFRAMES = 64
# Points used of each keyframe, about; with half of them redkitchen's keyframes are 15.2 mm off.
_POINTS = 800
# Scale of the Geman-McClure weights, in standard deviations of a pixel. With 4.5 in a first of two steps keyframes of
# redkitchen are 14.6 and 22.7 mm off where poses are shaken by 10 and 20 mm, not 13.2 and 20.8.
_KERNEL = 1.5
# An image counts for its pose as this many points of independent noise: a camera's distortion is alike over large parts
# of it. With 2, 7, 20, 70: keyframes of redkitchen shaken by 20 mm are 42, 21, 27, 34 mm off.
_INDEPENDENT = 7.0
# Distortion is alike in all images, too: for the common errors, all keyframes count no more than this many with
# independent distortions would. Correction with 6, 10, 20: of depth 3 % too short, poses shaken by 10 mm, 3.4, 4.0,
# 4.1 % on redkitchen and 2.5, 2.6, 2.6 on a desk seen from near; of true depth 0, 0, 1.0 % on redkitchen and 0, 0, 1.5
# on a cabinet (TUM); of a centre 8 pixels of 640 off, redkitchen with true poses, 47, 89, 96 % of that.
_ALIKE = 10.0
# Number of unknowns shared by all keyframes: `CommonErrors`, the focal length, and depth's scale at each lattice node.
_SHARED = COMMON + 1 + BEND_NODES[0] * BEND_NODES[1]
_TURN, _CENTRE, _FIELD = slice(1, 4), slice(4, 6), slice(7, None)
_WIDTH = 6
# (3, cells): a mean and two slopes over the image.
_DOWN, _ACROSS = (plane - plane.mean() for plane in np.indices(BEND_SHAPE, np.float64))
_FLAT = np.array((np.ones(BEND_SHAPE), _ACROSS, _DOWN)).reshape(3, -1)


EVERY_NS = 600_000_000
"""Time between keyframes. Errors of given poses are correlated over a third of a second: with half of this interval
they count twice (redkitchen as views see it, poses shaken by 10 mm, then lies 16.4 mm apart, not 14.7). With 0.9 and
1.2 s it is hardly more.
"""
WRONG_ALIKE_S = 1 / 3
"""Correlation time of the given poses' errors."""
# Share of the given poses' information that is independent, where they are averaged from one keyframe to the next: the
# variance of such an average over that of independent averages whose long-time mean is as uncertain.
_APART = 1 - (1 - float(np.exp(-1e-9 * EVERY_NS / WRONG_ALIKE_S))) * WRONG_ALIKE_S / (1e-9 * EVERY_NS)


class NewKeyframe(NamedTuple):
    """The surface and the poses of a frame that is to become a keyframe.

    surface, camera: with the calibration applied; given: (4, 4) the camera's pose by the calibration and the average of
    the given poses since the last keyframe; delay_s: the delay assumed for these; velocity: (6,), world axes, the
    camera's motion for each further second of delay; tracked: (4, 4) pose by odometry, in the same world as the last
    keyframe's.
    """

    stamp_ns: int
    surface: Surface
    camera: Intrinsics
    calibration: Calibration
    given: NDArray[np.float64]
    delay_s: float
    velocity: NDArray[np.float64]
    tracked: NDArray[np.float64]


class _Keyframe(NamedTuple):
    """A frame whose pose is adjusted.

    given, tracked: (4, 4) poses, and points, normals: (n, 3) of its surface, with only the delay corrected; delay_s,
    velocity: see `NewKeyframe`; sigma: (n,) metres; cells, shares: (n, 4) the nodes of the lattice of `Bend` around
    each point, and their weights.
    """

    stamp_ns: int
    given: NDArray[np.float64]
    delay_s: float
    velocity: NDArray[np.float64]
    tracked: NDArray[np.float64]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    sigma: NDArray[np.float64]
    cells: NDArray[np.int64]
    shares: NDArray[np.float64]


class Adjustment:
    """Poses of the last keyframes, and the errors common to all of them; common: the keyframes' likelihood of these.

    sigmas: (7,) prior standard deviation of each of `CommonErrors` and of the logarithm of the focal length;
    bend_sigma: the same of depth's scale at each lattice node; 0: the nominal value is kept. held: stated standard
    deviations of the given poses, metres and radians; shares: variances that these may have, relative to the stated.
    """

    def __init__(
        self, sigmas: NDArray[np.float64], bend_sigma: float, held: tuple[float, float], shares: NDArray[np.float64]
    ) -> None:
        self._sigmas = np.concatenate((sigmas, np.full(BEND_NODES[0] * BEND_NODES[1], bend_sigma)))
        self._free = np.flatnonzero(self._sigmas)
        self._stated, self._shares = np.repeat(np.square(held), 3), shares
        # Variance of the given poses, relative to the stated one.
        self._share = 1.0
        self._shared, self._expected = np.zeros((2, _SHARED))
        # Latest estimate of the given poses' delay.
        self._delay_s = 0.0
        # Of the shared unknowns: information of the prior; and of the forgotten keyframes: information, information
        # times mean, and how many keyframes it stands for.
        self._told = np.diag(self._sigmas[self._free] ** -2.0)
        self._prior, self._earlier = (np.zeros_like(self._told), np.zeros(len(self._free))), 0
        self._keyframes: list[_Keyframe] = []
        self._poses: list[NDArray[np.float64]] = []
        # Of all unknowns, poses first.
        self._covariance = np.linalg.inv(self._told)
        free = self._free[self._free < COMMON]
        untold = np.zeros(1), np.zeros((1, len(free))), np.zeros((1, len(free), len(free)))
        self.common = CommonErrors(free, self._sigmas[free], *untold)

    @property
    def stamps_ns(self) -> list[int]:
        """Timestamps of the adjusted keyframes, oldest first."""
        return [keyframe.stamp_ns for keyframe in self._keyframes]

    def begin_anew(self) -> None:
        """Forget the keyframes, but not the shared unknowns: the next poses are unrelated, or of another place."""
        self._forget(len(self._keyframes))

    def expect(self, bend: NDArray[np.float64]) -> None:
        """Start from a known bend of depth, (rows, columns)."""
        self._shared[_FIELD] = self._expected[_FIELD] = bend.ravel()

    def add(self, seen: NewKeyframe) -> None:
        """Add a keyframe, and adjust all."""
        if len(self._keyframes) == _KEYFRAMES:
            self._forget(_KEYFRAMES // 2)
        keyframe = _keyframe(seen)
        self._delay_s = seen.delay_s
        pose = self._by_given(keyframe)
        if self._keyframes:
            # Odometry's motion since the last keyframe.
            pose = rigid(self._poses[-1] @ invert(self._keyframes[-1].tracked) @ seen.tracked)
        self._keyframes.append(keyframe)
        self._poses.append(pose)
        if len(self._keyframes) > 1:
            # One step is enough: the other keyframes start where the last adjustment ended.
            self._adjust()

    def by(self, applied: NDArray[np.float64]) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
        """The keyframes' poses (4, 4) if the common errors are those `applied` (6,) instead of the estimated ones; and
        the bend of depth then, (rows, columns), as in `Bend`.

        The bend has no mean, which is the scale, and no slope, which looks like a principal point that is off.
        """
        size, common = POSE * len(self._poses), np.flatnonzero(self._free < COMMON)
        if len(self._poses) < 2 or not len(self._free):
            return list(self._poses), np.zeros(BEND_SHAPE)
        known = np.zeros((len(common), len(self._free)))
        known[np.arange(len(common)), common] = 1.0
        target = applied[self._free[common]]
        if self._sigmas[_FIELD].any():
            known = np.vstack((known, np.pad(_FLAT, ((0, 0), (len(self._free) - _FLAT.shape[1], 0)))))
            target = np.append(target, np.zeros(len(_FLAT)))
        towards = self._covariance[:, size:] @ known.T
        step = towards @ np.linalg.solve(known @ towards[size:], target - known @ self._shared[self._free])
        shared = self._shared.copy()
        shared[self._free] += step[size:]
        return _stepped(self._poses, step[:size]), shared[_FIELD].reshape(BEND_SHAPE)

    def _forget(self, count: int) -> None:
        """Forget the oldest keyframes, and keep their information on the shared unknowns."""
        if len(self._keyframes) > 1:
            of_poses, seen = len(self._covariance) - len(self._free), self._earlier + len(self._keyframes)
            known = np.linalg.inv(self._covariance[of_poses:, of_poses:])
            pull = known @ self._shared[self._free] - self._told @ self._expected[self._free]
            self._earlier = min(self._earlier + count, _KEYFRAMES)
            # Only the independent share of this information was counted; undone, as it will be reduced again.
            before, pull_before = self._prior
            known, pull = before + (known - self._told - before) / _APART, pull_before + (pull - pull_before) / _APART
            self._prior = self._earlier / seen * known, self._earlier / seen * pull
        self._keyframes, self._poses = self._keyframes[count:], self._poses[count:]

    def _by_given(self, keyframe: _Keyframe) -> NDArray[np.float64]:
        """The camera's pose (4, 4) by its given pose, with the current delay and turn."""
        given = moved(keyframe.given, (self._delay_s - keyframe.delay_s) * keyframe.velocity)
        return turned(given, self._shared[_TURN])

    def _offsets(self) -> NDArray[np.float64]:
        """Twists (k, 6) from the adjusted poses to those by the given ones."""
        pairs = zip(self._poses, self._keyframes, strict=True)
        return np.array([twist(pose, self._by_given(keyframe)) for pose, keyframe in pairs])

    def _adjust(self) -> None:
        """One Gauss-Newton step of all unknowns, with the most probable variance of the given poses."""
        size = POSE * len(self._poses)
        H, g = np.zeros((size + _SHARED, size + _SHARED)), np.zeros(size + _SHARED)
        # The turn moves no observed point, only the camera's pose by the given one.
        seen = np.r_[0 : size + 1, size + _CENTRE.start : size + _SHARED]
        H[np.ix_(seen, seen)], g[seen] = self._by_planes()
        known, pull = self._prior
        free = size + self._free
        H[np.ix_(free, free)] += known
        g[free] += pull - known @ self._shared[self._free]
        self.common = self._seen_in_common(H, g)
        self._share = self._shares[most_probable(self.common)]
        H[np.ix_(free, free)] += self._told
        g[free] += self._told @ (self._expected - self._shared)[self._free]
        self._add_given(H, g)
        unknown = np.append(np.arange(size), free)
        covariance = np.linalg.inv(H[np.ix_(unknown, unknown)])
        step = covariance @ g[unknown]
        self._poses = _stepped(self._poses, step[:size])
        self._shared[self._free] += step[size:]
        self._covariance = covariance

    def _seen_in_common(self, H: NDArray[np.float64], g: NDArray[np.float64]) -> CommonErrors:
        """Marginal likelihood of the common errors.

        H, g: of the poses and the shared unknowns, without the given poses and the prior.
        """
        size, count = POSE * len(self._poses), len(self._free)
        sigmas, kept = self._sigmas[self._free], int(np.count_nonzero(self._free < COMMON))
        at, columns = self._shared[self._free], size + self._free
        held, across, shared = H[:size, :size], H[:size, columns], H[np.ix_(columns, columns)]
        # Linearised at the given poses: a pose is the given one, with the common turn and an error of its own.
        offset, turning = self._offsets().ravel(), np.zeros((size, count))
        for number in np.flatnonzero((self._free >= _TURN.start) & (self._free < _TURN.stop)):
            axis = self._free[number] - _TURN.start
            turning.reshape(-1, POSE, count)[:, 3:, number] = [pose[:3, axis] for pose in self._poses]
        pull, drawn = g[:size] - held @ offset, g[columns] - across.T @ offset
        drawn += turning.T @ pull
        shared = shared + turning.T @ across + across.T @ turning + turning.T @ held @ turning
        across = across + held @ turning
        # From here on the shared unknowns are absolute, not steps from the current estimate.
        pull, drawn = pull + across @ at, drawn + shared @ at
        shared[range(kept, count), range(kept, count)] += sigmas[kept:] ** -2.0
        stated = np.sqrt(np.tile(self._stated, len(self._poses)))
        seen = Equations(stated[:, None] * held * stated, stated[:, None] * across, stated * pull, shared, drawn)
        share = min(_APART, _ALIKE / (self._earlier + len(self._poses)))
        return CommonErrors(self._free[:kept], sigmas[:kept], *marginal(seen, kept, self._shares), _APART, share)

    def _add_given(self, H: NDArray[np.float64], g: NDArray[np.float64]) -> None:
        """Add the given poses' equations for the poses and the turn."""
        size = POSE * len(self._poses)
        held = _APART / (self._share * self._stated)
        turn, sure = slice(size + _TURN.start, size + _TURN.stop), held[3:]
        for k, (offset, pose) in enumerate(zip(self._offsets(), self._poses, strict=True)):
            own, own_turn = slice(POSE * k, POSE * k + POSE), slice(POSE * k + 3, POSE * k + POSE)
            H[own, own] += np.diag(held)
            g[own] += held * offset
            H[turn, turn] += np.diag(sure)
            across = -sure[:, None] * pose[:3, :3]
            H[own_turn, turn] += across
            H[turn, own_turn] += across.T
            g[turn] += across.T @ offset[3:]

    def _by_planes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """H and g of all unknowns but the turn, by the planes that two or more keyframes see."""
        seen = _seen_points(self._keyframes, self._poses, self._shared)
        H, g, variance = plane_equations(seen, DISTANCE, _KERNEL)
        per_image = len(seen.places) / len(self._poses)
        worth = min(1.0, _INDEPENDENT / per_image / max(variance, 1e-6))
        return worth * H, worth * g


def _keyframe(seen: NewKeyframe) -> _Keyframe:
    """The keyframe of a frame: points subsampled, the calibration undone."""
    chosen = slice(None, None, max(1, len(seen.surface.points) // _POINTS))
    surface, camera, known = seen.surface, seen.camera, seen.calibration
    points, normals, sigma = (array[chosen].astype(np.float64) for array in surface)
    # A point's pixel is the same with and without the calibration.
    x, y, z = points.T
    columns, rows = BEND_NODES
    u = np.clip((camera.fx * x / z + camera.cx) / camera.width * (columns - 1), 0, columns - 1 - 1e-6)
    v = np.clip((camera.fy * y / z + camera.cy) / camera.height * (rows - 1), 0, rows - 1 - 1e-6)
    i, j = u.astype(np.int64), v.astype(np.int64)
    u, v = u - i, v - j
    cells = (j * columns + i)[:, None] + np.array((0, 1, columns, columns + 1))
    shares = np.stack(((1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v), axis=1)
    linear = known.depth_factor * sheared(known.centre)
    points, normals = points @ np.linalg.inv(linear).T, normals @ linear
    if known.bend:
        points /= np.exp((np.array(known.bend).ravel()[cells] * shares).sum(axis=1))[:, None]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    given = turned(seen.given, -np.array(known.turn))
    return _Keyframe(
        seen.stamp_ns, given, seen.delay_s, seen.velocity, seen.tracked, points, normals, sigma, cells, shares
    )


def _seen_points(
    keyframes: Sequence[_Keyframe], poses: Sequence[NDArray[np.float64]], shared: NDArray[np.float64]
) -> SeenPoints:
    """World points of all keyframes by their poses and the shared unknowns (31,), sorted by plane."""
    width = np.exp(shared[_WIDTH])
    x, y = shared[_CENTRE]
    linear = np.exp(shared[0]) * sheared((x, y)) @ np.diag((width, width, 1.0))
    upright = np.linalg.inv(linear)
    arms, places, normals = [], [], []
    for keyframe, pose in zip(keyframes, poses, strict=True):
        bent = np.exp((shared[_FIELD][keyframe.cells] * keyframe.shares).sum(axis=1))
        arm = bent[:, None] * (keyframe.points @ (pose[:3, :3] @ linear).T)
        normal = keyframe.normals @ upright @ pose[:3, :3].T
        arms.append(arm)
        places.append(arm + pose[:3, 3])
        normals.append(normal / np.linalg.norm(normal, axis=1, keepdims=True))
    planes = np.hstack((np.concatenate(places), np.concatenate(normals)))
    keys = np.empty(len(planes), np.int64)
    plane_keys(planes, VOXEL, keys)
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    return SeenPoints(
        places=np.ascontiguousarray(planes[order, :3]),
        arms=np.concatenate(arms)[order],
        normals=np.ascontiguousarray(planes[order, 3:]),
        sigma=np.concatenate([keyframe.sigma for keyframe in keyframes])[order],
        frame=np.repeat(np.arange(len(keyframes)), [len(keyframe.points) for keyframe in keyframes])[order],
        cells=np.concatenate([keyframe.cells for keyframe in keyframes])[order],
        shares=np.concatenate([keyframe.shares for keyframe in keyframes])[order],
        first=np.append(np.flatnonzero(np.append(True, keys[1:] != keys[:-1])), len(keys)),
        axes=np.array([pose[:3, :3] for pose in poses]),
    )


def _stepped(poses: list[NDArray[np.float64]], step: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Poses after a step (6 k,) of twists."""
    return [rigid(moved(pose, one)) for pose, one in zip(poses, step.reshape(-1, POSE), strict=True)]
