import tracemalloc
from pathlib import Path

import cv2
import numpy as np
import pytest
from bag_writer import Said, Speaker, camera_messages, write_bag

from spot3d.camera import Intrinsics, invert
from spot3d.frame import RgbdFrame
from spot3d.pipeline import run_pipeline
from spot3d.settings import load_settings
from spot3d.source.calibration import ColourCamera
from spot3d.source.colour_registration import ColourRegistration
from spot3d.source.errors import SourceError
from spot3d.source.ros.topics import TopicNames
from spot3d.source.scene.scene import Scene
from spot3d.source.selected import Selection, open_selection
from spot3d.source.sequences import open_source

CAMERA = Intrinsics(585 / 4, 585 / 4, 80.0, 60.0, 160, 120)
START_NS = 1_700_000_000_123_456_789
FRAMES = list(Scene(frames=5, intrinsics=CAMERA))
T_BASE_CAMERA = np.array([[0.0, 0, 1, 0.1], [-1, 0, 0, 0.02], [0, -1, 0, 0.3], [0, 0, 0, 1]])
OPTICAL = "camera_color_optical_frame"


def said_by(version: int) -> list[Said]:
    """The scene with an odometry of the robot that carries the camera."""
    speaker = Speaker(version)
    said = camera_messages(speaker, FRAMES, START_NS)
    link = speaker.transform(START_NS, "base_link", "camera_link", T_BASE_CAMERA)
    optical = speaker.transform(START_NS, "camera_link", OPTICAL, np.eye(4))
    said.append(("/tf_static", START_NS, speaker.tf(link, optical)))
    for frame in FRAMES:
        assert frame.T_world_camera is not None
        stamp_ns = START_NS + frame.stamp_ns
        T_odom_base = frame.T_world_camera @ invert(T_BASE_CAMERA)
        said.append(("/odom", stamp_ns, speaker.odometry(stamp_ns, "odom", "base_link", T_odom_base)))
    return said


def assert_same(read: RgbdFrame, written: RgbdFrame) -> None:
    assert read.stamp_ns == START_NS + written.stamp_ns
    assert read.intrinsics == written.intrinsics
    assert read.depth_scale == written.depth_scale
    np.testing.assert_array_equal(read.colour, written.colour)
    np.testing.assert_array_equal(read.depth, written.depth)


@pytest.mark.parametrize("kind", ["bag", "mcap", "db3", "mcap-folder", "db3-folder"])
def test_every_container_gives_the_frames_that_were_written(tmp_path: Path, kind: str) -> None:
    path = write_bag(tmp_path, kind, said_by(1 if kind == "bag" else 2))
    bag = open_source(path, topics=TopicNames(pose="/odom"))
    assert bag.stamps_ns == [START_NS + frame.stamp_ns for frame in FRAMES]
    assert bag.rate_hz == pytest.approx(30, rel=1e-6)
    assert bag.has_true_poses
    for index in (0, 1, 2, 3, 4, 2, 0, 4):  # in order, and as a picture of the run looks at them
        assert_same(bag[index], FRAMES[index])
        np.testing.assert_allclose(bag[index].T_world_camera, FRAMES[index].T_world_camera, atol=1e-9)


def test_a_bag_gives_the_same_objects_as_the_folder(tmp_path: Path) -> None:
    frames = list(Scene(frames=3))
    (tmp_path / "camera-intrinsics.txt").write_text("585 0 320\n0 585 240\n0 0 1\n")
    (tmp_path / "calibration.json").write_text('{"registered": true}')
    for index, frame in enumerate(frames):
        cv2.imwrite(str(tmp_path / f"frame-{index:06}.color.png"), frame.colour[..., ::-1])
        cv2.imwrite(str(tmp_path / f"frame-{index:06}.depth.png"), frame.depth)
    bag = write_bag(tmp_path, "mcap", camera_messages(Speaker(2), frames))
    settings = load_settings()
    inputs = [open_selection(Selection(str(path)), settings.source) for path in (tmp_path, bag)]
    expected, found = (run_pipeline(sequence, settings).objects for sequence in inputs)
    assert len(found.objects) == len(expected.objects) >= 5
    for one, other in zip(found.objects, expected.objects, strict=True):
        np.testing.assert_array_equal(one.box.centre, other.box.centre)
        np.testing.assert_array_equal(one.box.size, other.box.size)


