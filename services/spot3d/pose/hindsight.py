"""What only later frames tell: how the camera is to be seen, and what the poses of keyframes lack."""

from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from spot3d.calibration import Bend, Calibration
from spot3d.camera import invert
from spot3d.pose import depth_scale, orientation
from spot3d.pose.adjustment import EVERY_NS, Adjustment, Seen
from spot3d.pose.motion import turned, twist
from spot3d.pose.settings import PoseSettings
from spot3d.pose_corrections import PoseCorrections
from spot3d.trajectory import rotation_angle
from spot3d_schemas.limits import MAX_BEND

# Poses are told of again once there are a tenth more keyframes, or the camera is seen otherwise: each time is work for
# fusion. Where each keyframe is told of, an update of redkitchen's objects takes 300 ms after half a minute, not 220
# (170 where none is); what is found is the same within 2 % of IoU.
_TOLD_EVERY = 10


# How well a camera's focal length is known. Without it, and without what bends depth, redkitchen's is 4 % off, give or
# take 0.03.
_WIDTH_SIGMA = 0.01
# Variances of given poses that are tried, of the stated one.
_SHARES = np.geomspace(1e-4, 1.0, 33)
# Odometry's poses hold its keyframes by so much, metres and radians. With 3, 10, 30 and 100 mm those of a near desk
# that is bent by 0.3 % come out 6.2, 4.7, 4.6 and 6.1 mm off (7.7 before), redkitchen's 27.9, 26.9, 27.5, 28.5 (27.5).
_ODOMETRY = (0.01, 0.005)
# So many keyframes tell what bends depth. How far off given poses are is known after three seconds: before, poses that
# are late bend it by 0.4 % where it is straight. Odometry's are of one piece.
_ENOUGH_OF_GIVEN, _ENOUGH_OF_ODOMETRY = 6, 2
# What is bent is taken out anew where that changes by so much: a metre away it is a pixel's noise. With half of it
# redkitchen and near desks are the same, and fusion sees 1.5 times as many of redkitchen's keyframes anew.
_BEND_STEP = 0.002
# Of keyframes within so far, metres and radians, no more than so many count, as with views of objects. A camera that
# stands still sees the same again: what planes are not quite is taken for what bends depth, by 2 to 4 % within minutes.
_SAME_PLACE, _SAME_TURN, _SAME_VIEWS = 0.05, np.radians(3), 5


class Adjusted(NamedTuple):
    """Keyframes by stamp, oldest first: poses (4, 4) in the map as they were published, and in the world as they are
    known now. Both are without the turn of the camera that was applied by then.
    """

    stamps_ns: list[int]
    T_map_before: list[NDArray[np.float64]]
    T_world_now: list[NDArray[np.float64]]

    def corrections(self, T_world_map: NDArray[np.float64]) -> PoseCorrections:
        """What the poses lack, where the map lies by now, (4, 4)."""
        pairs = zip(self.T_map_before, self.T_world_now, strict=True)
        twists = np.array([twist(T_world_map @ before, now) for before, now in pairs])
        return PoseCorrections(np.array(self.stamps_ns, np.int64), twists)

    def where_the_last_is(self) -> PoseCorrections:
        """What the poses lack in a map in which the last one lacks nothing."""
        T_map_world = self.T_map_before[-1] @ invert(self.T_world_now[-1])
        now = [T_map_world @ pose for pose in self.T_world_now]
        return self._replace(T_world_now=now).corrections(np.eye(4))


class Learnt(NamedTuple):
    """By what the factor of depth has changed, and turn and centre (5,)."""

    grown: float
    looks: NDArray[np.float64]


