"""Keyframes adjusted as one: on the built-in scene, whose poses and camera are wrong in known ways."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from test_pose_correction import CAMERA, shaken

from made_frame import frame_of
from spot3d.calibration import NOMINAL, Calibration, bend_at, bend_of_image
from spot3d.camera import invert
from spot3d.pose import adjustment
from spot3d.pose.adjustment import Adjustment, NewKeyframe
from spot3d.pose.common_errors import COMMON, CommonErrors, most_probable
from spot3d.pose.correction import CorrectedPoses
from spot3d.pose.keyframe_adjuster import KeyframeAdjuster
from spot3d.pose.motion import moved, turned, twist
from spot3d.pose.plane_equations import BEND_NODES, SeenPoints, plane_equations
from spot3d.pose.settings import PoseSettings
from spot3d.pose.surface import sample_surface
from spot3d.source.scene.scene import Scene

SETTINGS = PoseSettings(provider="given")
EXACT = np.zeros(6)
IN_TIME = 0.0, np.zeros(6)
UNSURE = np.array((0.02, 0.014, 0.014, 0.014, 0.02, 0.02))
STEP_NS = adjustment.EVERY_NS
FRAMES, EVERY = 24, 25


@cache
def scene() -> tuple[list[NDArray[np.float32]], NDArray[np.float64]]:
    """Depth of keyframes of the built-in scene and their true poses (n, 4, 4)."""
    made = Scene(0, frames=FRAMES * EVERY, intrinsics=CAMERA)
    depths = [made[EVERY * k].depth_metres() for k in range(FRAMES)]
    return depths, np.array([made.true_pose(EVERY * k) for k in range(FRAMES)])


def noisy(seed: int, metres: float = 0.01) -> NDArray[np.float64]:
    """Poses that are wrong by so much along each axis, and 0.4 deg a centimetre about it, each otherwise."""
    sigma = np.repeat((metres, np.radians(40 * metres)), 3)
    wrong = sigma * np.random.default_rng(seed).normal(size=(FRAMES, 6))
    return np.array([moved(pose, off) for pose, off in zip(scene()[1], wrong, strict=True)])


def bent(by: float) -> NDArray[np.float32]:
    """What a camera multiplies each pixel's depth by."""
    k = np.indices(CAMERA.shape, np.float32)
    waves = np.sin(k[1] / CAMERA.width * 2 * np.pi) * np.cos(k[0] / CAMERA.height * np.pi)
    return np.asarray(1 + by * waves, np.float32)


def fresh(sigmas: NDArray[np.float64]) -> Adjustment:
    held = SETTINGS.given_sigma, SETTINGS.given_turn_sigma
    return Adjustment(np.append(sigmas, 0.01), SETTINGS.depth_bend_sigma, held, np.geomspace(1e-4, 1.0, 33))


def adjusted(
    given: NDArray[np.float64], sigmas: NDArray[np.float64] = EXACT, told: Calibration = NOMINAL, bend: float = 0.0
) -> Adjustment:
    """Of keyframes with these poses, as a camera tells them that is in truth so calibrated, and whose depth is bent."""
    depths, true = scene()
    field = bent(bend)
    made = fresh(sigmas)
    wrong = Calibration(centre=(-told.centre[0], -told.centre[1])).camera(CAMERA)
    for number, (depth, pose, tracked) in enumerate(zip(depths, given, true, strict=True)):
        surface = sample_surface(depth * field / np.float32(told.depth_factor), wrong, SETTINGS)
        made.add(NewKeyframe(number * STEP_NS, surface, wrong, NOMINAL, pose, *IN_TIME, tracked))
    return made