def test_images_are_read_one_at_a_time(tmp_path: Path) -> None:
    peaks, frame = [], FRAMES[0]
    for count in (3, 30, 80):  # the first time modules are imported
        frames = [
            RgbdFrame(33_000_000 * index, frame.colour, frame.depth, 0.001, CAMERA, None) for index in range(count)
        ]
        (tmp_path / str(len(peaks))).mkdir()
        path = write_bag(tmp_path / str(len(peaks)), "mcap", camera_messages(Speaker(2), frames, START_NS))
        del frames
        tracemalloc.start()
        try:
            assert sum(1 for _ in open_source(path)) == count
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    more = 10 * (frame.colour.nbytes + frame.depth.nbytes)
    assert peaks[2] - peaks[1] < more, "50 frames more in the bag, hardly more in memory"


def test_depth_that_is_not_registered_is_registered_by_tf_static(tmp_path: Path) -> None:
    speaker, frame = Speaker(2), FRAMES[0]
    colour_camera = Intrinsics(130.0, 131.0, 78.0, 61.0, 160, 120)
    T_colour_depth = np.eye(4)
    T_colour_depth[:3, 3] = 0.05, 0.001, 0.002
    depth_of_link, colour_of_link = np.eye(4), invert(T_colour_depth)
    said = [
        ("/cam/color/image_raw", 1, speaker.image(START_NS, "cam_color", "rgb8", frame.colour)),
        ("/cam/color/camera_info", 1, speaker.info(START_NS, "cam_color", colour_camera)),
        ("/cam/depth/image_rect_raw", 1, speaker.image(START_NS, "cam_depth", "16UC1", frame.depth)),
        ("/cam/depth/camera_info", 1, speaker.info(START_NS, "cam_depth", CAMERA)),
    ]
    mounted = speaker.tf(
        speaker.transform(0, "cam_link", "cam_depth", depth_of_link),
        speaker.transform(0, "cam_link", "cam_color", colour_of_link),
    )
    (tmp_path / "with").mkdir()
    registered = open_source(write_bag(tmp_path / "with", "db3", [*said, ("/tf_static", 1, mounted)]))[0]
    registration = ColourRegistration(CAMERA, ColourCamera(colour_camera, T_colour_depth))
    expected = registration.register(frame.colour, frame.depth_metres())
    np.testing.assert_array_equal(registered.colour, expected)
    np.testing.assert_array_equal(registered.depth, frame.depth)
    assert registered.intrinsics == CAMERA
    with pytest.raises(SourceError, match=r"not registered.*cam_color.*/tf_static does not connect the two frames"):
        open_source(write_bag(tmp_path, "db3", said))


@pytest.mark.parametrize(
    ("leave_out", "names", "expected"),
    [
        (r"depth", TopicNames(), r"found no depth topic among: .*/camera/color/image_raw \(Image\).*--depth-topic"),
        (r"/color/image", TopicNames(), r"found no colour topic among: .*/odom \(Odometry\).*--colour-topic"),
        (
            r"camera_info",
            TopicNames(),
            r"no camera_info with intrinsics beside /camera/aligned_depth_to_color/image_raw.*--intrinsics",
        ),
        ("", TopicNames(depth="/depth"), r"topic /depth is not in the bag; it contains: "),
        ("", TopicNames(depth="/odom"), r"topic /odom has type nav_msgs/msg/Odometry, not an image type"),
        ("", TopicNames(pose="/vio"), r"/vio is not a pose topic; choose one of: /odom"),
        ("tf_static", TopicNames(pose="/odom"), r"gives poses of base_link, but /tf_static does not connect it"),
    ],
)
def test_what_is_missing_is_named(tmp_path: Path, leave_out: str, names: TopicNames, expected: str) -> None:
    said = [one for one in said_by(2) if not leave_out or leave_out not in one[0]]
    with pytest.raises(SourceError, match=expected):
        open_source(write_bag(tmp_path, "mcap", said), topics=names)


