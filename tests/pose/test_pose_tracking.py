"""Providers on a made-up room: known motion, loss, recovery."""

import importlib.util
import os
import sys
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from fusion_room import look_at
from numpy.typing import NDArray

from made_frame import frame_of
from spot3d.camera import Intrinsics
from spot3d.depth_noise import KINECT_V1
from spot3d.evaluate.datasets import at_half_size, open_dataset
from spot3d.evaluate.faults import bent
from spot3d.pose.estimate import PoseEstimate, PoseTracker
from spot3d.pose.providers import make_tracker
from spot3d.pose.registration import Registration, implausible
from spot3d.pose.settings import PoseSettings
from spot3d.settings import load_settings
from spot3d.trajectory import rotation_angle, rotation_from_vector, rpe

CAMERA = Intrinsics(146.0, 146.0, 80.0, 60.0, 160, 120)
# With enough pixels for features.
LARGER = Intrinsics(292.0, 292.0, 159.5, 119.5, 320, 240)
# Room and furniture: lowest and highest corner, metres; z is up and the first box is seen from inside.
BOXES = np.array(
    [
        [(-1.5, -1.2, 0.0), (1.8, 1.6, 2.2)],
        [(0.3, 0.2, 0.0), (1.3, 1.0, 0.7)],
        [(0.5, 0.3, 0.7), (0.7, 0.6, 0.95)],
        [(0.9, 0.7, 0.7), (1.2, 0.9, 0.85)],
        [(-0.6, 1.0, 0.0), (-0.1, 1.6, 1.3)],
        [(1.2, -0.9, 0.0), (1.8, -0.4, 1.0)],
    ]
)
FRAME_NS = 33_333_333
PROVIDERS = [
    "kiss",
    pytest.param(
        "gicp",
        marks=pytest.mark.skipif(
            importlib.util.find_spec("small_gicp") is None, reason="small_gicp is not installed (extra gicp)"
        ),
    ),
]


# A floor, a wall and pillars before it, one like the other, 0.4 m apart.
PILLARS = np.array(
    [
        [(-4.0, -2.0, 0.0), (4.0, 1.0, 3.0)],
        *([(x, 0.8, 0.0), (x + 0.2, 1.0, 3.0)] for x in np.arange(-3.8, 3.8, 0.4)),
    ]
)

# A table with three small things, in a room.
TABLE = np.array(
    [
        [(-3.0, -3.0, 0.0), (3.0, 3.0, 2.5)],
        [(-1.2, -0.6, 0.0), (1.2, 0.6, 0.7)],
        [(-0.3, 0.0, 0.7), (-0.2, 0.1, 0.8)],
        [(0.2, 0.2, 0.7), (0.35, 0.3, 0.75)],
        [(0.6, -0.1, 0.7), (0.7, 0.05, 0.82)],
    ]
)

# A bare floor but for three crates.
CRATES = np.array(
    [
        [(-9.0, -9.0, 0.0), (9.0, 9.0, 5.0)],
        [(-0.7, -0.4, 0.0), (-0.2, 0.2, 0.5)],
        [(0.1, 0.2, 0.0), (0.6, 0.5, 0.3)],
        [(0.1, -0.6, 0.0), (0.3, -0.3, 0.6)],
    ]
)


def pose_at(seconds: float) -> NDArray[np.float64]:
    """A camera that moves sideways at 0.3 m/s while it looks into the furnished corner."""
    eye = np.array([-0.9 + 0.1 * np.sin(2 * seconds), -0.8 + 0.3 * seconds, 1.3 + 0.05 * np.sin(3 * seconds)])
    return look_at(eye, np.array([0.8, 0.5, 0.6]))


def rays(T_world_camera: NDArray[np.float64], camera: Intrinsics) -> NDArray[np.float64]:
    """Where each pixel (h, w, 3) looks, world axes, a metre along the camera's axis."""
    v, u = np.mgrid[: camera.height, : camera.width]
    across = np.stack(((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)), axis=-1)
    return np.asarray(across @ T_world_camera[:3, :3].T)


