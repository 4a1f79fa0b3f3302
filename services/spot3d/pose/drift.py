"""Correction of the odometry's drift by visual landmarks.

Registration by depth alone slides along flat surfaces, and a depth camera's own distortion moves with it, which makes
sideways motion seem too short. Image features do not slide. Colour images are taken up to a frame apart from the depth
images, so that depth places each single frame better: the landmarks' correction is smoothed over time.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.kernel import kernel
from spot3d.pose.features import Features
from spot3d.pose.landmark_map import LandmarkMap, Matches
from spot3d.pose.motion import moved, rigid, twist
from spot3d.pose.relocalisation import meeting
from spot3d.pose.settings import PoseSettings

# The correction follows the landmarks within about this time, two frames: colour and depth may be one apart.
_SETTLING_S = 1 / 15
# With fewer landmarks than this a pose is chance.
_MATCHES_MIN = 12
# The depth registration's information counts by this share against the landmarks': its points' errors are not
# independent, but alike over large parts of the image.
_DEPTH_SHARE = 0.01
# A feature is found to about a pixel, and the map's depth is good to this beyond the noise, metres.
_PIXEL, _MAP_NOISE = 1.0, 0.002
# Drift that moves the image by less than this, pixels, is in doubt: good depth is more accurate.
_DOUBT = 0.7
# Corrections beyond this (metres, radians) are no drift: the landmarks are mistaken.
_DRIFT_MAX = 0.1
_STEPS, _STEP_MIN = 8, 1e-4
# The ridge (1/m2, 1/rad2) only keeps an unconstrained direction where it is.
_RIDGE = 1e3
# Scale of the robust kernel, in standard deviations, and the weight above which a match fits the pose.
_KERNEL, _FITS = 2.0, 0.3


class DriftCorrection:
    """Moves registered poses to where the landmarks say, smoothly."""

    def __init__(self, settings: PoseSettings) -> None:
        self.map = LandmarkMap(settings.landmark_limit)
        self._correction = np.zeros(6)

    def correct(
        self,
        features: Features,
        camera: Intrinsics,
        T_world_registered: NDArray[np.float64],
        information: NDArray[np.float64],
        elapsed: float,
        matches: Matches | None = None,
    ) -> NDArray[np.float64]:
        """The corrected pose (4, 4) of a registered frame, which enters the map of landmarks.

        information: (6, 6) of the registration, 1/m2 and 1/rad2, for a shift and a turn about the camera in its own
        axes; elapsed: seconds since the last frame that was compared; matches: by this pose, if they are known.
        """
        if matches is None:
            matches = self.map.match(features, camera, T_world_registered)
        agreement, matched = self._agreement(features, camera, matches)
        turn = np.kron(np.eye(2), T_world_registered[:3, :3])
        drift = agreement.drift(T_world_registered, _DEPTH_SHARE * turn @ information @ turn.T)
        if drift is not None:
            self._correction += (1 - np.exp(-elapsed / _SETTLING_S)) * (drift - self._correction)
        pose = self.held(T_world_registered)
        trusted = np.zeros(len(features), np.bool_)
        trusted[matched] = agreement.weights(pose) > _FITS
        self.map.insert(features, matches, trusted, pose)
        return pose

    def completed(
        self,
        features: Features,
        camera: Intrinsics,
        T_world_place: NDArray[np.float64],
        T_world_registered: NDArray[np.float64],
        information: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """The pose (4, 4) of the registration in directions that depth constrains, and of the landmarks in the others.

        It has no drift of odometry: the correction is forgotten. T_world_place: (4, 4) by which landmarks are matched;
        information: see `correct`.
        """
        self.restart()
        agreement, _ = self._agreement(features, camera, self.map.match(features, camera, T_world_place))
        turn = np.kron(np.eye(2), T_world_registered[:3, :3])
        expected = twist(T_world_place, T_world_registered)
        motion = agreement.twist(T_world_place, _DEPTH_SHARE * turn @ information @ turn.T, expected)
        return rigid(moved(T_world_place, motion))

    def _agreement(
        self, features: Features, camera: Intrinsics, matches: Matches
    ) -> tuple["Agreement", NDArray[np.int64]]:
        """Agreement of the matched features with their landmarks, and the rows of these features, (m,)."""
        matched = np.flatnonzero(matches.landmark >= 0)
        points, landmarks = features.points[matched], self.map.rows["position"][matches.landmark[matched]]
        pixel, depth = _PIXEL * 2 / (camera.fx + camera.fy), points[:, 2]
        lateral, axial = pixel * features.blur[matched] * depth, features.noise.sigma(depth) + _MAP_NOISE
        return Agreement(points, landmarks, lateral, axial, pixel), matched

    def seen_again(
        self,
        features: Features,
        camera: Intrinsics,
        T_world_camera: NDArray[np.float64],
        matches: Matches | None = None,
    ) -> NDArray[np.bool_]:
        """Which features (n,) lie at their landmark by a pose (4, 4); matches: by this pose, if they are known."""
        if matches is None:
            matches = self.map.match(features, camera, T_world_camera)
        seen = matches.landmark >= 0
        places = self.map.rows["position"][matches.landmark[seen]]
        seen[seen] = meeting(T_world_camera, features.points[seen], places, features.noise)
        return seen

    def held(self, T_world_registered: NDArray[np.float64]) -> NDArray[np.float64]:
        """The pose (4, 4) of a registered frame with the latest correction, for a frame that is not compared."""
        return rigid(moved(T_world_registered, self._correction))

    def restart(self) -> None:
        """Forget the correction, not the landmarks: a relocalised pose has no drift against the map."""
        self._correction = np.zeros(6)


class Agreement(NamedTuple):
    """How matched features agree with their landmarks.

    points: (n, 3) float64 metres, camera frame; landmarks: (n, 3) metres, world; lateral, axial: (n,) standard
    deviations across a ray and along it, metres; pixel: radians that a pixel is wide.
    """

    points: NDArray[np.float64]
    landmarks: NDArray[np.float64]
    lateral: NDArray[np.float64]
    axial: NDArray[np.float64]
    pixel: float

    def drift(self, T_world_camera: NDArray[np.float64], prior: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """The motion (6,) that corrects a pose, less where it is in doubt; None where too few landmarks agree."""
        if len(self.points) < _MATCHES_MIN:
            return None
        twist = self.twist(T_world_camera, prior)
        fits = np.count_nonzero(self.weights(moved(T_world_camera, twist)) > _FITS)
        if fits < _MATCHES_MIN or np.abs(twist).max() > _DRIFT_MAX:
            return None
        square = self.displacement(T_world_camera, twist) ** 2
        return np.asarray(square / (square + _DOUBT**2) * twist)

    def twist(
        self,
        T_world_camera: NDArray[np.float64],
        prior: NDArray[np.float64],
        expected: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """The motion (6,) from a pose to the one that fits the landmarks best.

        prior: (6, 6) information of the expected motion (6,), which is zero unless given.
        """
        twist = np.zeros(6)
        off = np.zeros(6) if expected is None else -expected
        for _ in range(_STEPS):
            H, g, _ = self._equations(moved(T_world_camera, twist))
            step = np.linalg.solve(H + prior + _RIDGE * np.eye(6), g - prior @ off)
            twist += step
            off += step
            if np.abs(step).max() < _STEP_MIN:
                break
        return twist

    def displacement(self, T_world_camera: NDArray[np.float64], twist: NDArray[np.float64]) -> float:
        """Root mean square motion of the points in the image by a twist, pixels, to first order."""
        lever = self.points @ T_world_camera[:3, :3].T
        motion = np.linalg.norm(twist[:3] + np.cross(twist[3:], lever), axis=1)
        return float(np.sqrt(np.mean((motion / (self.pixel * self.points[:, 2])) ** 2)))

    def weights(self, T_world_camera: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) robust weight of each match at a pose, 0..1."""
        return self._equations(T_world_camera)[2]

    def _equations(
        self, T_world_camera: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """H (6, 6) and g (6,) at a pose, and the weight (n,) of each point."""
        sums = np.zeros((6, 6)), np.zeros(6), np.zeros(len(self.points))
        _normal_equations(np.ascontiguousarray(T_world_camera), self, np.empty((3, 3)), np.eye(6), *sums)
        return sums


@kernel()
def _normal_equations(
    T: NDArray[np.float64],
    matched: Agreement,
    vectors: NDArray[np.float64],
    rows: NDArray[np.float64],
    H: NDArray[np.float64],
    g: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> None:
    """Sum H and g of H x = g for the twist x that brings points to their landmarks; Geman-McClure weights.

    The error of a point is `axial` along its ray and `lateral` across it. vectors, rows: scratch arrays of one point,
    (3, 3) and (6, 6): its J, whose left half is the identity, above its MJ.
    """
    points, landmarks, lateral, axial, _ = matched
    ray, r, lever = vectors
    J, MJ = rows[:3], rows[3:]
    for i in range(len(points)):
        length = 0.0
        for a in range(3):
            lever[a] = T[a, 0] * points[i, 0] + T[a, 1] * points[i, 1] + T[a, 2] * points[i, 2]
            r[a] = lever[a] + T[a, 3] - landmarks[i, a]
            length += lever[a] * lever[a]
        along = 0.0
        for a in range(3):
            ray[a] = lever[a] / np.sqrt(length)
            along += r[a] * ray[a]
        across = r[0] * r[0] + r[1] * r[1] + r[2] * r[2] - along * along
        wide, deep = 1 / lateral[i] ** 2, 1 / axial[i] ** 2
        # Two directions lie across the ray: each has half the square.
        robust = 1 / (1 + (across * wide / 2 + along * along * deep) / _KERNEL**2)
        weights[i] = robust * robust
        J[0, 4], J[0, 5] = lever[2], -lever[1]
        J[1, 3], J[1, 5] = -lever[2], lever[0]
        J[2, 3], J[2, 4] = lever[1], -lever[0]
        for b in range(6):
            on_ray = (deep - wide) * (ray[0] * J[0, b] + ray[1] * J[1, b] + ray[2] * J[2, b])
            for a in range(3):
                MJ[a, b] = weights[i] * (wide * J[a, b] + on_ray * ray[a])
        for b in range(6):
            for a in range(3):
                g[b] -= MJ[a, b] * r[a]
            for c in range(6):
                H[b, c] += J[0, c] * MJ[0, b] + J[1, c] * MJ[1, b] + J[2, c] * MJ[2, b]