@pytest.mark.parametrize("topic", ["/tf", "/tf:odom", "/camera_pose", "/vicon"])
def test_poses_of_transforms_and_of_a_tracker(tmp_path: Path, topic: str) -> None:
    speaker = Speaker(2)
    said = [one for one in said_by(2) if one[0] != "/odom"]
    T_map_odom = np.eye(4)
    T_map_odom[:3, 3] = 1.0, 2.0, 3.0
    for frame in FRAMES:
        assert frame.T_world_camera is not None
        stamp_ns = START_NS + frame.stamp_ns
        T_odom_base = frame.T_world_camera @ invert(T_BASE_CAMERA)
        moving = speaker.transform(stamp_ns, "odom", "base_link", T_odom_base)
        said.append(("/tf", stamp_ns, speaker.tf(moving, speaker.transform(stamp_ns, "map", "odom", T_map_odom))))
        said.append(("/vicon", stamp_ns, moving))
        said.append(("/camera_pose", stamp_ns, speaker.pose(stamp_ns, "odom", frame.T_world_camera)))
    bag = open_source(write_bag(tmp_path, "mcap", said), topics=TopicNames(pose=topic))
    T_world_odom = T_map_odom if topic == "/tf" else np.eye(4)
    for index, frame in enumerate(FRAMES):
        np.testing.assert_allclose(bag.true_pose(index), T_world_odom @ frame.T_world_camera, atol=1e-9)


@pytest.mark.parametrize("kind", ["bag", "mcap-folder"])
def test_a_folder_around_a_bag_names_it(tmp_path: Path, kind: str) -> None:
    path = write_bag(tmp_path, kind, said_by(1 if kind == "bag" else 2))
    with pytest.raises(SourceError, match=f"contains recordings, but is not one itself; .* such as {path}$"):
        open_source(tmp_path)


def test_a_bag_whose_recorder_was_killed_is_named_by_its_file(tmp_path: Path) -> None:
    path = write_bag(tmp_path, "mcap", said_by(2))
    (path.parent / "metadata.yaml").unlink()
    with pytest.raises(SourceError, match=f"give one of them, such as {path}$"):
        open_source(path.parent)


def test_intrinsics_can_be_given(tmp_path: Path) -> None:
    said = [one for one in said_by(2) if "info" not in one[0]]
    bag = open_source(write_bag(tmp_path, "mcap", said), intrinsics=(140.0, 141.0, 79.0, 59.0), halved=True)
    assert bag[0].intrinsics == Intrinsics(70.0, 70.5, 39.5, 29.5, 80, 60)


@pytest.mark.parametrize("kind", ["bag", "mcap", "db3"])
def test_a_bag_that_is_cut_off_is_told(tmp_path: Path, kind: str) -> None:
    path = write_bag(tmp_path, kind, said_by(1 if kind == "bag" else 2))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(SourceError, match=r"flight.* cannot be read as a ROS bag|image .* cannot be read"):
        list(open_source(path))


@pytest.mark.parametrize(
    ("profile", "expected"), [("ros1", "convert it"), ("other", "its profile is 'other'"), ("", "profile is ''")]
)
def test_an_mcap_file_of_something_else_is_refused(tmp_path: Path, profile: str, expected: str) -> None:
    body = len(profile).to_bytes(4, "little") + profile.encode() + bytes(4)
    path = tmp_path / "other.mcap"
    path.write_bytes(b"\x89MCAP0\r\n\x01" + len(body).to_bytes(8, "little") + body)
    with pytest.raises(SourceError, match=expected):
        open_source(path)
    path.write_bytes(b"not at all")
    with pytest.raises(SourceError, match="is not an MCAP file"):
        open_source(path)