def render(
    T_world_camera: NDArray[np.float64],
    seed: int,
    boxes: NDArray[np.float64] = BOXES,
    camera: Intrinsics = CAMERA,
    alike: float = 0,
) -> NDArray[np.float32]:
    """Noisy depth (h, w) float32 metres of the room, by slabs: each ray meets each box at most twice.

    alike: pixels over which noise is alike, as that of depth from blocks of pixels is.
    """
    corners = (boxes[:, :, None, None, :] - T_world_camera[:3, 3]) / rays(T_world_camera, camera)
    enter = corners.min(axis=1).max(axis=-1)
    leave = corners.max(axis=1).min(axis=-1)
    depth = leave[0]
    for near, far in zip(enter[1:], leave[1:], strict=True):
        depth = np.where((near < far) & (near > 0), np.minimum(depth, near), depth)
    noise = np.random.default_rng(seed).normal(size=depth.shape)
    if alike:
        noise = cv2.GaussianBlur(noise, (0, 0), alike)
        noise /= noise.std()
    return (depth + noise * KINECT_V1.sigma(depth)).astype(np.float32)


def painted(T_world_camera: NDArray[np.float64], depth: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Colour (h, w, 3) uint8 RGB, seen by `LARGER`, of surfaces in painted squares of 5 cm, no two areas alike."""
    places = T_world_camera[:3, 3] + rays(T_world_camera, LARGER) * depth[..., None]
    i, j, k = np.moveaxis(np.rint(places / 0.05).astype(np.int64), -1, 0)
    grey = (i * 73_856_093 ^ j * 19_349_663 ^ k * 83_492_791) * 2_654_435_761 >> 16 & 255
    # As sharp as a lens, not as noise.
    return cv2.GaussianBlur(np.repeat(grey[..., None], 3, axis=-1).astype(np.uint8), (0, 0), 1.0)


@cache
def frame(index: int) -> NDArray[np.float32]:
    return render(pose_at(index / 30), index)


def error(estimate: PoseEstimate, true: NDArray[np.float64]) -> tuple[float, float]:
    """Distance in metres and angle in degrees between an estimate and the true pose."""
    off = np.linalg.inv(true) @ estimate.T_world_camera
    return float(np.linalg.norm(off[:3, 3])), float(np.degrees(rotation_angle(off[:3, :3])))


def started(provider: str, frames: int) -> PoseTracker:
    """A tracker that has followed the first frames."""
    tracker = make_tracker(PoseSettings.model_validate({"provider": provider, "lattice_width": 160}))
    for index in range(frames):
        given = pose_at(0) if index == 0 else None
        assert tracker.track(frame_of(1 + index * FRAME_NS, frame(index), CAMERA, given)).status == "ok"
    return tracker


@pytest.mark.parametrize(
    ("shift", "turn", "overlap", "residual", "reason"),
    [
        (0.0, 0.0, 1.0, 0.0, ""),
        (0.09, 0.15, 0.6, 0.01, ""),
        (0.2, 0.0, 1.0, 0.0, "an implausible motion of 0.20 m"),
        (0.0, 0.5, 1.0, 0.0, "an implausible turn of 29 deg"),
        (0.0, 0.0, 0.4, 0.0, "40% of the points"),
        (0.0, 0.0, 1.0, 0.05, "50.0 mm away from the map"),
        (0.0, 0.0, 1.0, float("nan"), "away from the map"),
    ],
)
def test_what_is_implausible(shift: float, turn: float, overlap: float, residual: float, reason: str) -> None:
    pose = np.eye(4)
    pose[0, 3] = shift
    pose[:3, :3] = rotation_from_vector(np.array([0.0, turn, 0.0]))
    found = implausible(Registration(pose, overlap, residual), np.eye(4), 1 / 30, 0.5, PoseSettings())
    assert reason in found
    assert bool(found) == bool(reason)


@pytest.mark.parametrize("provider", PROVIDERS)
def test_known_motion_is_recovered_in_the_world_of_the_first_given_pose(provider: str) -> None:
    tracker = started(provider, 1)
    for index in range(1, 30):
        estimate = tracker.track(frame_of(1 + index * FRAME_NS, frame(index), CAMERA))
        distance, angle = error(estimate, pose_at(index / 30))
        assert estimate.status == "ok"
        assert distance < 0.012
        assert angle < 0.5


def test_without_a_given_pose_the_world_is_the_first_camera() -> None:
    tracker = make_tracker(PoseSettings())
    np.testing.assert_array_equal(tracker.track(frame_of(1, frame(0), CAMERA)).T_world_camera, np.eye(4))


@pytest.mark.parametrize(("metres", "said"), [(1999.0, ""), (5e5, "(5e+05, 0, 0) m"), (1e155, "")])
def test_a_given_pose_that_no_map_reaches_does_not_anchor_the_world(metres: float, said: str) -> None:
    """Its later frames are followed all the same, from the first camera; poses off Earth are no poses."""
    far = np.eye(4)
    far[0, 3] = metres
    tracker = make_tracker(PoseSettings())
    first = tracker.track(frame_of(1, frame(0), CAMERA, far))
    second = tracker.track(frame_of(1 + FRAME_NS, frame(1), CAMERA, far))
    np.testing.assert_array_equal(first.T_world_camera, far if metres < 2000 else np.eye(4))
    assert (first.status, second.status, second.remark) == ("ok", "ok", "")
    assert said in first.remark
    assert bool(first.remark) == bool(said)


def test_two_runs_are_identical() -> None:
    first, second = (
        started("kiss", 5).track(frame_of(1 + 5 * FRAME_NS, frame(5), CAMERA)).T_world_camera for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("provider", PROVIDERS)
def test_covered_for_a_second(provider: str) -> None:
    tracker = started(provider, 10)
    last = tracker.track(frame_of(1 + 10 * FRAME_NS, frame(10), CAMERA)).T_world_camera
    hand = np.full(CAMERA.shape, 0.25, np.float32)
    for index in range(11, 41):
        covered = hand if index % 2 else np.zeros(CAMERA.shape, np.float32)
        estimate = tracker.track(frame_of(1 + index * FRAME_NS, covered, CAMERA))
        assert estimate.status == "lost"
        assert estimate.reason
        np.testing.assert_array_equal(estimate.T_world_camera, last)
    for index in range(41, 46):
        estimate = tracker.track(frame_of(1 + index * FRAME_NS, frame(index), CAMERA))
        assert estimate.status == "ok"
        distance, angle = error(estimate, pose_at(index / 30))
        assert distance < 0.02
        assert angle < 0.7


@pytest.mark.parametrize("provider", PROVIDERS)
@pytest.mark.parametrize("after", [0, 20])
def test_a_jump_is_lost_and_the_map_survives_it(provider: str, after: int) -> None:
    """Whether what is elsewhere comes as the next frame or two thirds of a second later."""
    tracker = started(provider, 10)
    away = pose_at(10 / 30)
    away[:3, :3] = away[:3, :3] @ rotation_from_vector(np.array([0.0, 2.4, 0.0]))
    for index in range(10, 20):
        estimate = tracker.track(frame_of(1 + (index + after) * FRAME_NS, render(away, index), CAMERA))
        assert estimate.status == "lost"
        assert estimate.reason
    estimate = tracker.track(frame_of(1 + (20 + after) * FRAME_NS, frame(20), CAMERA))
    assert estimate.status == "ok"
    assert error(estimate, pose_at(20 / 30))[0] < 0.02


@pytest.mark.parametrize("provider", PROVIDERS)
def test_frames_that_are_torn_elsewhere_are_followed(provider: str) -> None:
    """Half of each lacks depth, in other strips each time: less than half of the second meets the first."""
    rng = np.random.default_rng(0)
    tracker = make_tracker(PoseSettings.model_validate({"provider": provider, "lattice_width": 160}))
    for index in range(20):
        torn = frame(index).copy()
        torn[:, np.repeat(rng.permutation(10) < 5, CAMERA.width // 10)] = 0
        estimate = tracker.track(frame_of(1 + index * FRAME_NS, torn, CAMERA, pose_at(0) if index == 0 else None))
        assert estimate.status == "ok", (index, estimate.reason)
        assert error(estimate, pose_at(index / 30))[0] < 0.015


def test_a_step_too_fast_for_a_camera_is_a_jump() -> None:
    tracker = started("kiss", 5)
    # A third of a second's way within a millisecond: the map fits, the speed does not.
    estimate = tracker.track(frame_of(1 + 4 * FRAME_NS + 1_000_000, frame(15), CAMERA))
    assert estimate.status == "lost"
    assert "implausible motion" in estimate.reason
    assert tracker.track(frame_of(1 + 15 * FRAME_NS, frame(15), CAMERA)).status == "ok"


def test_dropped_frames_are_no_loss() -> None:
    tracker = started("kiss", 3)
    for index in (9, 16, 24, 34):
        estimate = tracker.track(frame_of(1 + index * FRAME_NS, frame(index), CAMERA))
        assert estimate.status == "ok"
        assert error(estimate, pose_at(index / 30))[0] < 0.015


@pytest.mark.parametrize("sway", [0.2, 0.3])
def test_a_camera_of_three_frames_in_two_seconds_is_followed(sway: float) -> None:
    """It goes around the corner by 0.1 m and looks to another side each time: its velocity says nothing."""
    tracker = make_tracker(PoseSettings.model_validate({"lattice_width": 160}))
    for index in range(8):
        eye = np.array([0.8 - 1.5 * np.cos(0.1 * (index + 1)), 0.5 - 1.2 * np.sin(0.5 + 0.1 * index), 1.3])
        aside = sway * np.array([(-1) ** index, (-1) ** (index // 2), 0.3 * (-1) ** index])
        pose = look_at(eye, np.array([0.8, 0.5, 0.6]) + aside)
        estimate = tracker.track(frame_of(1 + 20 * index * FRAME_NS, render(pose, index), CAMERA, pose))
        assert estimate.status == "ok"
        assert error(estimate, pose)[0] < 0.015


@pytest.mark.parametrize(("coloured", "features"), [(True, 500), (True, 150), (False, 500)])
def test_what_is_painted_tells_one_pillar_from_another(coloured: bool, features: int) -> None:
    """A camera that comes two thirds of a second later to the next pillar sees the same depth, but other colours.

    Of 150 features too few are known again to tell the place alone.
    """
    tracker = make_tracker(PoseSettings(lattice_width=160, features=features))
    for index in range(4):
        pose = look_at(np.array([0.4 * index - 0.6, -0.7, 1.2]), np.array([0.4 * index - 0.45, 0.8, 0.9]))
        depth = render(pose, index, PILLARS, LARGER)
        colour = painted(pose, depth) if coloured else None
        estimate = tracker.track(frame_of(1 + 20 * index * FRAME_NS, depth, LARGER, pose, colour))
        assert estimate.status == "ok"
        assert (error(estimate, pose)[0] < 0.02) == (coloured or index == 0)


@pytest.mark.parametrize("bend", [0.0, 0.006, 0.01])
def test_what_bends_depth_does_not_hold_a_camera_where_it_was(bend: float) -> None:
    """Over a table at half a metre a second, ten frames a second: what is bent is where it was in each image."""
    tracker = make_tracker(PoseSettings())
    for index in range(14):
        along = 0.05 * index - 0.5
        pose = look_at(np.array([along, -0.75, 1.45]), np.array([along + 0.1, 0.1, 0.7]))
        depth = render(pose, index, TABLE, LARGER)
        colour = painted(pose, depth)
        seen = bent(depth, bend, 1) if bend else depth
        estimate = tracker.track(frame_of(1 + 3 * index * FRAME_NS, seen, LARGER, pose, colour))
        assert estimate.status == "ok"
        assert error(estimate, pose)[0] < 0.015 + 4 * bend


def test_a_bare_wall_holds_no_pose() -> None:
    wall = np.full(CAMERA.shape, 1.5, np.float32)
    estimate = make_tracker(PoseSettings()).track(frame_of(1, wall, CAMERA))
    assert (estimate.status, "every direction" in estimate.reason) == ("lost", True)


@pytest.mark.parametrize("alike", [0, 1.5, 3])
def test_noise_does_not_hold_a_camera_over_a_bare_floor(alike: float) -> None:
    """It is lost where the crates leave the image, and found where they come back; noise of normals had it followed,
    and it slid by metres. What is alike over some pixels turns normals by more."""
    there = [0.06 * k for k in range(24)]
    tracker, lost = make_tracker(PoseSettings()), []
    for index, along in enumerate(there + there[::-1]):
        pose = look_at(np.array([along - 0.7, -0.9, 1.4]), np.array([along, 0.0, 0.1]))
        estimate = tracker.track(
            frame_of(1 + 3 * index * FRAME_NS, render(pose, index, CRATES, LARGER, alike), LARGER, pose)
        )
        lost.append(estimate.status == "lost")
        assert lost[-1] or error(estimate, pose)[0] < 0.005
    assert not any(lost[:8] + lost[-8:])
    assert all(lost[16:32])


@pytest.mark.parametrize("step_s", [1 / 30, 0.3])
def test_what_is_painted_holds_the_pose_over_a_plain_table(step_s: float) -> None:
    """No surface does: without colour nothing is tracked, with it everything from the first frame on."""
    seen, unseen = make_tracker(PoseSettings()), make_tracker(PoseSettings())
    for index in range(8):
        along, stamp_ns = 0.02 * index, 1 + round(index * step_s * 1e9)
        pose = look_at(np.array([along, -0.75, 1.2]), np.array([along - 0.1, 0.1, 0.0]))
        depth = (pose[2, 3] / -rays(pose, LARGER)[..., 2]).astype(np.float32)
        estimate = seen.track(frame_of(stamp_ns, depth, LARGER, pose, painted(pose, depth)))
        assert estimate.status == "ok", estimate.reason
        assert error(estimate, pose)[0] < 0.01
        assert unseen.track(frame_of(stamp_ns, depth, LARGER, pose)).status == "lost"
        grey = np.full((*LARGER.shape, 3), 128, np.uint8)
        assert unseen.track(frame_of(stamp_ns + 1, depth, LARGER, pose, grey)).status == "lost"


def test_the_view_of_a_plain_table_is_lost_where_its_landmarks_are_others() -> None:
    """It is held by what is painted, but nothing tells where it is: another part of the table comes without warning."""
    tracker = make_tracker(PoseSettings())
    estimates = []
    for number, along in enumerate((0.0, 0.02, 30.0)):
        pose = look_at(np.array([along, -0.75, 1.2]), np.array([along - 0.1, 0.1, 0.0]))
        depth = (pose[2, 3] / -rays(pose, LARGER)[..., 2]).astype(np.float32)
        estimates.append(tracker.track(frame_of(1 + number * FRAME_NS, depth, LARGER, pose, painted(pose, depth))))
    assert [estimate.status for estimate in estimates] == ["ok", "ok", "lost"]
    assert "neither surface nor landmarks" in estimates[-1].reason


def test_nothing_to_see_before_the_first_pose() -> None:
    tracker = make_tracker(PoseSettings())
    assert tracker.track(frame_of(1, np.zeros(CAMERA.shape, np.float32), CAMERA, pose_at(0))).status == "lost"
    estimate = tracker.track(frame_of(2, frame(0), CAMERA, pose_at(0)))
    assert estimate.status == "ok"
    np.testing.assert_allclose(estimate.T_world_camera, pose_at(0), atol=1e-12)


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (0.0, "the depth image is empty"),
        (1000.0, "check its unit (depth_scale), which --depth-unit sets for a folder"),
    ],
)
def test_depth_in_another_unit_is_told_as_such(factor: float, said: str) -> None:
    depth = np.float32(factor) * frame(0)
    estimate = make_tracker(PoseSettings()).track(frame_of(1, depth, CAMERA))
    assert estimate.status == "lost"
    assert said in estimate.reason


def test_stamps_must_follow_each_other() -> None:
    tracker = started("kiss", 2)
    assert "is not later than" in tracker.track(frame_of(1, frame(2), CAMERA)).reason
    assert tracker.track(frame_of(1 + 2 * FRAME_NS, frame(2), CAMERA)).status == "ok"


def test_gicp_without_its_package_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "small_gicp", None)
    monkeypatch.delitem(sys.modules, "spot3d.pose.gicp", raising=False)
    with pytest.raises(ModuleNotFoundError, match=r"spot3d\[gicp\]"):
        make_tracker(PoseSettings(provider="gicp"))


def data_of(name: str) -> Path:
    data = Path(os.environ.get("SPOT3D_DATA", Path(__file__).parents[2] / "../shared/data")) / name
    if not data.is_dir():
        pytest.skip(f"no data in {data}")
    return data


def test_no_frame_of_a_plain_cabinet_is_lost() -> None:
    """TUM fr3/cabinet has 1.5 frames a second: of half its size a third was lost, and then found 2.5 m away, where its
    frames were asked whether noise holds them as those of video rate are."""
    settings = load_settings()
    cabinet = at_half_size(open_dataset(str(data_of("tum_fr3_cabinet")), settings, 1, 12)).sequences[0].sequence
    tracker, true, estimated = make_tracker(settings.pose), [], []
    for index in range(12):
        frame = cabinet[index]
        estimate = tracker.track(frame)
        assert estimate.status == "ok"
        true.append(frame.T_world_camera)
        estimated.append(estimate.T_world_camera)
    assert rpe(np.array(true), np.array(estimated))[0]["rmse"] < 0.12


def test_redkitchen_poses() -> None:
    data = data_of("redkitchen")
    camera = Intrinsics(292.5, 292.5, 160.0, 120.0, 320, 240)
    tracker = make_tracker(PoseSettings())
    true, estimated = [], []
    for index in range(30):
        millimetres = cv2.imread(str(data / f"frame-{index:06d}.depth.png"), cv2.IMREAD_UNCHANGED)[::2, ::2]
        depth = np.where(millimetres == 65535, 0, millimetres).astype(np.float32) * np.float32(0.001)
        true.append(np.loadtxt(data / f"frame-{index:06d}.pose.txt"))
        estimate = tracker.track(frame_of(1 + index * FRAME_NS, depth, camera, true[0]))
        assert estimate.status == "ok"
        estimated.append(estimate.T_world_camera)
    translation, rotation = rpe(np.array(true), np.array(estimated))
    assert translation["rmse"] < 0.0045
    assert np.degrees(rotation["rmse"]) < 0.15


def test_a_full_map_is_told_with_the_frame_that_fills_it() -> None:
    tracker = make_tracker(PoseSettings(surfel_limit=4000))
    told = [tracker.track(frame_of(1 + index * FRAME_NS, frame(index), CAMERA)).forgotten for index in range(20)]
    assert told[0] == 0
    assert sum(told) > 0
