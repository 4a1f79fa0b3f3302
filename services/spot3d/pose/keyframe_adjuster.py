"""Corrections that only later frames reveal: the camera's calibration, and the errors of the keyframes' poses."""

from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from spot3d.calibration import Bend, Calibration
from spot3d.camera import invert
from spot3d.pose import depth_scale, orientation
from spot3d.pose.adjustment import EVERY_NS, Adjustment, NewKeyframe
from spot3d.pose.motion import turned, twist
from spot3d.pose.settings import PoseSettings
from spot3d.pose_corrections import PoseCorrections
from spot3d.trajectory import rotation_angle
from spot3d_schemas.limits import MAX_BEND

# Corrections are published once there are a tenth more keyframes, or the calibration has changed, as they cost fusion
# time. Published with each keyframe, an update of redkitchen's objects takes 300 ms after half a minute, not 220 (170
# without any); IoU is the same within 2 %.
_TOLD_EVERY = 10


# Standard deviation of a camera's focal length (its logarithm). Without it, and without the bend, redkitchen's is 4 %
# off, give or take 0.03.
_WIDTH_SIGMA = 0.01
# Variances of given poses that are tried, relative to the stated one.
_SHARES = np.geomspace(1e-4, 1.0, 33)
# Standard deviations of odometry's poses for its keyframes, metres and radians. With 3, 10, 30, 100 mm: keyframes of a
# near desk bent by 0.3 % 6.2, 4.7, 4.6, 6.1 mm off (7.7 before), redkitchen's 27.9, 26.9, 27.5, 28.5 (27.5).
_ODOMETRY = (0.01, 0.005)
# Keyframes needed to apply a bend of depth. The noise of given poses is known after three seconds: before, late poses
# look like a bend of 0.4 % where there is none. Odometry's poses agree with each other.
_ENOUGH_OF_GIVEN, _ENOUGH_OF_ODOMETRY = 6, 2
# Least change of the bend: a metre away it is a pixel's noise. With half of it redkitchen and near desks are the same,
# and fusion processes 1.5 times as many of redkitchen's keyframes again.
_BEND_STEP = 0.002
# Of keyframes within this distance, metres and radians, at most the last number count, as with views of objects. A
# camera that stands still repeats its view: unevenness of planes is then taken for a bend, of 2 to 4 % within minutes.
_SAME_PLACE, _SAME_TURN, _SAME_VIEWS = 0.05, np.radians(3), 5


class Adjusted(NamedTuple):
    """Keyframes by timestamp, oldest first: poses (4, 4) in the map as published, and in the world as adjusted now.

    Both are without the turn of the camera that was applied at the time.
    """

    stamps_ns: list[int]
    T_map_before: list[NDArray[np.float64]]
    T_world_now: list[NDArray[np.float64]]

    def corrections(self, T_world_map: NDArray[np.float64]) -> PoseCorrections:
        """Corrections of the poses, with the map at its latest place in the world, (4, 4)."""
        pairs = zip(self.T_map_before, self.T_world_now, strict=True)
        twists = np.array([twist(T_world_map @ before, now) for before, now in pairs])
        return PoseCorrections(np.array(self.stamps_ns, np.int64), twists)

    def where_the_last_is(self) -> PoseCorrections:
        """Corrections of the poses in the map, with the adjusted world moved so that the last pose needs none."""
        T_map_world = self.T_map_before[-1] @ invert(self.T_world_now[-1])
        now = [T_map_world @ pose for pose in self.T_world_now]
        return self._replace(T_world_now=now).corrections(np.eye(4))


