"""Bags of which a part is broken: that part is left out and told, whichever its place; the rest is played."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_writer import Said, Speaker, camera_messages, write_bag

from spot3d.camera import Intrinsics
from spot3d.source.errors import SourceError
from spot3d.source.ros.bag import Bag
from spot3d.source.ros.topics import TopicNames
from spot3d.source.scene.scene import Scene
from spot3d.source.sequences import is_stream, open_source

CAMERA = Intrinsics(60.0, 61.0, 31.5, 23.5, 64, 48)
COUNT, START_NS = 4, 1_700_000_000_000_000_000
FRAMES = list(Scene(frames=COUNT, intrinsics=CAMERA))
NAME = "/camera/aligned_depth_to_color"
DEPTH, COLOUR = f"{NAME}/image_raw", "/camera/color/image_raw"
SPEAKER = Speaker(2)
NOTHING = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0}
NO_NUMBER = {"x": float("nan")}


def said_with(topic: str, places: range, change: Callable[[Any], Any]) -> list[Said]:
    """The scene's messages with some of one topic, by number, changed."""
    said, number = [], 0
    for name, received_ns, message in camera_messages(SPEAKER, FRAMES, START_NS):
        broken = name == topic and number in places
        number += name == topic
        said.append((name, received_ns, change(message) if broken else message))
    return said


def cut(message: Any) -> Any:
    return replace(message, data=message.data[:10])


def eight_bits(message: Any) -> Any:
    return replace(message, encoding="8UC1")


def uncalibrated(message: Any) -> Any:
    return replace(message, k=np.zeros(9))