class Hindsight:
    """Keyframes, adjusted as one, and the camera's calibration that follows from them.

    They are adjusted in a thread of its own beside the frames that follow: no frame waits for it but a keyframe, which
    takes over what the keyframe before has told; so it is the same however fast frames come. calibration: as it is
    applied by now; enough: so many keyframes tell what bends depth.
    """

    def __init__(self, adjustment: Adjustment, enough: int) -> None:
        self._adjustment, self._enough = adjustment, enough
        self._thread = ThreadPoolExecutor(1, "adjustment")
        self._running: Future[None] | None = None
        # What depth is multiplied by; turn and centre; and what is bent.
        self._factor, self._looks = 1.0, np.zeros(5)
        self._bend: Bend = ()
        self._due_ns = 0
        # Of the keyframes, without the turn.
        self._T_map_before: dict[int, NDArray[np.float64]] = {}
        self._news: Adjusted | None = None
        self._untold = 0

    @classmethod
    def of_given_poses(cls, settings: PoseSettings) -> Self:
        """What is wrong with given poses is for them to say, and so is the camera's scale, turn and centre."""
        turn, centre = settings.mount_turn_sigma, settings.centre_sigma
        sigmas = np.array((settings.depth_scale_sigma, turn, turn, turn, centre, centre, _WIDTH_SIGMA))
        held = settings.given_sigma, settings.given_turn_sigma
        return cls(Adjustment(sigmas, settings.depth_bend_sigma, held, _SHARES), _ENOUGH_OF_GIVEN)

    @classmethod
    def of_odometry(cls, settings: PoseSettings) -> Self:
        """Odometry's poses agree with its camera whatever that does, but for what that bends."""
        return cls(Adjustment(np.zeros(7), settings.depth_bend_sigma, _ODOMETRY, np.ones(1)), _ENOUGH_OF_ODOMETRY)

    @property
    def calibration(self) -> Calibration:
        x, y, z, *centre = self._looks.tolist()
        return Calibration(self._factor, (x, y, z), (centre[0], centre[1]), self._bend)

    def turned(self, T_world_given: NDArray[np.float64]) -> NDArray[np.float64]:
        """The camera's pose (4, 4) by a given one."""
        return turned(T_world_given, self._looks[:3]) if self._looks[:3].any() else T_world_given

    def due(self, stamp_ns: int) -> bool:
        """Whether a frame is to be a keyframe."""
        return stamp_ns >= self._due_ns

    def learn(self, seen: Seen, T_map_camera: NDArray[np.float64]) -> Learnt:
        """Take in a keyframe, and take over what those before have told. One that sees what enough others have seen
        tells nothing, and is left out.

        T_map_camera: (4, 4), its corrected pose in the map.
        """
        before = self._looks[:3]
        learnt = self._take_over()
        self._due_ns = seen.stamp_ns + EVERY_NS
        place = turned(T_map_camera, -before)
        if sum(_same_view(place, other) for other in self._T_map_before.values()) >= _SAME_VIEWS:
            return learnt
        self._T_map_before[seen.stamp_ns] = place
        self._running = self._thread.submit(self._adjustment.add, seen)
        return learnt

    def news(self) -> Adjusted | None:
        """What was taken over last of keyframes' poses, once."""
        news, self._news = self._news, None
        return news

    def resume(self, bend: Bend) -> None:
        """Go on with what another one knew of the camera."""
        self.begin_anew()
        if bend:
            self._adjustment.expect(np.array(bend))
            self._bend = bend

    def begin_anew(self) -> None:
        """The next frames are of other poses, or of another place."""
        self._wait()
        self._adjustment.begin_anew()
        self._T_map_before, self._due_ns = {}, 0

    def _wait(self) -> bool:
        """Let the last keyframe be adjusted; returns whether there was one.

        What failed in it is raised here, and the next keyframe is a first one again.
        """
        running, self._running = self._running, None
        if running is None:
            return False
        if (failed := running.exception()) is not None:
            self.begin_anew()
            raise failed
        return True

    def _take_over(self) -> Learnt:
        """Apply what the keyframes tell of the camera, and remember what they tell of poses."""
        if not self._wait():
            return Learnt(1.0, np.zeros(5))
        errors, stamps = self._adjustment.common_errors(), self._adjustment.stamps_ns
        factor, looks = self._factor, self._looks
        self._factor = depth_scale.decided(errors, factor)
        log_scale = float(np.log(self._factor))
        self._looks = orientation.decided(errors, looks, log_scale)
        learnt = Learnt(self._factor / factor, self._looks - looks)
        poses, bend = self._adjustment.by(np.append(log_scale, self._looks))
        straighter = len(stamps) >= self._enough and self._straighten(bend)
        self._T_map_before = {stamp: self._T_map_before[stamp] for stamp in stamps}
        self._untold += 1
        anew = learnt.grown != 1 or learnt.looks.any() or straighter or _TOLD_EVERY * self._untold >= len(stamps)
        if len(stamps) > 1 and anew:
            self._untold = 0
            now = [turned(pose, -self._looks[:3]) for pose in poses]
            self._news = Adjusted(stamps, list(self._T_map_before.values()), now)
        return learnt

    def _straighten(self, bend: NDArray[np.float64]) -> bool:
        """Follow what is known by now of what bends depth; returns whether that has changed."""
        bend = np.clip(bend, -MAX_BEND, MAX_BEND)
        if np.abs(bend - (self._bend or 0.0)).max() < _BEND_STEP:
            return False
        self._bend = tuple(tuple(row) for row in bend.tolist())
        return True


def _same_view(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Whether cameras with these poses (4, 4) see much the same."""
    if np.linalg.norm(one[:3, 3] - other[:3, 3]) >= _SAME_PLACE:
        return False
    return bool(rotation_angle(other[:3, :3].T @ one[:3, :3]) < _SAME_TURN)