class KeyframeAdjuster:
    """Bundle adjustment of keyframes, and the camera's calibration from it.

    The adjustment runs in a thread of its own, beside the next frames. Only the next keyframe waits for it and takes
    over its result, so that results do not depend on the frame rate. calibration: the one applied now; enough: number
    of keyframes from which on the bend of depth is applied.
    """

    def __init__(self, adjustment: Adjustment, enough: int) -> None:
        self._adjustment, self._enough = adjustment, enough
        self._thread = ThreadPoolExecutor(1, "adjustment")
        self._running: Future[None] | None = None
        # Factor of depth; turn and centre; and bend of depth.
        self._factor, self._looks = 1.0, np.zeros(5)
        self._bend: Bend = ()
        self._due_ns = 0
        # Poses of the keyframes as published, without the turn.
        self._T_map_before: dict[int, NDArray[np.float64]] = {}
        self._news: Adjusted | None = None
        self._untold = 0

    @classmethod
    def of_given_poses(cls, settings: PoseSettings) -> Self:
        """For given poses: estimates their noise, and scale, turn, centre, focal length and bend of the camera."""
        turn, centre = settings.mount_turn_sigma, settings.centre_sigma
        sigmas = np.array((settings.depth_scale_sigma, turn, turn, turn, centre, centre, _WIDTH_SIGMA))
        held = settings.given_sigma, settings.given_turn_sigma
        return cls(Adjustment(sigmas, settings.depth_bend_sigma, held, _SHARES), _ENOUGH_OF_GIVEN)

    @classmethod
    def of_odometry(cls, settings: PoseSettings) -> Self:
        """For odometry: estimates the bend alone, the one error of the camera that its poses do not agree with."""
        return cls(Adjustment(np.zeros(7), settings.depth_bend_sigma, _ODOMETRY, np.ones(1)), _ENOUGH_OF_ODOMETRY)

    @property
    def calibration(self) -> Calibration:
        x, y, z, *centre = self._looks.tolist()
        return Calibration(self._factor, (x, y, z), (centre[0], centre[1]), self._bend)

    def turned(self, T_world_given: NDArray[np.float64]) -> NDArray[np.float64]:
        """The camera's pose (4, 4) by a given one, turned by the calibration."""
        return turned(T_world_given, self._looks[:3]) if self._looks[:3].any() else T_world_given

    def due(self, stamp_ns: int) -> bool:
        """Whether a frame is to be a keyframe."""
        return stamp_ns >= self._due_ns

    def learn(self, seen: NewKeyframe, T_map_camera: NDArray[np.float64]) -> None:
        """Take over the results of the keyframes before, and add a keyframe, unless enough others have the same view.

        T_map_camera: (4, 4), its corrected pose in the map. May change `calibration`.
        """
        before = self._looks[:3]
        self._take_over()
        self._due_ns = seen.stamp_ns + EVERY_NS
        place = turned(T_map_camera, -before)
        if sum(_same_view(place, other) for other in self._T_map_before.values()) < _SAME_VIEWS:
            self._T_map_before[seen.stamp_ns] = place
            self._running = self._thread.submit(self._adjustment.add, seen)

    def news(self) -> Adjusted | None:
        """The latest adjusted poses of keyframes, returned once; None where there are no new ones."""
        news, self._news = self._news, None
        return news

    def resume(self, bend: Bend) -> None:
        """Go on with the bend that another instance has estimated."""
        self.begin_anew()
        if bend:
            self._adjustment.expect(np.array(bend))
            self._bend = bend

    def begin_anew(self) -> None:
        """Forget the keyframes: the next poses are unrelated, or of another place."""
        self._wait()
        self._adjustment.begin_anew()
        self._T_map_before, self._due_ns = {}, 0

    def _wait(self) -> bool:
        """Wait for the last keyframe's adjustment; returns whether there was one.

        An exception in it is raised here, after the keyframes are forgotten.
        """
        running, self._running = self._running, None
        if running is None:
            return False
        if (failed := running.exception()) is not None:
            self.begin_anew()
            raise failed
        return True

    def _take_over(self) -> None:
        """Update the calibration from the adjustment, and keep the adjusted poses to be published."""
        if not self._wait():
            return
        errors, stamps, known = self._adjustment.common, self._adjustment.stamps_ns, self.calibration
        self._factor = depth_scale.decided(errors, self._factor)
        log_scale = float(np.log(self._factor))
        self._looks = orientation.decided(errors, self._looks, log_scale)
        poses, bend = self._adjustment.by(np.append(log_scale, self._looks))
        if len(stamps) >= self._enough:
            self._straighten(bend)
        self._T_map_before = {stamp: self._T_map_before[stamp] for stamp in stamps}
        self._untold += 1
        if len(stamps) > 1 and (self.calibration != known or _TOLD_EVERY * self._untold >= len(stamps)):
            self._untold = 0
            now = [turned(pose, -self._looks[:3]) for pose in poses]
            self._news = Adjusted(stamps, list(self._T_map_before.values()), now)

    def _straighten(self, bend: NDArray[np.float64]) -> None:
        """Apply the latest bend of depth if it has changed enough."""
        bend = np.clip(bend, -MAX_BEND, MAX_BEND)
        if np.abs(bend - (self._bend or 0.0)).max() >= _BEND_STEP:
            self._bend = tuple(tuple(row) for row in bend.tolist())


def _same_view(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Whether cameras with these poses (4, 4) have nearly the same view."""
    if np.linalg.norm(one[:3, 3] - other[:3, 3]) >= _SAME_PLACE:
        return False
    return bool(rotation_angle(other[:3, :3].T @ one[:3, :3]) < _SAME_TURN)