def estimated(errors: CommonErrors) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What is wrong alike in all (6,), if nothing of it is zero, and the information on it (6, 6)."""
    at = most_probable(errors)
    information = errors.information[at] + np.diag(errors.sigmas**-2.0)
    return np.linalg.solve(information, errors.pull[at]), information


def apart(poses: list[NDArray[np.float64]]) -> float:
    """How far poses lie from the true ones, rms, metres, but for what is alike in all of them."""
    _, true = scene()
    off = np.array([pose @ invert(at) for pose, at in zip(poses, true, strict=True)])
    places = np.einsum("kij,kj->ki", off[:, :3, :3], true[:, :3, 3]) + off[:, :3, 3] - true[:, :3, 3]
    return float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("seed", [0, 1])
def test_shaken_poses_come_out_a_quarter_as_far_off(seed: int) -> None:
    given = noisy(seed)
    made = adjusted(given)
    assert apart(made.by(EXACT)[0]) < 0.25 * apart(list(given))


def test_exact_poses_stay() -> None:
    poses = adjusted(scene()[1], UNSURE).by(EXACT)[0]
    assert max(np.abs(twist(pose, true)).max() for pose, true in zip(poses, scene()[1], strict=True)) < 1e-3


@pytest.mark.parametrize("metres", [0.0, 0.01])
@pytest.mark.parametrize(
    ("told", "turn"),
    [
        (Calibration(0.97), np.zeros(3)),
        (Calibration(1.03, centre=(0.0, 0.025)), np.zeros(3)),
        (NOMINAL, np.array((0.01, -0.015, 0.008))),
    ],
)
def test_what_is_wrong_alike_in_all_is_found_with_the_poses(
    told: Calibration, turn: NDArray[np.float64], metres: float
) -> None:
    given = np.array([turned(pose, -turn) for pose in noisy(0, metres)])
    made = adjusted(given, UNSURE, told)
    estimate, information = estimated(made.common)
    truth = np.array((np.log(told.depth_factor), *turn, *told.centre))
    off = estimate - truth
    # Within what is said to be uncertain, though not by five standard deviations and more where poses are noisy.
    assert off @ information @ off < 5**2
    assert np.abs(off[0]) < 0.005 + 0.5 * metres
    if not metres:
        np.testing.assert_allclose(off[1:], 0.0, atol=0.005)
    assert apart(made.by(truth)[0]) < 0.002 + 0.25 * metres


def test_poses_are_those_that_go_with_what_is_applied() -> None:
    """Where depth's scale is not corrected poses go another way than where it is."""
    made = adjusted(noisy(0), UNSURE, Calibration(0.97))
    estimate, _ = estimated(made.common)
    assert apart(made.by(estimate)[0]) < 0.7 * apart(made.by(EXACT)[0])


def test_depth_that_is_bent_is_no_common_error() -> None:
    """By half a per cent, exact poses: nothing that counts is made of it."""
    estimate, _ = estimated(adjusted(scene()[1], UNSURE, bend=0.005).common)
    assert np.abs(estimate).max() < 0.005


@pytest.mark.parametrize("metres", [0.0, 0.01])
def test_what_bends_depth_is_found_with_the_poses(metres: float) -> None:
    """Where it is what keyframes see, and nothing where depth is straight."""
    left = [
        bent(by) * np.exp(bend_of_image(adjusted(noisy(0, metres), UNSURE, bend=by).by(EXACT)[1], CAMERA.shape))
        for by in (0.0, 0.01)
    ]
    straight, corrected = (float(field.std()) for field in left)
    assert straight < 0.001
    assert corrected < 0.5 * float(bent(0.01).std())


def test_a_keyframe_that_was_straightened_is_the_one_that_was_told() -> None:
    surface, here = sample_surface(scene()[0][0], CAMERA, SETTINGS), np.eye(4)
    known = Calibration(bend=tuple((0.01 * row, -0.01, 0.0, 0.01, 0.02, 0.0) for row in range(4)))
    x, y, z = surface.points.T.astype(np.float64)
    across, down = (CAMERA.fx * x / z + CAMERA.cx) / CAMERA.width, (CAMERA.fy * y / z + CAMERA.cy) / CAMERA.height
    straight = surface.points * np.exp(bend_at(np.array(known.bend), across, down))[:, None]
    straightened = surface._replace(points=straight.astype(np.float32))
    told, seen = (
        adjustment._keyframe(NewKeyframe(0, one, CAMERA, by, here, *IN_TIME, here))
        for one, by in ((surface, NOMINAL), (straightened, known))
    )
    np.testing.assert_allclose(seen.points, told.points, atol=1e-5)


def test_the_common_errors_stay_when_keyframes_go(monkeypatch: pytest.MonkeyPatch) -> None:
    """With room for eight: poses stay as good, and what is known of the camera is not forgotten."""
    monkeypatch.setattr(adjustment, "_KEYFRAMES", 8)
    given = noisy(0)
    made = adjusted(given, UNSURE, Calibration(0.97))
    assert len(made.stamps_ns) <= 8
    assert made.stamps_ns[-1] == (FRAMES - 1) * STEP_NS
    estimate, information = estimated(made.common)
    assert estimate[0] == pytest.approx(np.log(0.97), abs=0.012)
    look_from_one_place(made, times=1)
    kept, kept_information = estimated(made.common)
    np.testing.assert_allclose(kept, estimate, atol=0.005)
    assert 0.3 * information[0, 0] < kept_information[0, 0] < 1.5 * information[0, 0]


