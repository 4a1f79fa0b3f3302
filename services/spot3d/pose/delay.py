"""By how much the given poses are later than the images that they come with.

A tracker's clock is not the camera's, and both take their time: poses that are a few hundredths of a second old are a
centimetre off where the camera is carried at half a metre a second, each time to another side. Between two frames a
moment apart, registration of the one to the other then has the camera move further than the poses say, by as much as it
has become faster times the delay: a line through some such pairs of frames tells it. The map has no part in this; it
was made of poses just as late.
"""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import invert
from spot3d.pose.motion import extrapolated, moved, twist
from spot3d.pose.registration import DISTANCE, judged, refined
from spot3d.pose.surface import POINTS_MIN, Surface
from spot3d.pose.surfel_map import VOXEL, SurfelMap

# The constants below find, of 67 ms at rendered desks, 60 to 67 after 1.4 seconds and 65 to 67 in the end, of 133 ms
# 109 to 127 after three seconds; of 33 and 67 ms in redkitchen 11 and 55 after three seconds and 29 and 63 in the end,
# in clutter 30 and 63 after 1.4. Poses in time count as in time where they are exact, also where depth is 3 % too long
# or short, or the tracker mounted 20 mm and 1 degree otherwise than told (at 30 frames a second in redkitchen for some
# seconds as up to 7 ms late); shaken by 10 and 20 mm as 11 ms late at most, in one of 21 runs, and as 5 in the end.
# What is said below of other values was mostly measured with `_REACH` 1.
# A hand moves anew after a third of a second: where poses are further apart, they do not tell its velocity.
_SMOOTH_S = 1 / 3
# Frames are compared so far apart, seconds: a hand is as fast as a moment before when it is too soon, and when it is
# too late they see other things. With 0.27 to 0.4 as much is found; with 0.13 nothing in redkitchen, and with 0.2
# shaken poses in time are 56 ms late (a frame then tells the velocity of both); with 0.53 to 1 exact ones are 8 to 20.
_APART_S = 0.3
# A frame is compared every so many seconds. With 0.07, 0.2 and 0.26 the delay of the desks is known to 10 ms after 0.7,
# 1.2 and 1.5 seconds in place of 0.9.
_EVERY_S = 0.12
# So many seconds once it is known: a pair costs a millisecond, a quarter of the pose of a frame.
_KNOWN_EVERY_S = 0.5
# Every nth of some 5,000 points is registered: with all of them, or half, the delay is the same.
_STRIDE = 4
# Voxels, and the distance within which a point meets its plane, are so many times those of a map: poses that are late
# are as far off at first. With 1 delays of 133 ms are known to 10 ms later, after up to 8 seconds in place of 2.
_REACH = 2
# So many pairs are looked at, 12 seconds and more: with 50 and 200 it is the same, with 25 shaken poses are 9 ms late.
_PAIRS = 100
# So many pairs tell how much registrations scatter, before they tell anything else. With 4 depth of a wrong scale is
# taken for a delay of 9 ms, with 8 the delay is known later.
_FIRST = 6
# The weight of a pair that is off by so many standard deviations is a quarter; with 2 and 5 it is the same.
_OUTLIER = 3.0
# Times that the weights are computed anew: they start from those of the pair before. With 1 and 4 the delays of two
# desks end within 3 ms of these.
_ROUNDS = 2
# The median of what is on average one: the mean of three squares of a normal deviate.
_MEDIAN = 0.79
# No delay is better known than this, seconds: half of an exposure.
_KNOWN_S = 0.004
# What lies within so many standard deviations may be chance: poses count as in time until they surely are not.
# With 1.5, shaken poses in time are taken for up to 9 ms late; with 3 less is found, and later.
_SURE = 2.0
# Steps smaller than this move a camera that is carried at half a metre a second by a millimetre.
_STEP_S = 0.002
# More than so many standard deviations no tracker is late.
_MOST = 5.0
NOTABLE_S = 0.01
"""A delay of less is not spoken of."""


def notice(delay_s: float) -> str:
    """What is wrong with the given poses, in words; empty where that is not worth a word."""
    if abs(delay_s) < NOTABLE_S:
        return ""
    side = "older" if delay_s > 0 else "newer"
    return f"given poses are {1e3 * abs(delay_s):.0f} ms {side} than their images, and are corrected: check the stamps"


class _Given(NamedTuple):
    """A frame as it comes: seconds, given pose (4, 4), surface in the camera frame."""

    time_s: float
    pose: NDArray[np.float64]
    surface: Surface


class _Moving(NamedTuple):
    """A frame between two others, and its velocity (6,): metres and radians a second, as `moved` takes it."""

    before: _Given
    frame: _Given
    after: _Given
    velocity: NDArray[np.float64]

    def carried(self, delay_s: float) -> NDArray[np.float64]:
        """Where the camera is (4, 4), if the given pose is so late."""
        return moved(self.frame.pose, delay_s * self.velocity)


