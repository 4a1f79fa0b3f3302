"""Given poses, corrected by some centimetres against the map of the frames before, within their uncertainty.

Motion capture, a drone's own odometry or poses with a wrong stamp disagree with depth by a centimetre or two, and
surfaces fused from them are that thick. Each frame is registered to a local map, and its pose is the most probable one
between the registration and the given pose (maximum a posteriori, both Gaussian). The given pose is the prior of every
frame, so that the world stays that of the given poses. Where depth does not constrain the pose, as along a bare plane,
the prior alone decides. The noise of the given poses and the drift of the odometry are estimated along the way. Errors
of earlier poses and of the camera that only later frames reveal are corrected afterwards (see `KeyframeAdjuster`).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, invert
from spot3d.frame import RgbdFrame
from spot3d.pose.adjustment import WRONG_ALIKE_S, NewKeyframe
from spot3d.pose.delay import PoseDelay
from spot3d.pose.error_model import ErrorModel
from spot3d.pose.estimate import PoseEstimate
from spot3d.pose.given import GivenPoses
from spot3d.pose.keyframe_adjuster import KeyframeAdjuster
from spot3d.pose.measured_noise import SETTLING_S, MeasuredNoise
from spot3d.pose.motion import moved, rigid, shift_and_turn, twist
from spot3d.pose.registration import DISTANCE, KERNEL, OVERLAP_MIN, judged, refined
from spot3d.pose.settings import PoseSettings
from spot3d.pose.surface import POINTS_MIN, Surface, sample_surface
from spot3d.pose.surfel_map import VOXEL, SurfelMap

# An image's surface counts for the pose as this many points of independent noise: a depth camera's distortion is alike
# over large parts of the image. Registered to a map of the data's own poses, real frames are off by 20 to 90 standard
# deviations of independent noise, about equally in each direction. That is worth 6 to 9 of 5,000 points on 7-Scenes
# redkitchen (VGA and half of it), and 1 to 2.5 on TUM fr3/cabinet, whose poses are wrong themselves. Rendered depth
# without distortion is worth all of its points. The number is that of a surface that differs from the map by the noise
# of single pixels, as in both recordings; one that fits better is worth more. Over some seconds a registration is
# steadier than that, by 20 times and more, but then it drifts. IoU of objects in the world of the true poses with 1, 2,
# 3: redkitchen (three seeds) at 10 mm 0.69, 0.68, 0.68, at 20 mm 0.69, 0.65, 0.62; rendered desks at 10 mm 0.42, 0.44,
# 0.44; built-in clutter at 10 mm 0.59, 0.60, 0.61. Less than 1 is worse.
_INDEPENDENT = 1.0
# Drift of the odometry at which surfaces are worth `_INDEPENDENT`; with less drift they are worth proportionally more,
# up to the second number of times. Drifts, with poses shaken by 10 mm: redkitchen 0.015 to 0.02, TUM fr3/cabinet 0.14,
# rendered clutter 0.006, rendered desks 0.002. How far apart views see the same, mm, with 0, 0.01, 0.03, 0.1, 0.3:
# desk 0 10.2, 5.4, 4.4, 4.9, 5.4; desk 1 8.4, 4.7, 3.6, 4.6, 3.9; clutter 3.6, 1.8, 1.8, 1.7, 1.8; redkitchen 16.1,
# 16.0, 14.1, 13.1, 14.2; TUM 13.5, 13.5, 13.5, 13.5, 14.2.
_BENT, _STEADIEST = 0.03, 100.0
# A direction with less information than this, relative to the best known one, is constrained by noise of the normals
# and not by depth. A bare wall has, after some frames, less than 1e-4; rendered desks have at least 5e-4, redkitchen
# 1e-3, TUM fr3/cabinet 2e-4.
_HELD = 1e-4
# A registration this many standard deviations away from the given pose is a jump, and not noise.
_JUMP = 6.0
# After this many consecutive frames that do not fit the map, the map is of another place.
_PATIENCE = 5
# Every nth point is used for the information of a registration.
_STRIDE = 4
# Smallest range of depth cameras, metres.
_NEAREST_M = 0.4
# The map is replaced when the delay has changed by this: at half a metre a second its poses are 5 mm off, in varying
# directions.
_OUTDATED_S = 0.01


class CorrectedPoses:
    """Passes on the given poses, each moved towards where its depth fits the map."""

    def __init__(self, settings: PoseSettings) -> None:
        self._settings = settings
        self._given = GivenPoses()
        self._sigma = np.repeat((settings.given_sigma, settings.given_turn_sigma), 3)
        self._noise = MeasuredNoise(0.0)
        self._errors = ErrorModel(self._sigma)
        self._adjuster = KeyframeAdjuster.of_given_poses(settings)
        self._delay = PoseDelay(settings.given_delay_sigma)
        self._T_world_map = np.eye(4)
        self._last: tuple[int, NDArray[np.float64]] | None = None
        self._forget()

    def _forget(self) -> None:
        """Forget the map."""
        self._planes = SurfelMap(VOXEL, self._settings.surfel_limit)
        self._correction = np.zeros(6)
        # From the given poses' world to the map, as at its beginning: only corrected poses drift in it later.
        self._T_map_given = invert(self._T_world_map)
        self._errors.interrupt()
        # Of each frame since the last keyframe, (2, 6): twist from its pose in the map to its given pose, and motion
        # for each second of delay.
        self._offsets: list[NDArray[np.float64]] = []
        self._strangers, self._age, self._map_delay_s = 0, 0.0, self._delay.delay_s

    def track(self, frame: RgbdFrame) -> PoseEstimate:
        """The corrected pose; where depth does not fit the map, the given one with its delay and turn compensated.

        "lost" without a valid given pose.
        """
        given = self._given.track(frame)
        if given.status == "lost":
            return given
        known, news = self._adjuster.calibration, self._adjuster.news()
        metres, camera = known.metres(frame.depth_metres()), known.camera(frame.intrinsics)
        followed = self._followed(given, frame.stamp_ns, metres, camera)
        corrections = None if news is None else news.corrections(self._T_world_map)
        return replace(followed, T_world_map=self._T_world_map, calibration=known, corrections=corrections)

    def _followed(
        self, given: PoseEstimate, stamp_ns: int, depth_m: NDArray[np.float32], intrinsics: Intrinsics
    ) -> PoseEstimate:
        last, self._last = self._last, (stamp_ns, given.T_world_camera)
        leaps = last is not None and _leaps(last, stamp_ns, given.T_world_camera, self._settings)
        if leaps:
            self._delay.interrupt()
        surface = sample_surface(depth_m, intrinsics, self._settings)
        pose = self._adjuster.turned(self._delay.compensated(stamp_ns, given.T_world_camera, surface))
        if abs(self._delay.delay_s - self._map_delay_s) >= _OUTDATED_S:
            self._replace_map(surface, pose)
        given = replace(given, T_world_camera=pose, delay_s=self._delay.applied_s)
        # Noise of poses below that of a single pixel at its nearest makes no surface thicker.
        self._noise.negligible = (intrinsics.noise.sigma(_NEAREST_M) / self._settings.given_sigma) ** 2
        if last is None or self._planes.count == 0:
            self._insert(surface, invert(self._T_world_map) @ pose)
            return given
        if leaps:
            return self._begin_anew(surface, given)
        if len(surface.points) < POINTS_MIN:
            return given
        return self._corrected(surface, intrinsics, given, last[0], stamp_ns)

    def _corrected(
        self, surface: Surface, camera: Intrinsics, given: PoseEstimate, last_ns: int, stamp_ns: int
    ) -> PoseEstimate:
        """The most probable pose between the given one and the registration.

        camera: with the calibration applied; last_ns, stamp_ns: timestamps of the last frame and of this one.
        """
        elapsed = 1e-9 * (stamp_ns - last_ns)
        prior = invert(self._T_world_map) @ given.T_world_camera
        # The error of this pose is nearly that of the last one.
        registered = refined(self._planes, surface, moved(prior, self._correction))
        fit = judged(self._planes, surface, registered)
        if not fit.fits:
            self._strangers += 1
            return self._begin_anew(surface, given) if self._strangers >= _PATIENCE else given
        self._strangers = 0
        offset = twist(prior, registered)
        H, _, (tried, _, _) = self._planes.normal_equations(surface, registered, DISTANCE, KERNEL, _STRIDE)
        as_given = self._T_map_given @ given.T_world_camera
        # In units of the stated uncertainty, in which the prior is the same in every direction.
        worth = _worth(surface, fit.residual, tried)
        information = worth / tried * self._sigma[:, None] * H * self._sigma
        if _distance(offset / self._sigma, information) > _JUMP:
            return self._begin_anew(surface, given)
        variance = self._noise.measured(offset / self._sigma, information, elapsed)
        drift = self._errors.learn(1e-9 * stamp_ns, registered, as_given, information / worth)
        steady = float(np.clip(_BENT / drift, 1.0, _STEADIEST)) if drift else 1.0
        self._correction = self._sigma * _most_probable(offset / self._sigma, steady * _held(information), variance)
        pose = rigid(moved(prior, self._correction))
        forgotten = self._insert(surface, pose)
        self._offsets.append(np.array((twist(pose, as_given), self._delay.velocity)))
        if self._adjuster.due(stamp_ns):
            known = self._adjuster.calibration
            offset, velocity = np.mean(self._offsets, axis=0)
            on_average = invert(self._T_map_given) @ moved(pose, offset)
            delay_s = self._delay.delay_s
            self._learn(NewKeyframe(stamp_ns, surface, camera, known, on_average, delay_s, velocity, registered), pose)
            self._offsets = []
        pose = self._settled(pose, given.T_world_camera, elapsed)
        return replace(given, T_world_camera=pose, forgotten=forgotten)

    def _learn(self, seen: NewKeyframe, T_map_camera: NDArray[np.float64]) -> None:
        """Add a keyframe, and move the map with the calibration."""
        self._adjuster.learn(seen, T_map_camera)
        before, now = seen.calibration, self._adjuster.calibration
        grown = now.depth_factor / before.depth_factor
        looks = np.subtract((*now.turn, *now.centre), (*before.turn, *before.centre))
        if grown != 1:
            self._planes.rescale(grown)
            self._errors.rescaled(grown)
            self._delay.rescaled()
        if looks.any():
            self._planes.look_elsewhere(looks)

    def _settled(
        self, T_map_camera: NDArray[np.float64], T_world_given: NDArray[np.float64], elapsed: float
    ) -> NDArray[np.float64]:
        """The pose in the world; the map moves to where the given poses on average have it."""
        # After a pause, too, one pose counts no more than the poses within the correlation time.
        elapsed = min(elapsed, WRONG_ALIKE_S)
        self._age += elapsed
        pose = self._T_world_map @ T_map_camera
        pose = rigid(moved(pose, elapsed / (self._age + SETTLING_S) * twist(pose, T_world_given)))
        self._T_world_map = pose @ invert(T_map_camera)
        return pose

    def _begin_anew(self, surface: Surface, given: PoseEstimate) -> PoseEstimate:
        """Start a new map with this frame, at its given pose."""
        self._forget()
        self._adjuster.begin_anew()
        self._delay.interrupt()
        # Where the last map came to lie is as good a guess as any for the next one.
        self._insert(surface, invert(self._T_world_map) @ given.T_world_camera)
        return replace(given, restarted=True)

    def _replace_map(self, surface: Surface, pose: NDArray[np.float64]) -> None:
        """Replace a map of late poses, each off in another direction, by one that begins with this frame.

        The fused map moves to where this frame's pose (4, 4) has it, if the frame overlaps the old map enough.
        """
        expected = moved(invert(self._T_world_map) @ pose, self._correction)
        registered = refined(self._planes, surface, expected)
        if judged(self._planes, surface, registered).overlap >= OVERLAP_MIN:
            self._T_world_map = pose @ invert(registered)
        self._forget()

    def _insert(self, surface: Surface, pose: NDArray[np.float64]) -> int:
        """Add a frame to the map; returns how many surfels had to make room."""
        before = self._planes.forgotten
        self._planes.insert(surface, pose)
        return self._planes.forgotten - before


def _worth(surface: Surface, residual: float, tried: float) -> float:
    """How many points of independent noise a registered surface is worth, at most those that were tried.

    The residual, metres, measures how well the shapes of surface and map agree (the a posteriori variance of unit
    weight): to the noise of single pixels where depth is distorted, to a quarter of it where it is not.
    """
    expected = float(np.mean(np.square(surface.sigma, dtype=np.float64)))
    return float(min(_INDEPENDENT * expected / max(residual**2, 1e-12), tried))


def _held(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """The information (6, 6) of the directions that depth constrains."""
    known, axes = np.linalg.eigh(information)
    return np.asarray((axes * np.where(known < _HELD * known[-1], 0.0, known)) @ axes.T)


def _most_probable(
    offset: NDArray[np.float64], information: NDArray[np.float64], variance: float
) -> NDArray[np.float64]:
    """The most probable error (6,) of the given pose, by its offset to the registration.

    offset: (6,), information: (6, 6) of the registration, and variance of the given pose, all in units of the stated
    uncertainty.
    """
    return np.asarray(variance * np.linalg.solve(np.eye(6) + variance * information, information @ offset))


def _distance(offset: NDArray[np.float64], information: NDArray[np.float64]) -> float:
    """Error of a given pose as uncertain as stated, in standard deviations: that of its shift or its turn, the larger.

    The registration slides along directions that depth does not constrain, as along a bare plane: these do not count.
    """
    return float(np.linalg.norm(_most_probable(offset, information, 1.0).reshape(2, 3), axis=1).max())


def _leaps(
    last: tuple[int, NDArray[np.float64]], stamp_ns: int, pose: NDArray[np.float64], settings: PoseSettings
) -> bool:
    """Whether the given pose is farther from the last one than the camera's speed and the poses' noise allow, or its
    timestamp does not follow the last one."""
    elapsed = 1e-9 * (stamp_ns - last[0])
    if elapsed <= 0:
        return True
    shift, turn = shift_and_turn(last[1], pose)
    farthest = settings.speed_max * elapsed + _JUMP * settings.given_sigma
    return shift > farthest or turn > settings.turn_max * elapsed + _JUMP * settings.given_turn_sigma