def look_from_one_place(made: Adjustment, times: int) -> None:
    """Begin anew so often, and take in two keyframes each time, of which nothing is learnt."""
    depths, true = scene()
    surface = sample_surface(depths[0], CAMERA, SETTINGS)
    for time in range(times):
        made.begin_anew()
        assert made.stamps_ns == []
        for number in range(FRAMES + 2 * time, FRAMES + 2 * time + 2):
            made.add(NewKeyframe(number * STEP_NS, surface, CAMERA, NOMINAL, true[0], *IN_TIME, true[0]))


def test_what_was_learnt_counts_once_however_often_keyframes_begin_anew() -> None:
    made = adjusted(noisy(0), UNSURE, Calibration(0.97))
    estimate, information = estimated(made.common)
    look_from_one_place(made, times=5)
    kept, kept_information = estimated(made.common)
    np.testing.assert_allclose(kept, estimate, atol=0.002)
    assert information[0, 0] < 1.2 * kept_information[0, 0] < 1.5 * information[0, 0]


def test_a_first_keyframe_stays_where_it_was_given() -> None:
    depths, true = scene()
    made = fresh(UNSURE)
    made.add(NewKeyframe(0, sample_surface(depths[0], CAMERA, SETTINGS), CAMERA, NOMINAL, true[0], *IN_TIME, np.eye(4)))
    np.testing.assert_allclose(made.by(EXACT)[0], true[:1])
    estimate, information = estimated(made.common)
    np.testing.assert_allclose(estimate, np.zeros(COMMON))
    np.testing.assert_allclose(information, np.diag(UNSURE**-2.0))


def test_a_delay_that_is_found_later_counts_for_the_keyframes_before() -> None:
    """All but the last two were taken as in time, and their poses are 50 ms old."""
    (depths, true), made = scene(), fresh(EXACT)
    moving = Scene(0, frames=FRAMES * EVERY + 1, intrinsics=CAMERA)
    late = []
    for number, (depth, pose) in enumerate(zip(depths, true, strict=True)):
        velocity, found = 30 * twist(pose, moving.true_pose(EVERY * number + 1)), number >= FRAMES - 2
        given = pose if found else moved(pose, -0.05 * velocity)
        late.append(given)
        surface = sample_surface(depth, CAMERA, SETTINGS)
        made.add(NewKeyframe(number * STEP_NS, surface, CAMERA, NOMINAL, given, 0.05 * found, velocity, pose))
    offsets = np.array([twist(*pair) for pair in zip(made.by(EXACT)[0], true, strict=True)])
    assert np.linalg.norm(offsets[:, :3], axis=1).max() < 0.1 * np.linalg.norm(np.array(late) - true, axis=(1, 2)).max()


def test_each_point_lies_in_cells_whose_shares_are_one() -> None:
    surface = sample_surface(scene()[0][0], CAMERA, SETTINGS)
    keyframe = adjustment._keyframe(NewKeyframe(0, surface, CAMERA, NOMINAL, np.eye(4), *IN_TIME, np.eye(4)))
    np.testing.assert_allclose(keyframe.shares.sum(axis=1), 1.0)
    columns, rows = BEND_NODES
    u = (keyframe.shares * (keyframe.cells % columns)).sum(axis=1) / (columns - 1) * CAMERA.width
    x, _, z = keyframe.points.T
    np.testing.assert_allclose(u, CAMERA.fx * x / z + CAMERA.cx, atol=0.01)
    assert keyframe.cells.max() < columns * rows


def test_what_is_corrected_already_is_taken_back() -> None:
    """A keyframe that was seen by a calibration is the one that was told."""
    known = Calibration(1.03, (0.01, -0.02, 0.005), (0.01, -0.02))
    depth, true = scene()[0][0], scene()[1][0]
    told, seen = (
        adjustment._keyframe(
            NewKeyframe(0, sample_surface(image, camera, SETTINGS), camera, by, pose, *IN_TIME, np.eye(4))
        )
        for image, camera, by, pose in (
            (depth, CAMERA, NOMINAL, true),
            (known.metres(depth), known.camera(CAMERA), known, turned(true, np.array(known.turn))),
        )
    )
    np.testing.assert_allclose(seen.given, told.given, atol=1e-9)
    if len(seen.points) == len(told.points):
        np.testing.assert_allclose(seen.points, told.points, atol=2e-3)
    middle = np.median(seen.points, axis=0) - np.median(told.points, axis=0)
    assert np.abs(middle).max() < 0.02


def test_what_is_sent_brings_earlier_poses_nearer_to_the_truth() -> None:
    found = np.array([before_and_after(seed) for seed in range(2)])
    assert (found[:, 1] < found[:, 0]).all()
    assert found[:, 1].sum() < 0.85 * found[:, 0].sum()


