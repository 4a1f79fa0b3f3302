"""Delay of the given poses behind the images that they come with.

A tracker and a camera have different clocks and latencies. Poses that are a few hundredths of a second old are a
centimetre off where the camera is carried at half a metre a second, each time in another direction. Registration of two
frames a moment apart then gives a longer motion than their poses do, by the gain in velocity times the delay. A line
through several such pairs of frames gives the delay. The map is not used, as it was made of poses just as late.
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

# Delays found with the constants below. Rendered desks: 67 ms as 60 to 67 after 1.4 seconds and 65 to 67 in the end,
# 133 ms as 109 to 127 after three seconds. Redkitchen: 33 and 67 ms as 11 and 55 after three seconds, 29 and 63 in the
# end. Clutter: 30 and 63 after 1.4. Exact poses without delay: none, also with depth 3 % too long or short, or the
# tracker mounted 20 mm and 1 degree off (at 30 frames a second in redkitchen up to 7 ms for some seconds). Poses
# without delay, shaken by 10 and 20 mm: at most 11 ms, in one of 21 runs, and 5 in the end. Results of other values
# below were mostly measured with `_REACH` 1.
# Poses further apart than this, seconds, do not tell a hand's velocity, which changes within a third of a second.
_SMOOTH_S = 1 / 3
# Time between the two frames of a pair, seconds: too soon, the velocity is still the same; too late, they see different
# things. With 0.27 to 0.4 as much is found. With 0.13 nothing is found in redkitchen, with 0.2 shaken poses without
# delay come out 56 ms late (one frame then tells the velocity of both), with 0.53 to 1 exact ones 8 to 20.
_APART_S = 0.3
# Time between comparisons, seconds. With 0.07, 0.12, 0.2, 0.26: delay of the desks known to 10 ms after 0.7, 0.9, 1.2,
# 1.5 seconds.
_EVERY_S = 0.12
# The same once the delay is known: a pair costs a millisecond, a quarter of the pose of a frame.
_KNOWN_EVERY_S = 0.5
# Every nth of some 5,000 points is registered: with all of them, or half, the delay is the same.
_STRIDE = 4
# Factor of a map's voxels and matching distance: late poses are that far off at first. With 1 it takes up to 8 seconds
# to know delays of 133 ms to 10 ms, not 2.
_REACH = 2
# Most pairs kept, 12 seconds and more: with 50 and 200 it is the same, with 25 shaken poses come out 9 ms late.
_PAIRS = 100
# Pairs before the first estimate, to know the scatter of registrations. With 4 depth of a wrong scale is taken for a
# delay of 9 ms, with 8 the delay is known later.
_FIRST = 6
# A pair that is off by this many standard deviations has a weight of a quarter; with 2 and 5 it is the same.
_OUTLIER = 3.0
# Rounds of reweighting, from the estimate of the pair before. With 1 and 4 two desks' delays end within 3 ms of these.
_ROUNDS = 2
# Median of the mean of three squared normal deviates, whose expectation is one.
_MEDIAN = 0.79
# Least standard deviation of the delay, seconds: half of an exposure.
_KNOWN_S = 0.004
# A delay within this many standard deviations may be chance, and counts as none. With 1.5, shaken poses without delay
# come out up to 9 ms late; with 3 less is found, and later.
_SURE = 2.0
# Least change of the delay, seconds: at half a metre a second it moves the camera by a millimetre.
_STEP_S = 0.002
# Largest delay, in stated standard deviations.
_MOST = 5.0
NOTABLE_S = 0.01
"""Shorter delays are not reported."""


def notice(delay_s: float) -> str:
    """Text about the delay for people; empty where it is not notable."""
    if abs(delay_s) < NOTABLE_S:
        return ""
    side = "older" if delay_s > 0 else "newer"
    return (
        f"given poses are {1e3 * abs(delay_s):.0f} ms {side} than their images; this is corrected, but check the "
        "timestamps"
    )


class _Given(NamedTuple):
    """A frame: seconds, given pose (4, 4), surface in the camera frame."""

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
        """The camera's pose (4, 4), if the given one is this late."""
        return moved(self.frame.pose, delay_s * self.velocity)


class PoseDelay:
    """Estimates the delay of the given poses, and compensates it.

    sigma_s: prior standard deviation of the delay, seconds; 0: poses are taken as they are.
    """

    def __init__(self, sigma_s: float) -> None:
        self.delay_s = 0.0
        # Delay compensated in the last given pose: none after a gap, where the velocity is unknown.
        self.applied_s = 0.0
        # Motion (6,) of the camera for each second of delay, at the last given pose.
        self.velocity = np.zeros(6)
        self._sigma = sigma_s
        self._estimate = 0.0
        self._every_s, self._compared_s = _EVERY_S, -np.inf
        self._frames: deque[_Given] = deque(maxlen=3)
        self._references: deque[_Moving] = deque()
        # How much faster the camera has become, and how much further it moved than the poses say: (2, 3) each.
        self._pairs: deque[tuple[NDArray[np.float64], NDArray[np.float64]]] = deque(maxlen=_PAIRS)

    def compensated(self, stamp_ns: int, T_world_given: NDArray[np.float64], surface: Surface) -> NDArray[np.float64]:
        """The camera's pose (4, 4) at the time of the image, by the delay as estimated with this frame.

        T_world_given: (4, 4), the frame's given pose; surface: that of the frame, camera frame.
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
        """Forget the frames before, as the poses have jumped."""
        self._frames.clear()
        self._references.clear()

    def rescaled(self) -> None:
        """Forget the surfaces before, as depth has another scale from here on."""
        self._references.clear()
        while len(self._frames) > 1:
            self._frames.popleft()

    def _learn(self) -> None:
        """Compare the frame before the last one, whose velocity is known now, with one from a moment ago."""
        if len(self._frames) < 3:
            return
        before, frame, after = self._frames
        steps = frame.time_s - before.time_s, after.time_s - frame.time_s
        if not 0 < min(steps) <= max(steps) <= _SMOOTH_S:
            return
        if self._references and 0 <= frame.time_s - self._references[-1].frame.time_s < _EVERY_S:
            return
        # From the frame before to the one after: velocity and motion then have independent noise of the poses.
        moving = _Moving(before, frame, after, twist(before.pose, after.pose) / sum(steps))
        reference = None
        while self._references and _apart(self._references[0], moving):
            reference = self._references.popleft()
        self._references.append(moving)
        if reference is not None and not 0 <= frame.time_s - self._compared_s < self._every_s:
            self._compared_s = frame.time_s
            self._compare(reference, moving)

    def _compare(self, first: _Moving, second: _Moving) -> None:
        """Register one frame to the other, and record how that motion differs from the poses' motion."""
        if min(len(first.frame.surface.points), len(second.frame.surface.points)) < POINTS_MIN:
            return
        surface = _thinned(second.frame.surface)
        planes = SurfelMap(_REACH * VOXEL, len(first.frame.surface.points))
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
        """Fit a line without offset through the pairs: iteratively reweighted least squares (Geman-McClure)."""
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
    """Whether two frames are far enough apart to be compared, and share no frame in their velocities."""
    return second.frame.time_s - first.frame.time_s >= _APART_S and second.before.time_s > first.after.time_s


def _motion(first: _Moving, second: _Moving, delay_s: float) -> NDArray[np.float64]:
    """(4, 4) motion from the camera of one frame to that of another, if the given poses are this late."""
    return invert(first.carried(delay_s)) @ second.carried(delay_s)


def _thinned(surface: Surface) -> Surface:
    """Every nth point."""
    return Surface(*(array[::_STRIDE].copy() for array in surface))
