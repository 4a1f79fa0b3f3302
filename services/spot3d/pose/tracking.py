"""Tracking over frames: prediction, loss, recovery; for every provider that registers to a local map."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from spot3d.calibration import Bend
from spot3d.camera_pose import REACH_M
from spot3d.frame import RgbdFrame
from spot3d.pose.adjustment import NewKeyframe
from spot3d.pose.drift import DriftCorrection
from spot3d.pose.estimate import PoseEstimate
from spot3d.pose.features import FeatureDetector
from spot3d.pose.keyframe_adjuster import KeyframeAdjuster
from spot3d.pose.landmark_map import Matches
from spot3d.pose.motion import checked_pose, extrapolated, turned
from spot3d.pose.registration import (
    OVERLAP_MIN,
    SAME_PLACE,
    Registrar,
    Registration,
    best_of,
    elsewhere,
    implausible,
    information_of_structure,
)
from spot3d.pose.relocalisation import relocalised
from spot3d.pose.settings import PoseSettings
from spot3d.pose.surface import POINTS_MIN, sample_surface, why_few
from spot3d.pose.view import View

# Turns from the last good pose at which a lost frame is searched for, in degrees about the camera's x and y axes.
_TURNS = ((0, 12), (0, -12), (12, 0), (-12, 0), (0, 25), (0, -25), (12, 12), (-12, -12), (12, -12), (-12, 12))
# Longest extrapolation of the velocity, seconds; beyond it standing still is the better guess, and the frame is
# searched for. Redkitchen at two frames a second is then off by 0.03 m, not 0.2 to 0.5, TUM fr3/cabinet (no texture,
# 0.16 m from frame to frame) by 0.05 to 0.16 m, not 0.3 to 0.4.
_COASTING = 0.3
# Fewer landmarks than this agree with a wrong pose by chance: up to three do on redkitchen and on TUM fr3/cabinet. With
# 3, 4 and 5 redkitchen at one to three frames a second is the same where all edges are mixed; where 30 % of its depth
# is missing it is off by 0.1 to 0.3 m with each at two frames a second and fewer.
_AGREE_MIN = 5
# Least overlap at a pose that is expected or that landmarks confirm: a map of few frames with holes lacks most of what
# the next one sees. With 0.15, 0.25 and 0.35 rendered desks with 30 % of their depth missing are tracked to 1 to 3 mm,
# and redkitchen as well as with 0.5, with holes or without; of two desks with half of their depth missing both are with
# 0.15, one with 0.25, none with 0.35.
_OVERLAP_EXPECTED = 0.15
# Largest distance between a pose by landmarks and its registration, metres.
_LANDMARKS_OFF = 0.25
# A frame is checked for sliding where fewer than this share of its features lie at their landmarks; it slid if this
# many times more agree with another pose. Four near desks with depth bent by 0.6 % are tracked to 10 to 13 mm rms,
# without the check to 56 to 242: with 0.15, 0.25 and 0.4, and with 1.5, 2 and 3 alike (one 16). Bent by 1 %: 19 to 36
# mm with 1.5, 22 to 36 with 2. Redkitchen, TUM, desks, clutter and near desks without bend are unchanged, but TUM's
# cabinet with 0.4 (65 and 120 mm: few features, and by chance); no frame of most of them is checked.
# The same share of a view's features is assumed to be seen again where they must constrain what its surface does not.
_SEEN_AGAIN, _CLEARLY = 0.25, 1.5
# Least overlap of a lost frame, for which a false match is likelier, and its least margin over any other place.
_RECOVERY_OVERLAP, _RECOVERY_MARGIN = 0.7, 0.1
_MAY_BE_NOISE = "some direction of the pose may be constrained by noise alone"
# After this many lost frames only every fifth is searched for: a long loss must not occupy a core.
_PATIENCE, _SEARCH_INTERVAL = 60, 5


@dataclass(frozen=True, slots=True)
class TrackerState:
    """State of a tracker, from which another process resumes.

    stamp_ns, T_world_camera (4, 4): its last trusted pose. keys (n,), surfels (n, 11): its map of planes. landmarks:
    (m,) of the type LANDMARK. bend: of depth, as estimated so far.
    """

    stamp_ns: int
    T_world_camera: NDArray[np.float64]
    keys: NDArray[np.int64]
    surfels: NDArray[np.float64]
    landmarks: NDArray[np.void]
    bend: Bend = ()


@dataclass(frozen=True, slots=True)
class _Fix:
    """A trusted pose and its stamp."""

    T_world_camera: NDArray[np.float64]
    stamp_ns: int


class MapTracker:
    """Tracks the camera against a registrar's local map; only trusted frames enter that map."""

    def __init__(self, registrar: Registrar, settings: PoseSettings) -> None:
        self._registrar = registrar
        self._settings = settings
        self._last: _Fix | None = None
        self._before: _Fix | None = None
        self._lost_frames = 0
        self._came_ns: int | None = None
        self._detector = FeatureDetector(settings.features, settings.range_max)
        self._drift = DriftCorrection(settings)
        self._compared_ns: int | None = None
        self._adjuster = KeyframeAdjuster.of_odometry(settings)

    def state(self) -> TrackerState | None:
        """The state to resume from, copied; None before the first pose."""
        if self._last is None:
            return None
        keys, surfels = self._registrar.planes.held()
        landmarks, bend = self._drift.map.rows.copy(), self._adjuster.calibration.bend
        return TrackerState(self._last.stamp_ns, self._last.T_world_camera.copy(), keys, surfels, landmarks, bend)

    def resume(self, state: TrackerState) -> None:
        """Go on in the world of another tracker: tracking is lost until a frame is relocalised there."""
        self._registrar.planes.restore(state.keys, state.surfels)
        self._registrar.restored()
        self._drift.map.restore(state.landmarks)
        self._last, self._before = _Fix(state.T_world_camera, state.stamp_ns), None
        self._lost_frames = 1
        if self._settings.depth_bend_sigma:
            self._adjuster.resume(state.bend)

    def track(self, frame: RgbdFrame) -> PoseEstimate:
        """Pose of the frame.

        The first frame whose surface and features constrain the pose starts the map. The world is anchored at its given
        pose, or at identity without a valid one that fusion accepts. Later given poses are not used.
        """
        known = self._adjuster.calibration
        estimate = self._tracked(frame, known.metres(frame.depth_metres()))
        news = self._adjuster.news() if estimate.status == "ok" else None
        return replace(estimate, calibration=known, corrections=None if news is None else news.where_the_last_is())

    def _tracked(self, frame: RgbdFrame, depth_m: NDArray[np.float32]) -> PoseEstimate:
        """See `track`. depth_m: (h, w) float32 metres, 0 = invalid, with the known bend removed."""
        stamp_ns, last, came_ns = frame.stamp_ns, self._last, self._came_ns
        self._came_ns = stamp_ns
        surface = sample_surface(depth_m, frame.intrinsics, self._settings)
        if len(surface.points) < POINTS_MIN:
            return self._lose(why_few(depth_m, len(surface.points), self._settings))
        view = View(
            stamp_ns=stamp_ns,
            at_video_rate=came_ns is not None and (stamp_ns - came_ns) * 1e-9 <= _COASTING,
            colour=frame.colour,
            depth_m=depth_m,
            camera=frame.intrinsics,
            surface=surface,
            detector=self._detector,
            weakness_max=self._settings.weakness_max,
        )
        weak = view.is_weak(view.information)
        if weak and view.is_weak(view.information + _SEEN_AGAIN * view.features.information(view.camera)):
            return self._lose("the view does not constrain the pose in every direction")
        if last is None:
            anchor = checked_pose(frame.T_world_camera)
            if anchor is None or not float(np.abs(anchor[:3, 3]).max()) < REACH_M:
                return replace(self._accept(view, np.eye(4)), remark=_too_far(anchor))
            return self._accept(view, anchor)
        if stamp_ns <= last.stamp_ns:
            return self._lose(f"the timestamp {stamp_ns} is not later than the last one, {last.stamp_ns}")
        if weak:
            return self._follow_landmarks(last, view)
        if self._lost_frames:
            return self._find_again(last, view)
        return self._follow(last, view)

    def _placed(self, view: View, T_world_camera: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """The registered pose, if structure shared with the map constrains it, otherwise completed by features that are
        seen again; None where both together do not constrain it.

        Only at video rate, where odometry slides in directions that only noise constrains. TUM fr3/cabinet has 1.5
        frames a second, and its second frame is unconstrained: its first third would be lost, and found 2.6 m away.
        """
        if not view.at_video_rate:
            return T_world_camera
        structure = self._structure(view, T_world_camera)
        if not view.is_weak(structure):
            return T_world_camera
        seen_again = self._drift.seen_again(view.features, view.camera, T_world_camera)
        if view.is_weak(structure + view.features.information(view.camera, seen_again)):
            return None
        return self._drift.completed(view.features, view.camera, T_world_camera, T_world_camera, structure)

    def _by_landmarks(self, view: View, T_world_place: NDArray[np.float64]) -> NDArray[np.float64]:
        """The pose (4, 4) by landmarks, replaced by the registration in directions that structure constrains.

        A few landmarks near each other hardly constrain the camera's tilt, a floor does.
        """
        found = self._registrar.register(view.surface, T_world_place, False).T_world_camera
        return self._drift.completed(view.features, view.camera, T_world_place, found, self._structure(view, found))

    def _structure(self, view: View, T_world_camera: NDArray[np.float64]) -> NDArray[np.float64]:
        return information_of_structure(self._registrar.planes, view.surface, T_world_camera)

    def _follow(self, last: _Fix, view: View) -> PoseEstimate:
        if (view.stamp_ns - last.stamp_ns) * 1e-9 > _COASTING:
            return self._follow_late(last, view)
        predicted = self._predicted(last, view.stamp_ns)
        registration = self._registrar.register(view.surface, predicted, False)
        doubt = self._doubt(registration, last, view, OVERLAP_MIN)
        if not doubt:
            placed = self._placed(view, registration.T_world_camera)
            return self._follow_landmarks(last, view) if placed is None else self._accept(view, placed)
        # Frames were dropped or the motion was fast: once more, from afar, before giving up.
        found = self._find_again(last, view)
        if found.status == "ok":
            return found
        expected = not elsewhere(registration.T_world_camera, predicted)
        if expected and not self._doubt(registration, last, view, _OVERLAP_EXPECTED):
            placed = self._placed(view, registration.T_world_camera)
            if placed is not None:
                self._lost_frames = 0  # tracked without a loss: the velocity stays valid
                return self._accept(view, placed)
        return PoseEstimate(found.T_world_camera, "lost", doubt)

    def _follow_late(self, last: _Fix, view: View) -> PoseEstimate:
        """Pose of a frame long after the last: by landmarks, otherwise where its surface fits the map best."""
        known_again = self._known_again(last, view)
        if known_again is not None:
            return self._accept(view, known_again)
        tried = self._searched(last, view)
        possible = [other for other in tried if not self._doubt(other, last, view, OVERLAP_MIN)]
        if not possible:
            return self._lose(self._doubt(best_of(tried), last, view, OVERLAP_MIN))
        placed = [self._placed(view, other.T_world_camera) for other in possible]
        held = [replace(other, T_world_camera=at) for other, at in zip(possible, placed, strict=True) if at is not None]
        if not held:
            return self._lose(_MAY_BE_NOISE)
        return self._accept(view, self._likeliest(held, view).T_world_camera)

    def _follow_landmarks(self, last: _Fix, view: View) -> PoseEstimate:
        """Pose by landmarks of a frame whose surface would slide or spin if registered alone, as of a plain table."""
        place = relocalised(view.features, self._drift.map.rows)
        if place is None:
            return self._lose("neither surface nor landmarks constrain the pose in every direction")
        doubt = self._doubt(Registration(place.T_world_camera, 1.0, 0.0), last, view, OVERLAP_MIN)
        if doubt:
            return self._lose(doubt)
        return self._accept(view, self._by_landmarks(view, place.T_world_camera))

    def _likeliest(self, possible: list[Registration], view: View) -> Registration:
        """The registration that most landmarks agree with; that of largest overlap where few agree or several tie."""
        agreeing = [self._agreeing(view, other.T_world_camera) for other in possible]
        most = max(agreeing)
        if most >= _AGREE_MIN:
            possible = [other for other, count in zip(possible, agreeing, strict=True) if count == most]
        return best_of(possible)

    def _find_again(self, last: _Fix, view: View) -> PoseEstimate:
        """Register from several starting poses; the best is accepted if no other place fits nearly as well.

        Otherwise the pose is that by landmarks, if the surface confirms it.
        """
        if self._lost_frames > _PATIENCE and self._lost_frames % _SEARCH_INTERVAL:
            return self._lose(f"lost for {self._lost_frames} frames; only every fifth frame is searched")
        tried = self._searched(last, view)
        best = best_of(tried)
        doubt = self._doubt(best, last, view, _RECOVERY_OVERLAP)
        rivals = (other for other in tried if other.overlap > best.overlap - _RECOVERY_MARGIN)
        if not doubt and any(elsewhere(best.T_world_camera, rival.T_world_camera) for rival in rivals):
            doubt = "the view matches the map in two places"
        if not doubt:
            placed = self._placed(view, best.T_world_camera)
            if placed is not None:
                return self._accept(view, placed)
            doubt = _MAY_BE_NOISE
        known_again = self._known_again(last, view)
        if known_again is None:
            return self._lose(f"not relocalised: {doubt}")
        return self._accept(view, known_again)

    def _searched(self, last: _Fix, view: View) -> list[Registration]:
        return [self._registrar.register(view.surface, guess, True) for guess in self._guesses(last, view.stamp_ns)]

    def _known_again(self, last: _Fix, view: View) -> NDArray[np.float64] | None:
        """The pose by landmarks alone, if the surface confirms it; otherwise None."""
        place = relocalised(view.features, self._drift.map.rows)
        if place is None:
            return None
        found = self._registrar.register(view.surface, place.T_world_camera, False)
        off = np.linalg.norm((found.T_world_camera - place.T_world_camera)[:3, 3])
        # Few landmarks, all on one side, place the camera roughly: then the overlap must be larger.
        overlap_min = _OVERLAP_EXPECTED if off < SAME_PLACE else _RECOVERY_OVERLAP
        if off > _LANDMARKS_OFF or self._doubt(found, last, view, overlap_min):
            return None
        placed = self._placed(view, found.T_world_camera)
        return self._by_landmarks(view, place.T_world_camera) if placed is None else placed

    def _guesses(self, last: _Fix, stamp_ns: int) -> list[NDArray[np.float64]]:
        """Starting poses for a frame that is searched for, the likeliest first."""
        guesses = [last.T_world_camera]
        if (stamp_ns - last.stamp_ns) * 1e-9 < _COASTING:
            guesses.insert(0, self._predicted(last, stamp_ns))
        return guesses + [turned(last.T_world_camera, np.radians((*turn, 0.0))) for turn in _TURNS]

    def _predicted(self, last: _Fix, stamp_ns: int) -> NDArray[np.float64]:
        """Constant velocity from the last two trusted poses, by their stamps: live runs skip frames."""
        before = self._before
        if before is None:
            return last.T_world_camera
        ratio = (stamp_ns - last.stamp_ns) / (last.stamp_ns - before.stamp_ns)
        return extrapolated(before.T_world_camera, last.T_world_camera, ratio)

    def _doubt(self, registration: Registration, last: _Fix, view: View, overlap_min: float) -> str:
        elapsed = (view.stamp_ns - last.stamp_ns) * 1e-9
        return implausible(registration, last.T_world_camera, elapsed, overlap_min, self._settings)

    def _accept(self, view: View, pose: NDArray[np.float64]) -> PoseEstimate:
        forgotten = self._forgotten()
        pose = self._corrected(view, pose)
        self._registrar.insert(view.surface, pose)
        # After a loss the old velocity is meaningless.
        self._before = None if self._lost_frames else self._last
        self._last = _Fix(pose, view.stamp_ns)
        self._lost_frames = 0
        if self._settings.depth_bend_sigma and self._adjuster.due(view.stamp_ns):
            known = self._adjuster.calibration
            seen = NewKeyframe(view.stamp_ns, view.surface, view.camera, known, pose, 0.0, np.zeros(6), pose)
            self._adjuster.learn(seen, pose)
        return PoseEstimate(pose, "ok", forgotten=self._forgotten() - forgotten)

    def _forgotten(self) -> int:
        return self._registrar.planes.forgotten + self._drift.map.forgotten

    def _corrected(self, view: View, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """The registered pose without the drift that landmarks show."""
        elapsed = 0.0 if self._compared_ns is None else (view.stamp_ns - self._compared_ns) * 1e-9
        if self._lost_frames:
            self._drift.restart()
        elif self._compared_ns is not None and elapsed < self._settings.landmark_interval:
            return self._drift.held(pose)
        self._compared_ns = view.stamp_ns
        matches = self._drift.map.match(view.features, view.camera, pose)
        place = self._slid_from(matches, view, pose)
        if place is not None:
            self._drift.restart()
            return self._drift.correct(view.features, view.camera, place, view.information, elapsed)
        return self._drift.correct(view.features, view.camera, pose, view.information, elapsed, matches)

    def _slid_from(self, matches: Matches, view: View, pose: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Another pose with which clearly more landmarks agree than with the registered one, by which `matches` were
        found; None: the frame did not slide.

        The bend of depth moves with the camera: a registration may stay at the pose from which it started.
        """
        if self._last is None:
            return None
        features = view.features
        agreeing = self._agreeing(view, pose, matches)
        if agreeing >= _SEEN_AGAIN * len(features):
            return None
        place = relocalised(features, self._drift.map.rows)
        if place is None or place.agreeing < _CLEARLY * agreeing:
            return None
        found = self._registrar.register(view.surface, place.T_world_camera, False)
        if self._doubt(found, self._last, view, _OVERLAP_EXPECTED):
            return None
        slides = _CLEARLY * self._agreeing(view, found.T_world_camera) < place.agreeing
        return place.T_world_camera if slides else found.T_world_camera

    def _agreeing(self, view: View, T_world_camera: NDArray[np.float64], matches: Matches | None = None) -> int:
        """How many features lie at their landmark by a pose; matches: by this pose, if they are known."""
        return int(np.count_nonzero(self._drift.seen_again(view.features, view.camera, T_world_camera, matches)))

    def _lose(self, reason: str) -> PoseEstimate:
        self._lost_frames += 1
        return PoseEstimate(np.eye(4) if self._last is None else self._last.T_world_camera, "lost", reason)


def _too_far(anchor: NDArray[np.float64] | None) -> str:
    """Text for people about a given pose (4, 4) at which no world can begin; empty without one."""
    if anchor is None:
        return ""
    place = ", ".join(f"{value:.3g}" for value in anchor[:3, 3])
    return (
        f"the first given pose, at ({place}) m, is beyond the map's {REACH_M:g} m from the origin: the world begins at "
        "the first camera instead; for the given world's axes, give poses in one whose origin is nearby"
    )