def before_and_after(seed: int) -> tuple[float, float]:
    """How far poses lie from where the camera truly was, metres: as they were published, and as known in the end."""
    frames = range(0, 600, 6)
    made = Scene(0, frames=600, intrinsics=CAMERA)
    true = np.array([made.true_pose(frame) for frame in frames])
    tracker, estimates = CorrectedPoses(SETTINGS), []
    for frame, pose in zip(frames, shaken(true, 0.01, 0.4, seed), strict=True):
        estimates.append(
            tracker.track(frame_of(1 + frame * 100_000_000 // 3, made[frame].depth_metres(), CAMERA, pose))
        )
    told = [estimate.corrections for estimate in estimates if estimate.corrections is not None]
    assert len(told) > 12
    last, now, off = told[-1], estimates[-1].T_world_map, []
    assert now is not None
    for frame, estimate, pose in zip(frames, estimates, true, strict=True):
        assert estimate.T_world_map is not None
        then = now @ invert(estimate.T_world_map) @ estimate.T_world_camera
        by = last.at(1 + frame * 100_000_000 // 3)
        if by is not None:
            off.append([(place @ invert(pose))[:3, 3] for place in (then, moved(then, by))])
    before, after = (np.linalg.norm(part - part.mean(axis=0), axis=1).mean() for part in np.array(off).swapaxes(0, 1))
    return float(before), float(after)


def test_keyframes_are_told_where_given_poses_are_on_average(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between two of them odometry is as good as exact: what each given pose has of its own is averaged out."""
    frames, told = range(0, 300, 3), dict[int, NDArray[np.float64]]()
    learn = KeyframeAdjuster.learn

    def remembered(adjuster: KeyframeAdjuster, seen: NewKeyframe, pose: NDArray[np.float64]) -> None:
        told[seen.stamp_ns] = seen.given
        learn(adjuster, seen, pose)

    monkeypatch.setattr(KeyframeAdjuster, "learn", remembered)
    made, tracker = Scene(0, frames=300, intrinsics=CAMERA), CorrectedPoses(SETTINGS)
    noise = 0.01 * np.random.default_rng(0).normal(size=(len(frames), 3))
    off = []
    for frame, wrong in zip(frames, noise, strict=True):
        stamp_ns, true = 1 + frame * 100_000_000 // 3, made.true_pose(frame)
        given = moved(true, np.append(wrong, np.zeros(3)))
        tracker.track(frame_of(stamp_ns, made[frame].depth_metres(), CAMERA, given))
        if frame > 100 and stamp_ns in told:
            off.append((np.linalg.norm(told[stamp_ns][:3, 3] - true[:3, 3]), np.linalg.norm(wrong)))
    averaged, own = np.mean(off, axis=0)
    assert len(off) > 8
    assert averaged < 0.6 * own


def test_corrections_after_a_jump_are_of_the_frames_after_it() -> None:
    depths, true = scene()
    tracker, estimates = CorrectedPoses(SETTINGS), []
    elsewhere = np.eye(4)
    elsewhere[0, 3] = 3.0
    for k in range(FRAMES):
        depth, pose = depths[k // 2], true[k // 2]
        estimates.append(
            tracker.track(frame_of(1 + k * STEP_NS, depth, CAMERA, elsewhere @ pose if k >= FRAMES // 2 else pose))
        )
    assert estimates[FRAMES // 2].restarted
    last = estimates[-1].corrections
    assert last is not None
    assert last.stamps_ns[0] > FRAMES // 2 * STEP_NS


def test_an_adjustment_that_fails_costs_one_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is said with the next keyframe; poses and corrections go on after it."""
    depths, true = scene()
    tracker, fails, failed, told = CorrectedPoses(SETTINGS), [True], [], []

    def failing_once(seen: SeenPoints, distance: float, scale: float) -> object:
        if len(seen.axes) == 8 and fails:
            raise np.linalg.LinAlgError(f"no planes {fails.pop()}")
        return plane_equations(seen, distance, scale)

    monkeypatch.setattr(adjustment, "plane_equations", failing_once)
    for k in range(FRAMES):
        try:
            estimate = tracker.track(frame_of(1 + k * STEP_NS, depths[k], CAMERA, true[k]))
        except np.linalg.LinAlgError:
            failed.append(k)
            continue
        assert estimate.status == "ok"
        if estimate.corrections is not None:
            told.append(k)
    assert failed == [9]
    assert max(told) == FRAMES - 1
    assert min(k for k in told if k > 9) <= 13