def half_as_high(message: Any) -> Any:
    return replace(message, height=message.height // 2)


@pytest.mark.parametrize(("topic", "change"), [(DEPTH, cut), (DEPTH, eight_bits), (DEPTH, half_as_high), (COLOUR, cut)])
@pytest.mark.parametrize("place", [0, COUNT - 1])
def test_a_broken_image_is_that_of_one_frame(
    tmp_path: Path, topic: str, change: Callable[[Any], Any], place: int
) -> None:
    bag = open_source(write_bag(tmp_path, "mcap", said_with(topic, range(place, place + 1), change)))
    assert bag.intrinsics == CAMERA
    for index in range(COUNT):
        if index == place:
            with pytest.raises(SourceError):
                bag[index]
        else:
            np.testing.assert_array_equal(bag[index].depth, FRAMES[index].depth)


@pytest.mark.parametrize(
    ("topic", "change", "expected"),
    [
        (
            DEPTH,
            eight_bits,
            r"none of 4 image pairs of .* can be read; the first error: a depth image has the encoding "
            r"'8UC1'; supported are",
        ),
        (COLOUR, cut, r"none of 4 image pairs of .* can be read; the first error: an image of 64x48 rgb8 has"),
        (DEPTH, half_as_high, r"image_raw is 64x24, but its camera_info is for 64x48; .*--intrinsics"),
        (f"{NAME}/camera_info", uncalibrated, r"focal lengths must be positive .*; calibrate the camera.*--intrinsics"),
    ],
)
def test_a_bag_of_which_nothing_can_be_read_is_refused(
    tmp_path: Path, topic: str, change: Callable[[Any], Any], expected: str
) -> None:
    with pytest.raises(SourceError, match=expected):
        open_source(write_bag(tmp_path, "mcap", said_with(topic, range(COUNT), change)))


@pytest.mark.parametrize("topic", [f"{NAME}/camera_info", "/camera/color/camera_info"])
def test_the_first_camera_info_that_is_one_counts(tmp_path: Path, topic: str) -> None:
    bag = open_source(write_bag(tmp_path, "mcap", said_with(topic, range(1), uncalibrated)))
    assert bag.intrinsics == CAMERA


def test_a_camera_that_is_not_calibrated_needs_its_intrinsics_alone(tmp_path: Path) -> None:
    bag = write_bag(tmp_path, "mcap", said_with(f"{NAME}/camera_info", range(COUNT), uncalibrated))
    given = (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    assert open_source(bag, intrinsics=given).intrinsics == CAMERA


def test_intrinsics_of_another_size_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    def halved(message: Any) -> Any:
        return replace(message, k=np.array([30.0, 0, 15.5, 0, 30.5, 11.5, 0, 0, 1]))

    open_source(write_bag(tmp_path, "mcap", said_with(f"{NAME}/camera_info", range(COUNT), halved)))
    said = f"{NAME}/camera_info: the principal point (15.5, 11.5) is far from the centre of the 64x48 image"
    assert said in caplog.text


def poses_with(broken: dict[str, float] | None) -> list[Said]:
    """The camera's poses, of which the second is broken."""
    said: list[Said] = []
    for number, frame in enumerate(FRAMES):
        assert frame.T_world_camera is not None
        stamp_ns, T = START_NS + frame.stamp_ns, frame.T_world_camera
        pose, transform = SPEAKER.pose(stamp_ns, "map", T), SPEAKER.transform(stamp_ns, "map", "tracked", T)
        if broken and number == 1:
            pose = replace(pose, pose=replace(pose.pose, orientation=replace(pose.pose.orientation, **broken)))
            moved = transform.transform
            transform = replace(transform, transform=replace(moved, rotation=replace(moved.rotation, **broken)))
        said += [("/pose", stamp_ns, pose), ("/tf", stamp_ns, SPEAKER.tf(transform))]
    fixed = SPEAKER.transform(0, "tracked", "camera_color_optical_frame", np.eye(4))
    return [*said, ("/tf_static", 1, SPEAKER.tf(fixed))]


@pytest.mark.parametrize("broken", [NOTHING, NO_NUMBER])
@pytest.mark.parametrize(("topic", "what"), [("/pose", "poses of /pose"), ("/tf", "transforms of /tf")])
def test_a_broken_pose_is_left_out_and_told(
    tmp_path: Path, topic: str, what: str, broken: dict[str, float], caplog: pytest.LogCaptureFixture
) -> None:
    said = [*camera_messages(SPEAKER, FRAMES, START_NS), *poses_with(broken)]
    bag = open_source(write_bag(tmp_path, "mcap", said), topics=TopicNames(pose=topic))
    for index in (0, 2, 3):
        np.testing.assert_allclose(bag.true_pose(index), FRAMES[index].T_world_camera, atol=1e-9)
    assert f"1 of 4 {what} are left out; the first: " in caplog.text


def test_odometry_of_no_body_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    said = camera_messages(SPEAKER, FRAMES, START_NS)
    for frame in FRAMES:
        assert frame.T_world_camera is not None
        stamp_ns = START_NS + frame.stamp_ns
        said.append(("/odom", stamp_ns, SPEAKER.odometry(stamp_ns, "odom", "", frame.T_world_camera)))
    bag = open_source(write_bag(tmp_path, "mcap", said), topics=TopicNames(pose="/odom"))
    np.testing.assert_allclose(bag.true_pose(1), FRAMES[1].T_world_camera, atol=1e-9)
    assert "/odom names no child frame: its poses are taken as the camera's own, of its optical frame" in caplog.text


def test_poses_of_another_time_are_refused(tmp_path: Path) -> None:
    said = [*camera_messages(SPEAKER, FRAMES, START_NS), ("/pose", 5, SPEAKER.pose(5, "map", np.eye(4)))]
    with pytest.raises(
        SourceError, match=r"/pose has no pose at the time of any frame; check that both use the same clock"
    ):
        open_source(write_bag(tmp_path, "mcap", said), topics=TopicNames(pose="/pose"))


def test_frames_without_a_pose_are_told_with_how_near_poses_have_to_be(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    said = [*camera_messages(SPEAKER, FRAMES, START_NS)]
    said.append(("/pose", START_NS, SPEAKER.pose(START_NS, "map", np.eye(4))))
    bag = open_source(write_bag(tmp_path, "mcap", said), topics=TopicNames(pose="/pose"))
    alone = len(bag) - 1
    assert [bag.true_pose(index) is None for index in range(len(bag))] == [False] + [True] * alone
    told = f"/pose: {alone} of {len(bag)} depth images have no pose at their time; check that both use the same clock"
    assert f"{told}, and that poses are at most 0.25 s apart" in caplog.text


def test_one_image_without_a_stamp_leaves_the_others_theirs(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    def unstamped(message: Any) -> Any:
        return replace(message, header=replace(message.header, stamp=replace(message.header.stamp, sec=0, nanosec=0)))

    bag = open_source(write_bag(tmp_path, "mcap", said_with(DEPTH, range(1, 2), unstamped)))
    assert [bag.stamps_ns[index] for index in (0, 2, 3)] == [START_NS + FRAMES[index].stamp_ns for index in (0, 2, 3)]
    assert f"{DEPTH}: 1 of 4 messages have no timestamp: their time of receipt is used" in caplog.text


def test_a_message_too_short_for_a_stamp_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    raw = Bag._raw

    def short(bag: Bag, topics: tuple[str, ...]) -> Any:
        for number, (topic, received_ns, data) in enumerate(raw(bag, topics)):
            yield topic, received_ns, data[:4] if number == 0 else data

    path = write_bag(tmp_path, "mcap", camera_messages(SPEAKER, FRAMES, START_NS))
    monkeypatch.setattr(Bag, "_raw", short)
    assert len(open_source(path)) == COUNT


def test_a_bag_whose_index_lies_nowhere_is_told(tmp_path: Path) -> None:
    path = tmp_path / "walk.bag"
    path.write_bytes(b"#ROSBAG V2.0\n\x45\x00\x00\x00\x12\x00\x00\x00index_pos=" + bytes([255] * 8) + bytes(100))
    assert not is_stream(str(path))
    with pytest.raises(SourceError, match="cannot be read as a ROS bag"):
        open_source(path)