class PoseDelay:
    """The delay of the given poses, and where the camera is by them.

    sigma_s: how late given poses may be, standard deviation in seconds; 0: they are taken as they are.
    """

    def __init__(self, sigma_s: float) -> None:
        self.delay_s = 0.0
        # By how much the last given pose was carried on: after a gap nothing tells how fast the camera is.
        self.applied_s = 0.0
        # Of the last given pose: by how much (6,) a camera is elsewhere for each second of delay.
        self.velocity = np.zeros(6)
        self._sigma = sigma_s
        self._estimate = 0.0
        self._every_s, self._compared_s = _EVERY_S, -np.inf
        self._frames: deque[_Given] = deque(maxlen=3)
        self._references: deque[_Moving] = deque()
        # How much faster the camera has become, and how much further it moved than the poses say: (2, 3) each.
        self._pairs: deque[tuple[NDArray[np.float64], NDArray[np.float64]]] = deque(maxlen=_PAIRS)

    def compensated(self, stamp_ns: int, T_world_given: NDArray[np.float64], surface: Surface) -> NDArray[np.float64]:
        """Where the camera is at the time of the image, by all that is known of the delay with this frame.

        T_world_given: (4, 4), what the frame brings along; surface: what it sees, camera frame.
        """
        if not self._sigma:
            return T_world_given
        last = self._frames[-1] if self._frames else None
        self._frames.append(_Given(1e-9 * stamp_ns, T_world_given, surface))
        self._learn()
        elapsed = 0.0 if last is None else 1e-9 * stamp_ns - last.time_s
        if last is None or not 0 < elapsed <= _SMOOTH_S:
            self.velocity, self.applied_s = np.zeros(6), 0.0
            return T_world_given
        self.applied_s = self.delay_s
        self.velocity = twist(last.pose, T_world_given) / elapsed
        if self.delay_s == 0:
            return T_world_given
        return extrapolated(last.pose, T_world_given, self.delay_s / elapsed)

    def interrupt(self) -> None:
        """The poses have jumped: what came before tells nothing of motions from here on."""
        self._frames.clear()
        self._references.clear()

    def rescaled(self) -> None:
        """Depth has another scale from here on: surfaces from before are not to be compared with those after."""
        self._references.clear()
        while len(self._frames) > 1:
            self._frames.popleft()

    def _learn(self) -> None:
        """Compare the frame before the last one, whose velocity is known by now, with one from a moment ago."""
        if len(self._frames) < 3:
            return
        before, frame, after = self._frames
        steps = frame.time_s - before.time_s, after.time_s - frame.time_s
        if not 0 < min(steps) <= max(steps) <= _SMOOTH_S:
            return
        if self._references and 0 <= frame.time_s - self._references[-1].frame.time_s < _EVERY_S:
            return
        # From one frame before to one after: noise of the poses is then in velocity and motion by chance.
        moving = _Moving(before, frame, after, twist(before.pose, after.pose) / sum(steps))
        reference = None
        while self._references and _apart(self._references[0], moving):
            reference = self._references.popleft()
        self._references.append(moving)
        if reference is not None and not 0 <= frame.time_s - self._compared_s < self._every_s:
            self._compared_s = frame.time_s
            self._compare(reference, moving)

    def _compare(self, first: _Moving, second: _Moving) -> None:
        """Register one frame to another alone, and see how its motion differs from that of the poses."""
        if min(len(first.frame.surface), len(second.frame.surface)) < POINTS_MIN:
            return
        surface = _thinned(second.frame.surface)
        planes = SurfelMap(_REACH * VOXEL, len(first.frame.surface))
        planes.insert(first.frame.surface, np.eye(4))
        expected = _motion(first, second, self.delay_s)
        registered = refined(planes, surface, expected, _REACH * DISTANCE)
        if not judged(planes, surface, registered, _REACH * DISTANCE).fits:
            return
        faster = twist(expected, _motion(first, second, self.delay_s + _STEP_S)) / _STEP_S
        further = twist(expected, registered) + self.delay_s * faster
        self._pairs.append((faster.reshape(2, 3), further.reshape(2, 3)))
        if len(self._pairs) >= _FIRST:
            self._fit()

    def _fit(self) -> None:
        """Fit a line through the pairs and no offset: iteratively reweighted least squares (Geman-McClure)."""
        faster, further = np.array(self._pairs).swapaxes(0, 1)
        for _ in range(_ROUNDS):
            square = np.square(further - self._estimate * faster).mean(axis=2)
            usual = np.maximum(np.median(square, axis=0) / _MEDIAN, 1e-12)
            weight = (1 + square / (_OUTLIER**2 * usual)) ** -2
            scatter = np.maximum((weight * square).sum(axis=0) / weight.sum(axis=0), 1e-12)
            weight = (weight / scatter)[..., None]
            information = self._sigma**-2 + float((weight * faster**2).sum())
            self._estimate = float((weight * faster * further).sum()) / information
        self._estimate = float(np.clip(self._estimate, -_MOST * self._sigma, _MOST * self._sigma))
        sigma = information**-0.5
        self._every_s = _EVERY_S if sigma > _KNOWN_S else _KNOWN_EVERY_S
        doubt = _SURE * max(sigma, _KNOWN_S)
        sure = max(0.0, 1.0 - (doubt / self._estimate) ** 2) if self._estimate else 0.0
        if abs(sure * self._estimate - self.delay_s) >= _STEP_S:
            self.delay_s = sure * self._estimate


def _apart(first: _Moving, second: _Moving) -> bool:
    """Whether two frames are so far apart that they tell the delay; no frame then tells the velocity of both."""
    return second.frame.time_s - first.frame.time_s >= _APART_S and second.before.time_s > first.after.time_s


def _motion(first: _Moving, second: _Moving, delay_s: float) -> NDArray[np.float64]:
    """(4, 4) from the camera of one frame to that of another, if the given poses are so late."""
    return invert(first.carried(delay_s)) @ second.carried(delay_s)


def _thinned(surface: Surface) -> Surface:
    """Every nth point."""
    return Surface(*(array[::_STRIDE].copy() for array in (surface.points, surface.normals, surface.sigma)))
